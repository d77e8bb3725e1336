"""A recorded log mapped: trajectory, map, pose graph, and how far all of it is to be believed."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from experiments.evaluation import evaluated, span
from experiments.known_maps import map_to_continue
from experiments.observer import NO_ONE, LogObserver
from experiments.reference_files import read_reference, read_related
from experiments.slam_passes import OnScan, best_mapped, mapped_once
from experiments.slam_result import SlamLog
from experiments.starts import check_start
from slam.arrays import FloatArray
from slam.beams import POINTS_WITHIN_M
from slam.readers.log import Log, LogChoice
from slam.readers.recognition import read_log
from slam.se2 import SE2
from slam.slam_map import SlamMap


def run(
    log_path: Path,
    reference: Path | None = None,
    relations: Path | None = None,
    on_scan: OnScan | None = None,
    map_path: Path | None = None,
    start: SE2 | None = None,
    choice: LogChoice | None = None,
    observer: LogObserver = NO_ONE,
) -> SlamLog:
    """Maps a log, with one set of parameters for all; as one more session of a map, if one is given.

    on_scan: told of each scan's number, how many there are, and its step. start: pose of the first
    scan on that map, if it is known. choice: of what the log leaves open. Raises ValueError for files that are not what they should be,
    OSError for unreadable ones.
    """
    # refused now rather than after the log
    against = None if reference is None else read_reference(reference)
    related = None if relations is None else read_related(relations)
    known = None if map_path is None else map_to_continue(map_path)
    if known is not None and start is not None:
        _check_start(known, start)
    mapped = partial(mapped_once, known=known, start=start, on_scan=on_scan, observer=observer)
    log = read_log(log_path, choice)
    log.check_sees()
    if against is not None and reference is not None:
        check_same_time(log, against.times_s, reference)
    if related is not None and relations is not None:
        for times_s in related.times_s.T:
            check_same_time(log, times_s, relations)
    result = best_mapped(log, mapped)
    if not result.slam_map.keyframes:
        raise ValueError(
            f"{log.told_as}: none of the {log.scan_count} scans tells where it was taken: too few of its"
            f" beams came back from within {POINTS_WITHIN_M:g} m; expected ranges to walls, in metres"
        )
    result = replace(result, notes=(*log.notes, *result.notes))
    if map_path is not None:
        result = replace(result, continued=map_path.name, start=start)
    if against is None and related is None:
        return result
    name = None if relations is None else relations.name
    evaluation = evaluated(result.trajectory, against, related, relations_of=name)
    return replace(result, evaluation=evaluation, reference=against)


def default_mapped(log: Log, known: SlamMap | None = None) -> SlamLog:
    """A log as `run` maps it when nothing else is told, as one more session of a map if one is given."""
    return best_mapped(log, partial(mapped_once, known=known))


def _check_start(known: SlamMap, start: SE2) -> None:
    """Raises ValueError for a start farther from a map than its own scans reached: nothing that is
    seen there can be on it."""
    reach_m = max(
        (np.hypot(*one.points.T).max(initial=0.0) for one in known.keyframes), default=0.0
    )
    at_m = np.array([start.x, start.y])
    off_m = min(
        (
            np.hypot(*(SE2.from_array(pose) @ one.points - at_m).T).min(initial=math.inf)
            for one, pose in zip(known.keyframes, known.poses, strict=True)
        ),
        default=0.0,
    )
    if off_m < math.inf:
        check_start(start, off_m, reach_m, "scans reach")


def check_same_time(log: Log, times_s: FloatArray, path: Path) -> None:
    """Raises ValueError where nothing of a reference is of the log's time."""
    stamps_s = np.array([record.time_s for record in log.records])
    if not ((times_s >= stamps_s.min()) & (times_s <= stamps_s.max())).any():
        raise ValueError(
            f"{path} is of {span(times_s)} s, and {log.told_as} of {span(stamps_s)} s: is it that"
            " of another log?"
        )

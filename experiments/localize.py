"""A recorded log on a known map: where the robot was at each scan, and how sure it was of it."""

from __future__ import annotations

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.known_maps import LogConfig, check_is_map, map_of_file
from experiments.observer import NO_ONE, LogObserver
from experiments.starts import check_start
from experiments.trial_log import write_atomically
from slam.beams import Beams
from slam.known_map import KnownMap
from slam.localization import Estimate
from slam.readers.log import Log, LogChoice
from slam.readers.recognition import read_log
from slam.se2 import SE2
from slam.trajectory import Trajectory, write_tum
from slam.verdict import Status

VERDICT_COLUMNS = (
    "time", "status", "x", "y", "theta", "var_x", "cov_xy", "cov_xtheta", "var_y", "cov_ytheta",
    "var_theta", "reasons", "warnings",
)  # fmt: skip
"""Of `verdicts.csv`: pose in the map frame [m, rad], a best guess unless tracking, empty before
there is any; covariance of its tangent in the base frame, empty where nothing is claimed, as by a
robot that is lost; reasons of the status, and warnings of what does not fit map, laser or wheels
whatever the status is, each joined by "; "."""

_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?")


@dataclass(frozen=True)
class LocalizedLog:
    """The estimates of a log's scans in order, on the map that they were found on.

    start: the pose given for the first scan, None if it was unknown. notes: what of the log was
    taken, in words.
    """

    name: str
    map_name: str
    config: LogConfig
    known: KnownMap
    estimates: tuple[Estimate, ...]
    last_points: np.ndarray
    """(N, 2) of the last scan that was tracked, map frame [m]."""
    start: SE2 | None = None
    notes: tuple[str, ...] = ()

    def placed(self) -> tuple[Estimate, ...]:
        """The estimates from the first on that has a pose at all, be it a guess."""
        return self.estimates[_first_placed(self.estimates, self.start) :]

    def trajectory(self) -> Trajectory:
        """The poses reported, sure or not; none before the first that there is."""
        placed = self.placed()
        return Trajectory(
            np.array([estimate.time_s for estimate in placed]),
            np.array([estimate.T_map_base.as_array() for estimate in placed]).reshape(-1, 3),
        )

    def statuses(self) -> list[Status]:
        """The verdict of each scan."""
        return [estimate.verdict.status for estimate in self.estimates]

    def summary(self) -> dict[str, Any]:
        """How often which verdict, how long it took to be found, and of how many scans there were
        warnings; those of the last such scan; of how many each kind, as its last one says it."""
        counts = Counter(status.value for status in self.statuses())
        recoveries = [
            estimate.verdict.recovery_s
            for estimate in self.estimates
            if estimate.verdict.recovery_s is not None
        ]
        warned = [estimate for estimate in self.estimates if estimate.warnings]
        return {
            "experiment": "localize",
            "log": self.name,
            "map": self.map_name,
            "start": None if self.start is None else self.start.as_array().tolist(),
            "scans": len(self.estimates),
            **{status.value: counts[status.value] for status in Status},
            "recoveries_s": recoveries,
            "warned": len(warned),
            "warnings": list(warned[-1].warnings) if warned else [],
            "warned_of": _warned_of(self.estimates),
            "config": asdict(self.config),
        }


def run(
    map_path: Path,
    log_path: Path,
    start: SE2 | None,
    config: LogConfig | None = None,
    on_scan: Callable[[int, int, Estimate], None] | None = None,
    choice: LogChoice | None = None,
    observer: LogObserver = NO_ONE,
) -> LocalizedLog:
    """Every scan of a recorded log on a ROS map, from a start or from nowhere.

    on_scan: told of each, with its number and how many there are. choice: of what the log leaves
    open. Raises ValueError for files that
    are not what they should be, OSError for unreadable ones.
    """
    check_is_map(map_path)
    log = read_log(log_path, choice)
    config = (config or LogConfig()).seeing(log)
    known, said = map_of_file(map_path, config.laser)
    if start is not None:
        away_m = known.points - np.array([start.x, start.y])
        off_m = float(np.hypot(*away_m.T).min())
        check_start(start, off_m, config.range_max_m, "walls are seen from up to")
    estimates, last = localized(known, log, start, config, on_scan, observer)
    return LocalizedLog(
        log.name, map_path.name, config, known, tuple(estimates), last, start, (*said, *log.notes)
    )


def localized(
    known: KnownMap,
    log: Log,
    start: SE2 | None,
    config: LogConfig,
    on_scan: Callable[[int, int, Estimate], None] | None = None,
    observer: LogObserver = NO_ONE,
) -> tuple[list[Estimate], np.ndarray]:
    """The estimate of each scan, and the points of the last one tracked (N, 2), map frame."""
    localizer = known.localizer(config.method, start, log.T_base_laser)
    assert localizer.guard is not None
    observer.begins(log, known)
    estimates: list[Estimate] = []
    last = np.empty((0, 2))
    for index, measurement in enumerate(log.measurements()):
        cut = replace(measurement, scan=measurement.scan.cut(config.range_max_m))
        if index == 0:
            # the start is the pose of the first scan, whatever the wheels did before
            cut = replace(cut, motion=SE2.identity(), motion_covariance=np.zeros((3, 3)))
        estimate = localizer.update(cut)
        if localizer.guard.is_lost:
            # of one place among several, it would tell how well the scan fits there
            estimate = replace(estimate, covariance=None)
        estimates.append(estimate)
        observer.localized(cut, estimate)
        if estimates[-1].verdict.status is Status.TRACKING:
            last = estimates[-1].T_map_base @ Beams.of(cut.scan, log.T_base_laser).points
        if on_scan is not None:
            on_scan(index, log.scan_count, estimates[-1])
    return estimates, last


def _first_placed(estimates: Sequence[Estimate], start: SE2 | None) -> int:
    """The number of the first estimate with a pose, found or given; their count if none has."""
    if start is not None:
        return 0
    verdicts = [estimate.verdict for estimate in estimates]
    has_place = [v.status is Status.TRACKING or len(v.hypotheses) > 0 for v in verdicts]
    return has_place.index(True) if any(has_place) else len(estimates)


def verdict_rows(estimates: Sequence[Estimate], start: SE2 | None) -> list[list[Any]]:
    """Rows of VERDICT_COLUMNS, from a start or from nowhere."""
    rows = []
    placed = _first_placed(estimates, start)
    for index, estimate in enumerate(estimates):
        covariance = estimate.covariance
        pose = ["", "", ""]
        if index >= placed:
            pose = [f"{value:.6f}" for value in estimate.T_map_base.as_array()]
        upper: list[Any] = [""] * 6
        if covariance is not None:
            upper = [f"{value:.9g}" for value in covariance[np.triu_indices(3)]]
        rows.append(
            [
                f"{estimate.time_s:.6f}",
                estimate.verdict.status.value,
                *pose,
                *upper,
                "; ".join(estimate.verdict.reasons),
                "; ".join(estimate.warnings),
            ]
        )
    return rows


def write_results(result: LocalizedLog, folder: Path) -> None:
    """Writes summary.json, verdicts.csv and trajectory.tum. Raises OSError if it cannot."""
    folder.mkdir(parents=True, exist_ok=True)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(VERDICT_COLUMNS)
    writer.writerows(verdict_rows(result.estimates, result.start))
    write_atomically(folder / "verdicts.csv", text.getvalue())
    write_atomically(folder / "summary.json", json.dumps(result.summary(), indent=2) + "\n")
    write_tum(folder / "trajectory.tum", result.trajectory())


def _warned_of(estimates: Sequence[Estimate]) -> list[dict[str, Any]]:
    """Each kind of warning once, of most scans first: warnings that differ by their numbers are one kind."""
    last, counts = dict[str, str](), Counter[str]()
    for estimate in estimates:
        told = {_NUMBER.sub("", warning): warning for warning in estimate.warnings}
        last.update(told)
        counts.update(told.keys())
    return [{"scans": count, "last": last[kind]} for kind, count in counts.most_common()]


def table(summary: dict[str, Any]) -> str:
    """The summary for people to read; each kind of warning once, with how many scans it is of."""
    lines = [
        f"{summary['log']} on {summary['map']}: {summary['scans']} scans: {summary['tracking']}"
        f" tracking, {summary['unsure']} unsure, {summary['lost']} lost; {_found(summary)}"
    ]
    if summary["warned"]:
        lines.append(f"{summary['warned']} scans came with warnings; the last one of each kind:")
        for one in summary["warned_of"]:
            scans = "1 scan" if one["scans"] == 1 else f"{one['scans']} scans"
            lines.append(f"  {scans}: {one['last']}")
    return "\n".join(lines)


def _found(summary: dict[str, Any]) -> str:
    """How often the robot was found, and how long that took; from a given start it need not be."""
    took = summary["recoveries_s"]
    if took:
        times = "once" if len(took) == 1 else f"{len(took)} times"
        after = f"{times}, after {max(took):.1f} s" + (" at most" if len(took) > 1 else "")
        return f"found {after}" if summary["start"] is None else f"lost and found again {after}"
    if summary["start"] is None:
        return "never found"
    return "not found again" if summary["lost"] else "never lost since the start that was given"

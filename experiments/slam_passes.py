"""A recorded log mapped, in as many passes over it as it takes."""

from __future__ import annotations

import gc
import math
import time
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from experiments.memory import MemoryGrowth
from experiments.observer import NO_ONE, LogObserver
from experiments.slam_result import SlamLog
from experiments.slam_wheels import calibrated_log, map_spread_m, wheels_summary
from slam.arrays import FloatArray, IntArray
from slam.frontend.front_end_config import FrontEndConfig
from slam.map_checks.drive_monitor import told_by_wheels_alone
from slam.map_checks.map_consistency import leaves_no_doubt
from slam.map_checks.map_drift import too_far_adrift
from slam.map_checks.moved_things import is_all_that_is_said
from slam.map_checks.range_offset import range_offset, said_of_ranges
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper, MapperStep
from slam.pose_lookup import PoseLookup
from slam.readers.log import Log, MotionSinceScan
from slam.se2 import SE2
from slam.slam_map import SlamMap
from slam.trajectory import Trajectory
from slam.warm_up import warm_up

_DRIFT_OF_SECOND = 1.0 / 3.0
"""Share of the drift that a map may have by its own account, for one by a second look. Chosen: with a third
of the scans of mit-csail lost in one piece, one that was 0.21 m off said 0.39 m of itself; right ones of real
logs say 0.26 m at most."""

OnScan = Callable[[int, int, MapperStep], None]


def best_mapped(log: Log, mapped: Callable[..., SlamLog]) -> SlamLog:
    """The log mapped; where that does not hold together, once more: with its ranges put right, if scans show
    by how much all of them are off, and then with its odometry as a guess. Whoever interrupts another look
    gets what came of those before."""
    looked = _by_best_wheels(log, mapped)
    try:
        looked = _by_right_ranges(looked, mapped)
        return _by_doubted_odometry(looked, mapped)
    except KeyboardInterrupt:
        said = "interrupted while the log was mapped once more: this is the map before that"
        return replace(looked.best, notes=(said,))


class _Looked(NamedTuple):
    """A log and how it is mapped; the best map so far, and passes over the log up to now."""

    log: Log
    config: MapperConfig
    best: SlamLog
    passes: int


def _by_right_ranges(looked: _Looked, mapped: Callable[..., SlamLog]) -> _Looked:
    """The log mapped once more, its ranges put right, where its map shows that all of them are off by as much;
    taken where scans bear it out. Of a good map nobody asks."""
    log, config, first, passes = looked
    if first.slam_map.verdict.is_good:
        return looked
    found = range_offset(first.slam_map.keyframes, first.slam_map.poses)
    if found is None or not found.is_shown:
        return looked
    config = replace(config, range_offset_m=found.offset_m)
    again = mapped(log, config)
    if said_of_ranges(again.slam_map.keyframes, again.slam_map.poses):
        return looked._replace(best=_beside(first, again), passes=passes + 1)
    again = replace(
        again, used_pass=passes, wheels=first.wheels, range_offset_m=found.offset_m,
        range_offset_sigma_m=found.sigma_m,
    )  # fmt: skip
    return _Looked(log, config, _beside(again, first), passes + 1)


def _by_doubted_odometry(looked: _Looked, mapped: Callable[..., SlamLog]) -> SlamLog:
    """The log mapped once more with its odometry as a guess from which scans are matched, and no more. That map
    is judged more strictly, and by what its scans say against odometry too."""
    log, config, first, passes = looked
    slam_map = first.slam_map
    if slam_map.verdict.is_good or slam_map.unjoined or not log.has_odometry:
        return first  # a session is not joined by other odometry
    if is_all_that_is_said(slam_map.verdict.reasons):
        return first
    again = mapped(log, replace(config, is_odometry_doubted=True))
    if not leaves_no_doubt(again.slam_map.verdict) or too_far_adrift(
        again.slam_map.drift_m, again.slam_map.poses, _DRIFT_OF_SECOND
    ):
        return _beside(first, again)
    again = replace(
        again, used_pass=passes, wheels=first.wheels, is_odometry_doubted=True,
        range_offset_m=first.range_offset_m, range_offset_sigma_m=first.range_offset_sigma_m,
    )  # fmt: skip
    return _beside(again, first)


def _by_best_wheels(log: Log, mapped: Callable[..., SlamLog]) -> _Looked:
    """The log mapped; where it tells ticks, twice: by the wheels as assumed, and as the drive shows them.
    The map is that which holds together, and of two that do, the sharper one."""
    usual = MapperConfig()
    first, calibrated = mapped(log, usual), calibrated_log(log)
    if calibrated is None:
        return _Looked(log, usual, first, 1)
    second = replace(mapped(calibrated.log, calibrated.mapper), used_pass=1)
    maps = first.slam_map, second.slam_map
    doubts = [(not one.verdict.is_good, map_spread_m(one) or math.inf) for one in maps]
    is_used = calibrated.is_sharper and doubts[1] < doubts[0]
    wheels = wheels_summary(calibrated, maps, is_used)
    if is_used:
        used = replace(_beside(second, first), wheels=wheels)
        return _Looked(calibrated.log, calibrated.mapper, used, 2)
    return _Looked(log, usual, replace(_beside(first, second), wheels=wheels), 2)


def _beside(used: SlamLog, other: SlamLog) -> SlamLog:
    """A pass that is used, with what another one took."""
    spent_s = other.online_cpu_s + other.finish_cpu_s + other.other_passes_cpu_s
    return replace(used, other_passes_cpu_s=used.other_passes_cpu_s + spent_s)


def mapped_once(
    log: Log,
    config: MapperConfig | None = None,
    *,
    known: SlamMap | None,
    start: SE2 | None = None,
    on_scan: OnScan | None = None,
    observer: LogObserver = NO_ONE,
) -> SlamLog:
    """One pass over a log."""
    mapper = (
        Mapper(log.T_base_laser, config)
        if known is None
        else Mapper.continued(known, log.T_base_laser, start, config)
    )
    started_s = time.thread_time()
    warm_up(is_continued=known is not None)
    warm_up_s = time.thread_time() - started_s
    with _left_alone():
        return replace(_driven(log, mapper, known, on_scan, observer), warm_up_cpu_s=warm_up_s)


@contextmanager
def _left_alone() -> Iterator[None]:
    """What was there before is no more looked through for garbage, in the middle of a scan: with
    all that was imported it took 0.13 s."""
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def _driven(
    log: Log,
    mapper: Mapper,
    known: SlamMap | None,
    on_scan: OnScan | None,
    observer: LogObserver,
) -> SlamLog:
    """The log through the mapper, record by record; its warm-up is not known here."""
    observer.begins(log)
    joined_at, index, slowest_s, watched_s = None, 0, 0.0, 0.0
    started_s, growth = time.thread_time(), MemoryGrowth()
    motion = MotionSinceScan(log.noise)
    times, told, scan_rows = array("d"), array("d"), array("q")
    for row, record in enumerate(log.records_in_time()):
        times.append(record.time_s)
        measurement = motion.add(record)
        told.extend(motion.T_odom_base.as_array())
        if measurement is None:
            continue
        update_s = time.thread_time()
        step = mapper.update(measurement)
        slowest_s = max(slowest_s, time.thread_time() - update_s)
        watched_from_s = time.thread_time()
        observer.mapped(measurement.shortened(mapper.config.range_offset_m), step, mapper)
        watched_s += time.thread_time() - watched_from_s
        scan_rows.append(row)
        if not step.is_joined:
            joined_at = None
        elif joined_at is None:
            joined_at = index + 1
        if on_scan is not None:
            on_scan(index, log.scan_count, step)
        index += 1
    online_s = time.thread_time() - started_s - watched_s
    slam_map = mapper.finish()
    times_s, odometry, rows = np.array(times), np.reshape(told, (-1, 3)), np.array(scan_rows)
    objections = _without_scans(times_s, odometry, rows)
    slam_map, memory_mb = slam_map.objected(objections), growth.most_mb()
    finish_s = time.thread_time() - started_s - online_s - watched_s
    of_scans = slam_map.trajectory_of(0 if known is None else known.session_count)
    trajectory = _of_records(log, times_s, odometry, rows, of_scans)
    is_joined = known is not None and known.session_count not in slam_map.unjoined
    return SlamLog(
        log.name, slam_map, trajectory, online_s, finish_s, slowest_s, 0.0, memory_mb,
        joined_at=joined_at if is_joined else None,
    )  # fmt: skip


def _without_scans(times_s: FloatArray, odometry: FloatArray, scan_rows: IntArray) -> list[str]:
    """In words, where the log begins or ends with a long way and no scans at all."""
    if len(scan_rows) == 0:
        return []
    said = []
    for part in (slice(0, scan_rows[0] + 1), slice(scan_rows[-1], None)):
        way_m = float(np.hypot(*np.diff(odometry[part, :2], axis=0).T).sum())
        if way_m > FrontEndConfig.blind_m[0]:
            said.append(told_by_wheels_alone(times_s[part][0], times_s[part][-1], way_m))
    return said


def _of_records(
    log: Log,
    times_s: np.ndarray,
    odometry: np.ndarray,
    scan_rows: np.ndarray,
    of_scans: Trajectory,
) -> Trajectory:
    """The pose of every record, by odometry between the scans; without, straight between them, and
    before the first or after the last as there."""
    if len(scan_rows) == 0:
        return of_scans
    # by their places in the log: stamps may go back
    places = _places(times_s, odometry, scan_rows)
    scans = Trajectory(places[scan_rows], of_scans.poses)
    told = Trajectory(places, odometry) if log.has_odometry else None
    first, last = places[scan_rows[0]], places[scan_rows[-1]]
    asked = places if log.has_odometry else np.clip(places, first, last)
    poses = PoseLookup(scans, told, max_gap_s=float(len(times_s))).at(asked)
    is_placed = np.isfinite(poses).all(axis=1)
    return Trajectory(times_s[is_placed], poses[is_placed])


def _places(times_s: np.ndarray, odometry: np.ndarray, scan_rows: np.ndarray) -> np.ndarray:
    """Where in the log each record stands, counted up. Records of one stamp and one pose of the wheels
    are one place, with one scan at most: what the scan corrects does not lie between them."""
    is_scan = np.isin(np.arange(len(times_s)), scan_rows)
    is_alike = (np.diff(times_s) == 0.0) & (np.diff(odometry, axis=0) == 0.0).all(axis=1)
    places, has_scan = np.zeros(len(times_s)), is_scan[0]
    for row in range(1, len(times_s)):
        is_same = is_alike[row - 1] and not (has_scan and is_scan[row])
        has_scan = is_scan[row] or (is_same and has_scan)
        places[row] = places[row - 1] + (not is_same)
    return places

"""A recorded log mapped: trajectory, map, pose graph, and how far all of it is to be believed."""

from __future__ import annotations

import gc
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.evaluation import Evaluation, evaluated, span
from experiments.memory import resident_mb
from experiments.observer import NO_ONE, LogObserver
from experiments.slam_wheels import calibrated_log, map_spread_m, wheels_line, wheels_summary
from slam.arrays import FloatArray
from slam.drive_monitor import told_by_wheels_alone
from slam.front_end import FrontEndConfig
from slam.keyframes import StepStatus
from slam.map_consistency import leaves_no_doubt
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper, MapperStep
from slam.metrics import read_relations
from slam.pose_lookup import PoseLookup
from slam.readers.log import Log, LogChoice, MotionSinceScan
from slam.readers.recognition import read_log
from slam.se2 import SE2
from slam.slam_map import SlamMap
from slam.slam_map_files import read_slam_map
from slam.trajectory import Trajectory, read_tum
from slam.warm_up import warm_up

OnScan = Callable[[int, int, MapperStep], None]


@dataclass(frozen=True)
class SlamLog:
    """What mapping a log gave.

    trajectory: of every record, odometry alone too. online_cpu_s, finish_cpu_s: processor time of all
    updates, the reading of the log among them, and of the end; slowest_update_cpu_s: of one scan;
    warm_up_cpu_s: of loading compiled code before the first. memory_mb: by which memory had grown
    with the last scan, None where the system does not tell.
    evaluation: against a reference, where there is one. continued: name of the map that the log's
    session continued, None: of none; joined_at: the scan with which it was joined, None: with none,
    but at the end, if at all.
    wheels: what calibrating them from the drive gave, where the log tells their ticks.
    is_odometry_doubted: whether odometry was taken for a guess alone, since the map by it as told did
    not hold together. notes: what of the log was taken, in words. used_pass: which pass over the log
    this is, from 0, where it was mapped more than once; other_passes_cpu_s: what the others took.
    """

    name: str
    slam_map: SlamMap
    trajectory: Trajectory
    online_cpu_s: float
    finish_cpu_s: float
    slowest_update_cpu_s: float
    warm_up_cpu_s: float
    memory_mb: float | None
    evaluation: Evaluation | None = None
    continued: str | None = None
    joined_at: int | None = None
    wheels: dict[str, Any] | None = None
    is_odometry_doubted: bool = False
    notes: tuple[str, ...] = ()
    used_pass: int = 0
    other_passes_cpu_s: float = 0.0

    @property
    def way_m(self) -> float:
        """Along the trajectory."""
        return float(np.hypot(*np.diff(self.trajectory.poses[:, :2], axis=0).T).sum())

    def summary(self) -> dict[str, Any]:
        """Plain numbers, for `summary.json`."""
        slam_map, verdict = self.slam_map, self.slam_map.verdict
        session = slam_map.session_count - 1
        steps = [step for step in slam_map.steps if step.session == session]
        counts = Counter(step.status.value for step in steps)
        return {
            "experiment": "slam",
            "log": self.name,
            "verdict": "good" if verdict.is_good else "failed",
            "reasons": list(verdict.reasons),
            "continued": self.continued,
            "joined_at": self.joined_at,
            "sessions": [self._session(number) for number in range(slam_map.session_count)],
            "scans": len(steps),
            **{status.value: counts[status.value] for status in StepStatus},
            "records": len(self.trajectory),
            "duration_s": float(np.ptp(self.trajectory.times_s)),
            "way_m": self.way_m,
            "keyframes": len(slam_map.keyframes),
            "loops": len(slam_map.loops),
            "loops_rejected": len(slam_map.rejected),
            "contradicted": verdict.passed_ratio,
            "drift_m": slam_map.drift_m if math.isfinite(slam_map.drift_m) else None,
            "cpu_s": {
                "online": self.online_cpu_s,
                "finish": self.finish_cpu_s,
                "slowest_update": self.slowest_update_cpu_s,
                "warm_up": self.warm_up_cpu_s,
                "other_passes": self.other_passes_cpu_s,
            },
            "memory_mb": self.memory_mb,
            "wheels": self.wheels,
            "odometry_doubted": self.is_odometry_doubted,
            "evaluation": None if self.evaluation is None else self.evaluation.summary(),
        }

    def _session(self, number: int) -> dict[str, Any]:
        """A session of the map, from 0."""
        times_s = self.slam_map.trajectory_of(number).times_s
        return {
            "scans": len(times_s),
            "from_s": float(times_s[0]) if len(times_s) else None,
            "to_s": float(times_s[-1]) if len(times_s) else None,
            "joined": number not in self.slam_map.unjoined,
        }


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
    against = None if reference is None else read_tum(reference)
    related = None if relations is None else read_relations(relations)
    known = None if map_path is None else read_slam_map(map_path)
    if known is not None and start is not None:
        _check_start(known, start)
    mapped = partial(_mapped, known=known, start=start, on_scan=on_scan, observer=observer)
    log = read_log(log_path, choice)
    log.check_sees()
    if against is not None and reference is not None:
        check_same_time(log, against.times_s, reference)
    if related is not None and relations is not None:
        check_same_time(log, related.times_s.ravel(), relations)
    result = _best_mapped(log, mapped)
    result = replace(result, notes=(*log.notes, *result.notes))
    if map_path is not None:
        result = replace(result, continued=map_path.name)
    if against is None and related is None:
        return result
    name = None if relations is None else relations.name
    evaluation = evaluated(result.trajectory, against, related, relations_of=name)
    return replace(result, evaluation=evaluation)


def default_mapped(log: Log, known: SlamMap | None = None) -> SlamLog:
    """A log as `run` maps it when nothing else is told, as one more session of a map if one is given."""
    return _best_mapped(log, partial(_mapped, known=known))


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
    if reach_m < off_m < math.inf:
        raise ValueError(
            f"--start {start.x:g} {start.y:g} lies {off_m:.0f} m off the map, whose scans reach"
            f" {reach_m:.0f} m: give a pose on it, or none to have it searched for"
        )


def check_same_time(log: Log, times_s: FloatArray, path: Path) -> None:
    """Raises ValueError where nothing of a reference is of the log's time."""
    stamps_s = np.array([record.time_s for record in log.records])
    if not ((times_s >= stamps_s.min()) & (times_s <= stamps_s.max())).any():
        raise ValueError(
            f"{path.name} is of {span(times_s)} s, and {log.name} of {span(stamps_s)} s: is it that"
            " of another log?"
        )


def _best_mapped(log: Log, mapped: Callable[..., SlamLog]) -> SlamLog:
    """The log mapped; where that does not hold together, once more with its odometry as a guess from
    which scans are matched, and no more. That map is judged more strictly, and by what its scans say
    against odometry too. Whoever interrupts the second look gets what came of the first."""
    first, passes, log, config = _by_best_wheels(log, mapped)
    slam_map = first.slam_map
    if slam_map.verdict.is_good or slam_map.unjoined or not log.has_odometry:
        return first  # a session is not joined by other odometry
    try:
        again = mapped(log, replace(config, is_odometry_doubted=True))
    except KeyboardInterrupt:
        said = "interrupted while the log was mapped once more: this is the first map"
        return replace(first, notes=(said,))
    if not leaves_no_doubt(again.slam_map.verdict):
        return _beside(first, again)
    again = replace(again, used_pass=passes, wheels=first.wheels, is_odometry_doubted=True)
    return _beside(again, first)


def _by_best_wheels(
    log: Log, mapped: Callable[..., SlamLog]
) -> tuple[SlamLog, int, Log, MapperConfig]:
    """The log mapped, in how many passes, and what it was mapped from. Where it tells ticks, twice: by
    the wheels as assumed, and as the drive shows them. The map is that which holds together, and of
    two that do, the sharper one."""
    usual = MapperConfig()
    first, calibrated = mapped(log, usual), calibrated_log(log)
    if calibrated is None:
        return first, 1, log, usual
    second = replace(mapped(calibrated.log, calibrated.mapper), used_pass=1)
    maps = first.slam_map, second.slam_map
    doubts = [(not one.verdict.is_good, map_spread_m(one) or math.inf) for one in maps]
    is_used = calibrated.is_sharper and doubts[1] < doubts[0]
    wheels = wheels_summary(calibrated, maps, is_used)
    if is_used:
        used = replace(_beside(second, first), wheels=wheels)
        return used, 2, calibrated.log, calibrated.mapper
    return replace(_beside(first, second), wheels=wheels), 2, log, usual


def _beside(used: SlamLog, other: SlamLog) -> SlamLog:
    """A pass that is used, with what another one took."""
    spent_s = other.online_cpu_s + other.finish_cpu_s + other.other_passes_cpu_s
    return replace(used, other_passes_cpu_s=used.other_passes_cpu_s + spent_s)


def _mapped(
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
    started_s, before_mb = time.thread_time(), resident_mb()
    motion = MotionSinceScan(log.noise)
    times_s, odometry, scan_rows = [], [], []
    for row, record in enumerate(log.records):
        times_s.append(record.time_s)
        odometry.append(record.T_odom_base.as_array())
        measurement = motion.add(record)
        if measurement is None:
            continue
        update_s = time.thread_time()
        step = mapper.update(measurement)
        slowest_s = max(slowest_s, time.thread_time() - update_s)
        watched_from_s = time.thread_time()
        observer.mapped(measurement, step, mapper)
        watched_s += time.thread_time() - watched_from_s
        scan_rows.append(row)
        if not step.is_joined:
            joined_at = None
        elif joined_at is None:
            joined_at = index
        if on_scan is not None:
            on_scan(index, log.scan_count, step)
        index += 1
    online_s = time.thread_time() - started_s - watched_s
    after_mb = resident_mb()
    memory_mb = None if before_mb is None or after_mb is None else after_mb - before_mb
    slam_map = mapper.finish()
    objections = _without_scans(np.array(times_s), np.array(odometry), scan_rows)
    slam_map = replace(slam_map, verdict=slam_map.verdict.with_reasons(objections))
    finish_s = time.thread_time() - started_s - online_s - watched_s
    of_scans = slam_map.trajectory_of(0 if known is None else known.session_count)
    trajectory = _of_records(
        log, np.array(times_s), np.array(odometry), np.array(scan_rows), of_scans
    )
    is_joined = known is not None and known.session_count not in slam_map.unjoined
    return SlamLog(
        log.name, slam_map, trajectory, online_s, finish_s, slowest_s, 0.0, memory_mb,
        joined_at=joined_at if is_joined else None,
    )  # fmt: skip


def _without_scans(times_s: FloatArray, odometry: FloatArray, scan_rows: list[int]) -> list[str]:
    """In words, where the log begins or ends with a long way and no scans at all."""
    if not scan_rows:
        return []
    said = []
    for part in (slice(0, scan_rows[0] + 1), slice(scan_rows[-1], None)):
        way_m = float(np.hypot(*np.diff(odometry[part, :2], axis=0).T).sum())
        if way_m > FrontEndConfig.most_blind_m:
            said.append(told_by_wheels_alone(times_s[part][0], times_s[part][-1], way_m))
    return said


def _of_records(
    log: Log,
    times_s: np.ndarray,
    odometry: np.ndarray,
    scan_rows: np.ndarray,
    of_scans: Trajectory,
) -> Trajectory:
    """The pose of every record; of scans alone without odometry."""
    if not log.has_odometry:
        return of_scans
    # by the rows of the log: stamps may go back
    rows = np.arange(len(times_s), dtype=np.float64)
    lookup = PoseLookup(
        Trajectory(scan_rows.astype(np.float64), of_scans.poses), Trajectory(rows, odometry),
        max_gap_s=float(len(times_s)),
    )  # fmt: skip
    poses = lookup.at(rows)
    is_placed = np.isfinite(poses).all(axis=1)
    return Trajectory(times_s[is_placed], poses[is_placed])


def _mb(memory_mb: float | None) -> str:
    return "an unknown amount" if memory_mb is None else f"{memory_mb:.0f} MB"


def _said_of_map(summary: dict[str, Any]) -> list[str]:
    """What is wrong with a map; of a good one, how far it may have drifted."""
    drift_m = summary["drift_m"]
    if summary["reasons"] or drift_m is None:
        return list(summary["reasons"])
    return [f"by its own account poses are off by some {drift_m:.2f} m (RMS)"]


def table(summary: dict[str, Any]) -> str:
    """The summary for people to read."""
    cpu = summary["cpu_s"]
    lines = [
        f"{summary['log']}: {summary['scans']} scans, {summary['way_m']:.0f} m in"
        f" {summary['duration_s']:.0f} s; {summary['keyframes']} keyframes, {summary['loops']} loops"
        f" ({summary['loops_rejected']} rejected)",
        f"map: {summary['verdict']}" + "".join(f"; {said}" for said in _said_of_map(summary)),
        f"scans: {summary['matched']} matched, {summary['searched']} found by search,"
        f" {summary['carried']} by the wheels alone, {summary['broken']} broke off",
        f"CPU: {cpu['online']:.1f} s online ({1000 * cpu['slowest_update']:.0f} ms at most for a"
        f" scan), {cpu['finish']:.1f} s to finish; memory grew by {_mb(summary['memory_mb'])}",
    ]
    if summary["continued"] is not None:
        number, at = len(summary["sessions"]), summary["joined_at"]
        if not summary["sessions"][-1]["joined"]:
            joined = "never joined"
        elif at is None:
            joined = "joined at its end"
        else:
            joined = f"joined at scan {at + 1} of {summary['scans']}"
        lines.insert(1, f"session {number}, on {summary['continued']}: {joined}")
    if cpu["other_passes"] > 0.0:
        lines[-1] += f"; {cpu['other_passes']:.1f} s for another pass over the log"
    if summary["odometry_doubted"]:
        lines.append(
            "odometry: a guess alone; by it as the log tells it, the map did not hold together"
        )
    if summary["wheels"] is not None:
        lines.append(wheels_line(summary["wheels"]))
    return "\n".join(lines)

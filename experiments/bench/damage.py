"""`kitasap bench damage LOG`: damaged logs end in a right map, or in one that is called failed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.table import Table

from experiments.bench.map_end import MOST_M, MOST_RMSE_M, MapEnd, table_of
from experiments.evaluation import evaluated
from experiments.progress import CountProgress
from experiments.slam_log import check_same_time, default_mapped
from experiments.tables import wide_console
from slam.measurements import LaserScan
from slam.readers.log import Log, LogRecord, LogRecords
from slam.readers.log_odometry import unknown_motion
from slam.readers.recognition import read_log
from slam.se2 import SE2
from slam.trajectory import Trajectory, read_tum

_LOST = 1.0 / 3.0
_FROZEN_S = 10.0
_INNER = (0.1, 0.9)
"""Where in the log something happens that happens once."""
_WRONG_STEP, _WRONG_TURN = 1.15, 0.8
"""Chosen: wheels so bad that odometry alone is metres off within a room."""

Damage = Callable[[Log, np.random.Generator], Log]


def print_benchmark(log_path: Path, reference: Path, repeats: int, seed: int) -> bool:
    """Damages, maps and prints the table; whether no wrong map was called good.

    Raises ValueError for files that are not what they should be, or too short to be damaged.
    """
    against, log = read_tum(reference), read_log(log_path)
    log.check_sees()
    check_same_time(log, against.times_s, reference)
    if log.scan_count < 1.0 / (_INNER[1] - _INNER[0]):
        raise ValueError(f"{log_path}: {log.scan_count} scans are too few to damage some of them")
    found = measured(log, against, repeats, seed)
    wide_console().print(_table(log.name, found, repeats, seed))
    return not any(one.is_deceptive for one in found)


def measured(log: Log, against: Trajectory, repeats: int, seed: int) -> list[MapEnd]:
    """Each damage, drawn anew in each repeat; the log as it is first."""
    found = [_ended(log, against, "none")]
    with CountProgress("damage", len(DAMAGES) * repeats) as progress:
        for children in np.random.SeedSequence(seed).spawn(repeats):
            seeds = children.spawn(len(DAMAGES))
            for (name, damage), own in zip(DAMAGES.items(), seeds, strict=True):
                found.append(_ended(damage(log, np.random.default_rng(own)), against, name))
                progress.update(len(found) - 1, name)
    return found


def _ended(log: Log, against: Trajectory, damage: str) -> MapEnd:
    """How the log is mapped, by the one set of parameters."""
    slam_map = default_mapped(log).slam_map
    absolute = evaluated(slam_map.trajectory, against).absolute
    assert absolute is not None
    return MapEnd.judged(damage, slam_map, absolute.position_m, MOST_RMSE_M, MOST_M)


def _with_records(log: Log, changed: Callable[[Iterable[LogRecord]], Iterator[LogRecord]]) -> Log:
    """The log, each record changed while it is read."""
    return replace(log, records=LogRecords(len(log.records), lambda: changed(log.records)))


def _with_scans(log: Log, changed: Callable[[int, LaserScan], LaserScan | None]) -> Log:
    """The log, each scan changed, by its number; None takes it away."""

    def records(of: Iterable[LogRecord]) -> Iterator[LogRecord]:
        index = 0
        for record in of:
            if record.scan is None:
                yield record
                continue
            yield replace(record, scan=changed(index, record.scan))
            index += 1

    return _with_records(log, records)


def _some_scans_lost(log: Log, rng: np.random.Generator) -> Log:
    is_lost = rng.permutation(log.scan_count) < _LOST * log.scan_count
    kept = _with_scans(log, lambda index, scan: None if is_lost[index] else scan)
    return replace(kept, scan_count=int((~is_lost).sum()))


def _block_lost(log: Log, rng: np.random.Generator) -> Log:
    count = int(_LOST * log.scan_count)
    first = int(rng.integers(log.scan_count - count + 1))
    lost = range(first, first + count)
    kept = _with_scans(log, lambda index, scan: None if index in lost else scan)
    return replace(kept, scan_count=log.scan_count - count)


def _records_lost(log: Log, rng: np.random.Generator) -> Log:
    """Odometry too: it counts on after the gap."""
    rows = [row for row, record in enumerate(log.records) if record.scan is not None]
    lost = int(_LOST * log.scan_count)
    first = int(rng.integers(log.scan_count - lost + 1))
    start, stop = rows[first], rows[first + lost - 1] + 1

    def records(of: Iterable[LogRecord]) -> Iterator[LogRecord]:
        return (record for row, record in enumerate(of) if not start <= row < stop)

    kept = replace(_with_records(log, records), scan_count=log.scan_count - lost)
    return replace(kept, records=replace(kept.records, count=len(log.records) - (stop - start)))


def _turned(log: Log, rng: np.random.Generator) -> Log:
    """The robot's heading by odometry jumps once."""
    turn = SE2(0.0, 0.0, math.copysign(math.pi / 2.0, rng.uniform(-1.0, 1.0)))
    row = _inner(len(log.records), rng)

    def records(of: Iterable[LogRecord]) -> Iterator[LogRecord]:
        T_jump = SE2.identity()
        for index, record in enumerate(of):
            if index == row:
                T_jump = record.T_odom_base @ turn @ record.T_odom_base.inverse()
            yield replace(record, T_odom_base=T_jump @ record.T_odom_base)

    return _with_records(log, records)


def _frozen(log: Log, rng: np.random.Generator) -> Log:
    """A scan stands for those of the next seconds, with their stamps."""
    first = _inner(log.scan_count, rng)
    held: list[LaserScan] = []

    def changed(index: int, scan: LaserScan) -> LaserScan:
        if index == first:
            held[:] = [scan]
        if index < first or scan.time_s > held[0].time_s + _FROZEN_S:
            return scan
        return replace(scan, ranges_m=held[0].ranges_m)

    return _with_scans(log, changed)


def _beams_lost(log: Log, rng: np.random.Generator) -> Log:
    seed = int(rng.integers(2**63))

    def changed(index: int, scan: LaserScan) -> LaserScan:
        is_lost = np.random.default_rng([seed, index]).random(len(scan.ranges_m)) < _LOST
        return replace(scan, ranges_m=np.where(is_lost, np.nan, scan.ranges_m))

    return _with_scans(log, changed)


def _wrong_wheels(log: Log, rng: np.random.Generator) -> Log:
    """Each step longer or shorter than it is, each turn too, from the first to the last."""
    longer, wider = (rng.permutation([one, 1.0 / one])[0] for one in (_WRONG_STEP, _WRONG_TURN))

    def records(of: Iterable[LogRecord]) -> Iterator[LogRecord]:
        T_last, T_odom = None, SE2.identity()
        for record in of:
            if T_last is not None:
                step = T_last.inverse() @ record.T_odom_base
                T_odom = T_odom @ SE2(longer * step.x, longer * step.y, wider * step.theta)
            T_last = record.T_odom_base
            yield replace(record, T_odom_base=T_odom)

    return _with_records(log, records)


def _no_wheels(log: Log, _: np.random.Generator) -> Log:
    alone = _with_records(log, _scans_alone)
    alone = replace(alone, records=replace(alone.records, count=log.scan_count))
    return replace(alone, noise=unknown_motion, has_odometry=False)


def _scans_alone(records: Iterable[LogRecord]) -> Iterator[LogRecord]:
    for record in records:
        if record.scan is not None:
            yield replace(record, T_odom_base=SE2.identity())


def _inner(count: int, rng: np.random.Generator) -> int:
    low, high = (int(share * count) for share in _INNER)
    return int(rng.integers(low, high))


DAMAGES: dict[str, Damage] = {
    "a third of the scans lost, here and there": _some_scans_lost,
    "a third of the scans lost, in one piece": _block_lost,
    "a third of the records lost, in one piece": _records_lost,
    "odometry jumps by 90 degrees": _turned,
    f"laser frozen for {_FROZEN_S:g} s": _frozen,
    "a third of the beams lost": _beams_lost,
    "wheels 15 % wrong along, 20 % in turns": _wrong_wheels,
    "no wheels": _no_wheels,
}


def _table(name: str, found: list[MapEnd], repeats: int, seed: int) -> Table:
    return table_of(
        found,
        "damage",
        f"{name} damaged, each way {repeats} times, seed {seed}",
        f"Position error of the scans against the reference; right: at most {MOST_RMSE_M:g} m"
        f" (RMS) and below {MOST_M:g} m.",
    )

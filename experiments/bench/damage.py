"""`kitasap bench damage LOG`: damaged logs end in a right map, or in one that is called failed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.bench.changed_logs import Case, print_ends, read_referenced
from experiments.bench.log_changes import (
    Change,
    keeping,
    with_records,
    with_scans,
    with_wheels,
    without_wheels,
)  # fmt: skip
from slam.measurements import LaserScan
from slam.readers.log import Log
from slam.readers.log_record import LogRecord
from slam.se2 import SE2

_LOST = 1.0 / 3.0
_FROZEN_S = 10.0
_LATE_S, _LATE_EVERY_S = 2.5, 30.0
_INNER = (0.1, 0.9)
"""Where in the log something happens that happens once."""
_WRONG_STEP, _WRONG_TURN = 1.15, 0.8
"""Chosen: wheels so bad that odometry alone is metres off within a room."""
_RANGES_OFF_M = 0.1
"""Chosen: what a laser's zero is off by if it is told wrong, and enough to bend a map."""
_PUT_RIGHT_EVERY_S = 15.0
_PUT_RIGHT_BY = np.array([0.3, 0.3, 0.1])
"""Standard deviations (m, m, rad) of the jumps of a localizer that is no better than that. Chosen."""


def print_benchmark(log_path: Path, reference: Path, repeats: int, seed: int) -> bool:
    """Damages, maps and prints the table; whether no wrong map was called good.

    Raises ValueError for files that are not what they should be, or too short to be damaged.
    """
    log, against = read_referenced(log_path, reference)
    check_length(log_path, log.scan_count)
    cases = [Case(of, change, against) for of, change in DAMAGES.items()]
    title = f"{log.name} damaged, each way {repeats} times, seed {seed}"
    return print_ends(log, against, cases, repeats, seed, "damage", title)


def check_length(path: Path, scans: int) -> None:
    """Raises ValueError for too few scans to damage some of them."""
    if scans < 1.0 / (_INNER[1] - _INNER[0]):
        raise ValueError(f"{path}: {scans} scans are too few to damage some of them")


def _some_scans_lost(log: Log, rng: np.random.Generator) -> Log:
    return keeping(log, rng.permutation(log.scan_count) >= _LOST * log.scan_count)


def _block_lost(log: Log, rng: np.random.Generator) -> Log:
    count = int(_LOST * log.scan_count)
    first = int(rng.integers(log.scan_count - count + 1))
    scans = np.arange(log.scan_count)
    return keeping(log, (scans < first) | (scans >= first + count))


def _records_lost(log: Log, rng: np.random.Generator) -> Log:
    """Odometry too: it counts on after the gap."""
    rows = [row for row, record in enumerate(log.records) if record.scan is not None]
    lost = int(_LOST * log.scan_count)
    first = int(rng.integers(log.scan_count - lost + 1))
    start, stop = rows[first], rows[first + lost - 1] + 1

    def records(of: Iterable[LogRecord]) -> Iterator[LogRecord]:
        return (record for row, record in enumerate(of) if not start <= row < stop)

    kept = replace(with_records(log, records), scan_count=log.scan_count - lost)
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

    return with_records(log, records)


def _heading_turned(log: Log, rng: np.random.Generator) -> Log:
    """The headings alone of the odometry jump: from then on it seems to drive sideways."""
    turn_rad = math.copysign(math.pi / 2.0, rng.uniform(-1.0, 1.0))
    row = _inner(len(log.records), rng)

    def records(of: Iterable[LogRecord]) -> Iterator[LogRecord]:
        for index, record in enumerate(of):
            T = record.T_odom_base
            turned = SE2(T.x, T.y, T.theta + turn_rad)
            yield record if index < row else replace(record, T_odom_base=turned)

    return with_records(log, records)


def _stuck(log: Log, rng: np.random.Generator) -> Log:
    """Odometry that tells nothing for a while, and then of what comes after it."""
    row = _inner(len(log.records), rng)

    def records(of: Iterable[LogRecord]) -> Iterator[LogRecord]:
        held, T_held = None, SE2.identity()
        for index, record in enumerate(of):
            if index == row:
                held = record
            if held is not None and record.time_s <= held.time_s + _FROZEN_S:
                T_held = held.T_odom_base @ record.T_odom_base.inverse()
            yield replace(record, T_odom_base=T_held @ record.T_odom_base)

    return with_records(log, records)


def _told_late(log: Log, rng: np.random.Generator) -> Log:
    """Odometry that stands for some seconds, again and again, and then tells of all of the way at once."""
    seed = int(rng.integers(2**63))

    def records(of: Iterable[LogRecord]) -> Iterator[LogRecord]:
        drawn = np.random.default_rng(seed)
        begins_s, held = math.nan, None
        for record in of:
            if math.isnan(begins_s):
                begins_s = record.time_s + drawn.uniform(0.0, _LATE_EVERY_S)
            if held is None and record.time_s >= begins_s:
                held = record
            if held is not None and record.time_s > held.time_s + _LATE_S:
                held, begins_s = None, record.time_s + drawn.uniform(0.5, 1.5) * _LATE_EVERY_S
            yield record if held is None else replace(record, T_odom_base=held.T_odom_base)

    return with_records(log, records)


def _lost_turned_and_frozen(log: Log, rng: np.random.Generator) -> Log:
    return _frozen(_turned(_some_scans_lost(log, rng), rng), rng)


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

    return with_scans(log, changed)


def _beams_lost(log: Log, rng: np.random.Generator) -> Log:
    seed = int(rng.integers(2**63))

    def changed(index: int, scan: LaserScan) -> LaserScan:
        is_lost = np.random.default_rng([seed, index]).random(len(scan.ranges_m)) < _LOST
        return replace(scan, ranges_m=np.where(is_lost, np.nan, scan.ranges_m))

    return with_scans(log, changed)


def _wrong_wheels(log: Log, rng: np.random.Generator) -> Log:
    """Each step longer or shorter than it is, each turn too, from the first to the last."""
    longer, wider = (rng.permutation([one, 1.0 / one])[0] for one in (_WRONG_STEP, _WRONG_TURN))
    return with_wheels(log, lambda step: SE2(longer * step.x, longer * step.y, wider * step.theta))


def _ranges_off(log: Log, rng: np.random.Generator) -> Log:
    """All ranges too long, or too short, by the same."""
    offset_m = math.copysign(_RANGES_OFF_M, rng.uniform(-1.0, 1.0))
    return with_scans(log, lambda _, scan: scan.shortened(-offset_m))


def _by_localizer(log: Log, rng: np.random.Generator) -> Log:
    """What is called odometry is where a localizer has the robot: it jumps whenever that is put right."""
    seed = int(rng.integers(2**63))

    def records(of: Iterable[LogRecord]) -> Iterator[LogRecord]:
        drawn = np.random.default_rng(seed)
        T_put_right, next_s = SE2.identity(), math.nan
        for record in of:
            if math.isnan(next_s):
                next_s = record.time_s + _PUT_RIGHT_EVERY_S
            if record.time_s > next_s:
                T, jump = record.T_odom_base, SE2(*(_PUT_RIGHT_BY * drawn.normal(size=3)))
                T_put_right = T_put_right @ T @ jump @ T.inverse()
                next_s = record.time_s + drawn.uniform(0.5, 1.5) * _PUT_RIGHT_EVERY_S
            yield replace(record, T_odom_base=T_put_right @ record.T_odom_base)

    return with_records(log, records)


def _inner(count: int, rng: np.random.Generator) -> int:
    low, high = (int(share * count) for share in _INNER)
    return int(rng.integers(low, high))


DAMAGES: dict[str, Change] = {
    "a third of the scans lost, here and there": _some_scans_lost,
    "a third of the scans lost, in one piece": _block_lost,
    "a third of the records lost, in one piece": _records_lost,
    "odometry jumps by 90 degrees": _turned,
    f"laser frozen for {_FROZEN_S:g} s": _frozen,
    "a third of the beams lost": _beams_lost,
    "wheels 15 % wrong along, 20 % in turns": _wrong_wheels,
    "no wheels": without_wheels,
    "headings alone jump by a right angle": _heading_turned,
    f"odometry stuck for {_FROZEN_S:g} s": _stuck,
    "a third of the scans lost, a jump and a laser that freezes": _lost_turned_and_frozen,
    f"odometry told late by {_LATE_S:g} s, twice a minute": _told_late,
    f"all ranges {_RANGES_OFF_M:g} m too long, or too short": _ranges_off,
    "a localizer's pose as odometry": _by_localizer,
}

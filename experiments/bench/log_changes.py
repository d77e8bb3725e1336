"""A recorded log changed: as a damaged one, or as another robot would have recorded it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import reduce

import numpy as np

from slam.arrays import BoolArray
from slam.measurements import LaserScan
from slam.readers.log import Log, LogRecords
from slam.readers.log_odometry import unknown_motion
from slam.readers.log_record import LogRecord
from slam.se2 import SE2

Change = Callable[[Log, np.random.Generator], Log]


def in_turn(*changes: Change) -> Change:
    """One change after the other."""
    return lambda log, rng: reduce(lambda so_far, change: change(so_far, rng), changes, log)


def with_records(log: Log, changed: Callable[[Iterable[LogRecord]], Iterator[LogRecord]]) -> Log:
    """The log, each record changed while it is read."""
    return replace(log, records=LogRecords(len(log.records), lambda: changed(log.records)))


def with_scans(log: Log, changed: Callable[[int, LaserScan], LaserScan | None]) -> Log:
    """The log, each scan changed, by its number; None takes it away."""

    def records(of: Iterable[LogRecord]) -> Iterator[LogRecord]:
        index = 0
        for record in of:
            if record.scan is None:
                yield record
                continue
            yield replace(record, scan=changed(index, record.scan))
            index += 1

    return with_records(log, records)


def keeping(log: Log, is_kept: BoolArray) -> Log:
    """The log with some of its scans alone, (scan_count,) True; its odometry stays."""
    kept = with_scans(log, lambda index, scan: scan if is_kept[index] else None)
    return replace(kept, scan_count=int(is_kept.sum()))


def with_wheels(log: Log, told: Callable[[SE2], SE2]) -> Log:
    """The log with wheels that tell something else of each step."""

    def records(of: Iterable[LogRecord]) -> Iterator[LogRecord]:
        T_last, T_odom = None, SE2.identity()
        for record in of:
            if T_last is not None:
                T_odom = T_odom @ told(T_last.inverse() @ record.T_odom_base)
            T_last = record.T_odom_base
            yield replace(record, T_odom_base=T_odom)

    return with_records(log, records)


def without_wheels(log: Log, _: np.random.Generator) -> Log:
    """The log with its scans alone."""
    alone = with_records(log, _scans_alone)
    alone = replace(alone, records=replace(alone.records, count=log.scan_count))
    return replace(alone, noise=unknown_motion, has_odometry=False)


def _scans_alone(records: Iterable[LogRecord]) -> Iterator[LogRecord]:
    for record in records:
        if record.scan is not None:
            yield replace(record, T_odom_base=SE2.identity())

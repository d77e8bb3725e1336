"""Beams that see the robot itself: posts, a wheel, a cable. Taken for walls, they come along with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.readers.log_record import LogRecord

_NEAR_M = 1.0
"""Farther, a robot has no parts in its laser's plane."""
_SAME_M = 0.03
_SAME_SHARE = 0.97
"""Of the scans looked at, in which a beam sees what it usually sees."""
_OTHER_M, _OTHER_SHARE = 0.3, 0.5
"""So many beams see another range than in the scan looked at before: the robot is elsewhere."""
_FIRST, _FEWEST = 15, 30
"""Scans whose median is what a beam usually sees, and such as must be looked at in all."""
_BESIDE, _GOES_ON_M = 1, 0.1
"""Beams beside a part that see its edge; what lies beyond them is at least so much nearer or farther.

Chosen, all of these."""


class OwnPartsSearch:
    """Takes the scans of a log one by one, and tells which beams see the same near by all along.

    A robot that keeps to a wall sees that at the same range for as long; but a wall goes on beyond the
    beams that see the same.
    """

    def __init__(self) -> None:
        self._last_m: FloatArray | None = None
        self._first: list[FloatArray] = []
        self._usual_m: FloatArray = np.zeros(0)
        self._same: IntArray = np.zeros(0, dtype=np.int64)
        self._count = 0
        self._has_changed = False

    def add(self, ranges_m: FloatArray) -> None:
        """One scan more, as `LaserScan` has it."""
        if self._last_m is not None and len(self._last_m) != len(ranges_m):
            self._has_changed = True
        if self._has_changed or not self._is_elsewhere(ranges_m):
            return
        self._last_m = ranges_m.copy()
        if len(self._first) < _FIRST:
            self._first.append(self._last_m)
            if len(self._first) == _FIRST:
                self._usual_m = np.median(np.nan_to_num(np.array(self._first), nan=np.inf), axis=0)
                self._same = np.sum([self._is_same(one) for one in self._first], axis=0)
        else:
            self._same += self._is_same(ranges_m)
        self._count += 1

    def _is_elsewhere(self, ranges_m: FloatArray) -> bool:
        """Whether another place is seen than in the scan looked at last."""
        if self._last_m is None:
            return True
        is_seen = np.isfinite(ranges_m) & np.isfinite(self._last_m)
        with np.errstate(invalid="ignore"):
            is_other = np.abs(ranges_m - self._last_m) > _OTHER_M
        others = int(np.count_nonzero(is_other & is_seen))
        return others > _OTHER_SHARE * int(np.count_nonzero(is_seen))

    def _is_same(self, ranges_m: FloatArray) -> IntArray:
        with np.errstate(invalid="ignore"):
            return (np.abs(ranges_m - self._usual_m) < _SAME_M).astype(np.int64)

    @property
    def is_own(self) -> BoolArray:
        """(N,) the beams that see the robot itself; of a log too short to tell, none."""
        if self._has_changed or self._count < _FEWEST:
            return np.zeros(0, dtype=np.bool_)
        is_same = self._same >= _SAME_SHARE * self._count
        is_own = np.zeros(len(is_same), dtype=np.bool_)
        ends = np.flatnonzero(np.diff(np.concatenate([[False], is_same, [False]]).astype(np.int8)))
        for first, end in ends.reshape(-1, 2):
            is_near = self._usual_m[first:end].max() <= _NEAR_M
            if is_near and not (self._goes_on(first, -1) or self._goes_on(end - 1, 1)):
                is_own[max(first - _BESIDE, 0) : end + _BESIDE] = True
        return is_own

    def _goes_on(self, last: int, sign: int) -> bool:
        """Whether what a beam sees is seen beyond its neighbours as well."""
        beyond = last + sign * (_BESIDE + 1)
        if not 0 <= beyond < len(self._usual_m):
            return False
        return bool(abs(self._usual_m[beyond] - self._usual_m[last]) < _GOES_ON_M)


def own_parts_said(is_own: BoolArray) -> tuple[str, ...]:
    """In words, that beams were left out; none where none was."""
    count = int(np.count_nonzero(is_own))
    if not count:
        return ()
    return (
        f"{count} of {len(is_own)} beams see the same within {_NEAR_M:g} m wherever the robot is, a"
        " part of it: they are left out",
    )


def without_own_parts(
    read: Callable[[], Iterator[LogRecord]], is_own: BoolArray
) -> Callable[[], Iterator[LogRecord]]:
    """The same records, in whose scans nothing is known of beams (N,) that see the robot itself."""
    return partial(_without, read, is_own) if is_own.any() else read


def _without(read: Callable[[], Iterator[LogRecord]], is_own: BoolArray) -> Iterator[LogRecord]:
    for record in read():
        scan = record.scan
        if scan is not None:
            scan = replace(scan, ranges_m=np.where(is_own, np.nan, scan.ranges_m))
        yield replace(record, scan=scan)

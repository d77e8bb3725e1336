"""The range that a laser writes where nothing came back, told by the log itself.

Most lasers write their maximum then, always the same: 81.91 m, 8.19 m, 5.60 m. Taken for walls, such
beams make arcs that come along with the robot. A wall is as far as that from few places only: the
code is the largest range there is, and seen from many.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from slam.arrays import FloatArray, IntArray, run_lengths

NO_RETURN_SHARE = 0.9985
"""Of a sensor's maximum: SICK units say 81.83 to 81.91 of 81.92 m, 8.183 of 8.192 m for no return or
a blinded beam."""

_CELLS_PER_M, _CELLS = 100, 10_001
"""Ranges are counted by the centimetre, those beyond 100 m together."""
_FEWEST_BESIDE = 3
"""Neighbouring beams that a pile takes; chosen: along a corridor the farthest beam of either side may
see the same range for metres, but it alone."""
_BELOW_M = 0.5
"""So far below a pile fewer beams end than in it; chosen: a round wall has more just below."""
_ELSEWHERE_M = 0.3
"""Piles seen from nearer by are one; chosen: a wall gets nearer by as much."""
_WIDE_RAD = math.radians(20.0)
"""Of a pile that no wall makes, from wherever it is seen. A flat wall is within 0.15 % of its nearest
range over 6 degrees; the widest of 8,800 scans of real logs had 7."""
_FEWEST_SEEN = 5
"""Piles at a range that make it a code. Chosen: any 100 scans of logs cut at 2 to 8 m had as many, if
two beams a scan were cut; in all of a log whose laser sees farther, no range had more than 2."""
_MOST_BEYOND = 0.01
"""Beams beyond the code, of those at it; chosen: a faulty line does not hide it."""


@dataclass
class _Piles:
    """What was seen of one range: how often, the least of its piles [m], from where the last."""

    count: int
    least_m: float
    last: tuple[float, float] | None


@dataclass
class NoReturnSearch:
    """Takes the scans of a log one by one, keeps none, and tells the code if there is one."""

    _cells: IntArray = field(default_factory=lambda: np.zeros(_CELLS, dtype=np.int64))
    _piles: dict[int, _Piles] = field(default_factory=dict)
    _least_m: float = math.inf

    def add(
        self, ranges_m: FloatArray, step_rad: float, position: tuple[float, float] | None
    ) -> None:
        """One scan more: ranges (N,) step_rad apart, as `LaserScan` has them, from a position [m] by
        odometry, None where it is not known."""
        seen_m = ranges_m[np.isfinite(ranges_m)]
        if len(seen_m) == 0:
            return
        self._cells += np.bincount(_cells_of(seen_m), minlength=_CELLS)
        self._least_m = min(self._least_m, float(seen_m.min()))
        top_m = float(seen_m.max())
        is_top = np.isfinite(ranges_m) & (ranges_m >= NO_RETURN_SHARE * top_m)
        # of those within half a metre, the pile itself among them
        if 2 * np.count_nonzero(is_top) <= np.count_nonzero(seen_m >= top_m - _BELOW_M):
            return
        beside = int(run_lengths(is_top).max(initial=0))
        if beside >= _FEWEST_BESIDE:
            self._note(top_m, beside * step_rad > _WIDE_RAD, position)

    def _note(self, top_m: float, is_wide: bool, position: tuple[float, float] | None) -> None:
        """A pile, unless a wall may have made it and it was noted already."""
        piles = self._piles.setdefault(int(_cells_of(top_m)), _Piles(0, top_m, None))
        is_elsewhere = position is not None and (
            piles.last is None or math.dist(position, piles.last) > _ELSEWHERE_M
        )
        if is_wide or is_elsewhere:
            piles.count += 1
            piles.least_m, piles.last = min(piles.least_m, top_m), position

    @property
    def no_return_m(self) -> float:
        """What is not below this [m] is no return; inf where the scans tell of no code."""
        codes_m = [
            piles.least_m
            for cell, piles in self._piles.items()
            if piles.count >= _FEWEST_SEEN and self._is_last(cell)
        ]
        return NO_RETURN_SHARE * min(codes_m, default=math.inf)

    @property
    def is_blind(self) -> bool:
        """Whether no beam of any scan came back."""
        return self._least_m >= self.no_return_m

    def _is_last(self, cell: int) -> bool:
        """Whether next to no beam went farther."""
        beyond = int(self._cells[math.ceil(cell / NO_RETURN_SHARE) + 1 :].sum())
        return beyond <= _MOST_BEYOND * int(self._cells[math.floor(cell * NO_RETURN_SHARE) :].sum())


def _cells_of(ranges_m: FloatArray | float) -> IntArray:
    result: IntArray = (
        np.rint(np.minimum(ranges_m, _CELLS) * _CELLS_PER_M).clip(0, _CELLS - 1).astype(np.int64)
    )
    return result

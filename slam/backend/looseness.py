"""Keyframes that leave a direction open: how loosely they lie among what others saw around them."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from slam.arrays import FloatArray, lengthened
from slam.frontend.keyframes import Keyframe
from slam.frontend.remaining import Remaining
from slam.odometry import place_sigma_m


class Looseness:
    """How far along keyframes may lie that leave that open, as seen from those before and after their run
    that do not; keyframe by keyframe."""

    def __init__(self, keyframes: Sequence[Keyframe] = (), open_: Collection[int] = ()) -> None:
        self._count, self._sigmas_m = 0, np.zeros(16)  # longer than filled
        self._ways_m2 = [0.0]
        for k, keyframe in enumerate(keyframes):
            self.take(keyframe, k in open_)

    @property
    def sigmas_m(self) -> FloatArray:
        """(K,) standard deviation of each; 0 of those that leave nothing open."""
        return self._sigmas_m[: self._count].copy()

    @property
    def open_count(self) -> int:
        """How many of the last leave the way open, in a run that has not ended."""
        return len(self._ways_m2) - 1

    def renumber(self, remaining: Remaining) -> None:
        """Keyframes were let go, none of which belongs to a run that has not ended."""
        self._sigmas_m = self.sigmas_m[remaining.is_kept]
        self._count = len(self._sigmas_m)

    def take(self, keyframe: Keyframe, is_open: bool) -> None:
        """The next keyframe."""
        if keyframe.is_after_gap:  # the end of a run before it was let go
            self._ways_m2 = [0.0]
        if self._count == len(self._sigmas_m):
            self._sigmas_m = lengthened(self._sigmas_m, self._count)
        way_m2 = self._ways_m2[-1] + place_sigma_m(keyframe.covariance) ** 2
        if is_open:  # until one tells it from the other end
            self._ways_m2.append(way_m2)
            self._sigmas_m[self._count] = math.sqrt(way_m2)
        else:
            run_m2 = np.array(self._ways_m2[1:])
            run = slice(self._count - len(run_m2), self._count)
            self._sigmas_m[run] = np.sqrt(run_m2 * (way_m2 - run_m2) / way_m2)
            self._ways_m2 = [0.0]
        self._count += 1

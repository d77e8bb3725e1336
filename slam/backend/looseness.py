"""Keyframes that leave a direction open: how loosely they lie among what others saw around them."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from slam.arrays import FloatArray
from slam.frontend.keyframes import Keyframe
from slam.odometry import place_sigma_m


class Looseness:
    """How far along keyframes may lie that leave that open, as seen from those before and after their run
    that do not; keyframe by keyframe."""

    def __init__(self, keyframes: Sequence[Keyframe] = (), open_: Collection[int] = ()) -> None:
        self._sigmas_m = list[float]()
        self._ways_m2 = [0.0]
        for k, keyframe in enumerate(keyframes):
            self.take(keyframe, k in open_)

    @property
    def sigmas_m(self) -> FloatArray:
        """(K,) standard deviation of each; 0 of those that leave nothing open."""
        return np.array(self._sigmas_m)

    def take(self, keyframe: Keyframe, is_open: bool) -> None:
        """The next keyframe."""
        way_m2 = self._ways_m2[-1] + place_sigma_m(keyframe.covariance) ** 2
        if is_open:  # until one tells it from the other end
            self._ways_m2.append(way_m2)
            self._sigmas_m.append(math.sqrt(way_m2))
            return
        run_m2 = np.array(self._ways_m2[1:])
        first = len(self._sigmas_m) - len(run_m2)
        self._sigmas_m[first:] = np.sqrt(run_m2 * (way_m2 - run_m2) / way_m2).tolist()
        self._sigmas_m.append(0.0)
        self._ways_m2 = [0.0]

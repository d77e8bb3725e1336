"""A robot of which nobody measures how it moves: it goes on as it did."""

from __future__ import annotations

import math
import statistics
from collections import deque

import numpy as np

from slam.arrays import FloatArray
from slam.se2 import SE2

_REMEMBERED = 3
"""Motions of which one may be wrong: somebody in view draws a scan aside. Chosen."""
_LATE = 2.0
"""Times the last interval, after which nobody knows how the robot goes on. Chosen."""
_SPEEDS_UP_M, _SPEEDS_UP_MPS = 0.15, 0.3
"""Standard deviation of how much farther than from the last scan to this one a robot goes to the next,
and of its speed: of 70 poses that a search found a quarter of a metre and more from where it would go on to, none was
right. Chosen."""


def coasting_covariance(way_m: float, elapsed_s: float, heading_rad2: float) -> FloatArray:
    """(3, 3) of the pose of a robot that goes on as it did, by a way and for a time: hardly twice as far,
    or as far back."""
    sigma_m = max(_SPEEDS_UP_M, _SPEEDS_UP_MPS * elapsed_s, way_m / 2.0)
    return np.diag([sigma_m**2, sigma_m**2, heading_rad2])


class ConstantVelocity:
    """How a robot moved lately, by scans."""

    def __init__(self) -> None:
        self._steps = deque[tuple[SE2, SE2, float]](maxlen=_REMEMBERED)

    def take(self, T_before: SE2, T_after: SE2, elapsed_s: float) -> None:
        """A step from pose to pose that took so long."""
        if not 0.0 < elapsed_s < math.inf:
            self._steps.clear()
            return
        self._steps.append((T_before, T_after, elapsed_s))

    def stop(self) -> None:
        """Whom nobody sees does not go on for ever."""
        self._steps.clear()

    def motion(self, elapsed_s: float) -> SE2 | None:
        """As fast as it went in the median of the last times, and turning as in the last one; None
        where that tells nothing."""
        if not self._steps or not 0.0 < elapsed_s < _LATE * self._steps[-1][2]:
            return None
        # here, not at each step: hardly anybody asks where wheels tell
        velocities = [before.between(after).log() / time_s for before, after, time_s in self._steps]
        x, y, omega = velocities[-1]
        if len(velocities) == _REMEMBERED:
            x, y = (statistics.median(one[axis] for one in velocities) for axis in range(2))
        return SE2.exp(elapsed_s * np.array([x, y, omega]))

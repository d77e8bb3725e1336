"""Where records of a log are missing: the odometry counts on, but by which way is not known."""

from __future__ import annotations

import math
import statistics
from collections import deque

import numpy as np

from slam.arrays import FloatArray
from slam.se2 import SE2

_INTERVALS = 21
"""Between records, of which the median is the usual one."""
_USUALS, _LEAST_S = 5.0, 2.0
"""A gap is so many usual intervals, and so long [s]."""
_MOVED_M, _MOVED_RAD = 0.8, 0.5
"""Over a gap; less, and the robot stood, or the stamps jumped."""
_SPEED_MPS, _LONGEST_S = 0.3, 600.0
"""What the robot may have driven meanwhile."""
_M_PER_SQRT_M, _RAD_PER_SQRT_M = 0.05, 0.06
"""Of what wheels are off after a metre that turns by a radian."""
_STRAIGHT_M = 5.0
"""Between turns: a way wanders off from its two ends by the root of its length in these. Chosen, all
of them."""


class RecordGaps:
    """Told of all records, how unsure a motion is that came over a gap between two of them."""

    def __init__(self) -> None:
        self._last_s = math.nan
        self._intervals_s: deque[float] = deque(maxlen=_INTERVALS)

    def covariance(self, time_s: float, motion: SE2) -> FloatArray | None:
        """(3, 3) to be added to that of the motion since the last record, in the robot's frame at its
        end; None where none is missing."""
        elapsed_s, self._last_s = time_s - self._last_s, time_s
        if elapsed_s > 0.0:  # neither the first nor stamps that go back
            self._intervals_s.append(elapsed_s)
        has_moved = math.hypot(motion.x, motion.y) > _MOVED_M or abs(motion.theta) > _MOVED_RAD
        if not has_moved or len(self._intervals_s) < _INTERVALS:
            return None
        if not elapsed_s > max(_USUALS * statistics.median(self._intervals_s), _LEAST_S):
            return None
        way_m = _SPEED_MPS * min(elapsed_s, _LONGEST_S)
        heading = _RAD_PER_SQRT_M**2 * way_m
        lever_m2 = (motion.x**2 + motion.y**2 + _STRAIGHT_M * way_m) / 3.0
        position = _M_PER_SQRT_M**2 * way_m + heading * lever_m2
        return np.diag([position, position, heading])

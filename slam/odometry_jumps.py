"""Odometry that tells of a way as the robot has not gone before, much faster or backwards: a jump."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np

from slam.measurements import Measurement
from slam.se2 import SE2

_FAR_M, _FAR_BACK_M = 0.5, 0.3
"""Chosen: shorter jumps, ahead and backwards, are as a slip of wheels, which scans bear."""
_FASTER = 2.0
"""Chosen: of the fastest of the steps remembered."""
_STEPS, _LEAST = 50, 5
"""Remembered, and needed to say how the robot drives. Chosen."""
_MOVES_M = 0.02
_AGAIN = 3
"""Chosen: so many such steps in a row are how it drives now."""
_TURN_RAD = 0.3
"""Chosen: by which the heading may be off after a jump."""


class OdometryJumps:
    """Knows how fast the robot goes, and which way. Where odometry jumps it goes on as it did, turning
    as it is told; that is as unsure as the jump is long: then its scans say where it is."""

    def __init__(self) -> None:
        self._steps: deque[tuple[float, float]] = deque(maxlen=_STEPS)
        self._last_s, self._in_a_row = math.inf, 0
        self._velocity_mps = 0.0, 0.0

    def doubted(self, measurement: Measurement) -> Measurement:
        """The measurement; of odometry that jumped, one of another motion, which tells next to nothing."""
        elapsed_s, self._last_s = measurement.time_s - self._last_s, measurement.time_s
        motion = measurement.motion
        way_m = math.hypot(motion.x, motion.y)
        if not elapsed_s > 0.0 or way_m < _MOVES_M:
            return measurement
        speed_mps = way_m / elapsed_s
        if len(self._steps) >= _LEAST and self._in_a_row < _AGAIN - 1:
            fastest_mps, farthest_back_m = (
                max(column) for column in zip(*self._steps, strict=True)
            )
            is_fast = way_m > _FAR_M and speed_mps > _FASTER * fastest_mps
            is_back = motion.x < -_FAR_BACK_M and farthest_back_m <= 0.0
            if is_fast or is_back:
                self._in_a_row += 1
                doubt = np.diag(np.square([way_m, way_m, _TURN_RAD]))
                x, y = (elapsed_s * one for one in self._velocity_mps)
                return replace(
                    measurement,
                    motion=SE2(x, y, motion.theta),
                    motion_covariance=measurement.motion_covariance + doubt,
                )
        self._in_a_row = 0
        self._velocity_mps = motion.x / elapsed_s, motion.y / elapsed_s
        self._steps.append((speed_mps, -motion.x))
        return measurement

"""How noisy wheels are, learnt where scans tell how far the robot went: a log of poses does not say."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray
from slam.se2 import SE2

_MOST_NIS = 20.0
"""Normalised innovation squared that counts at most: beyond, wheels slipped or jumped. Chosen."""
_LEAST_WAY_M = 1e-3
"""Chosen: a scan up to which the wheels told of no more says nothing of their noise."""
_LEAST_FACING = 0.01
"""Share of a scan across the direction that it tells least of, below which it says nothing of them:
see `WheelScaleConfig.least_facing`."""


class WheelNoise:
    """Standard deviation along the way that the wheels show, as a share of what they were told to
    have: the mean innovation squared, through the mean variance."""

    def __init__(self) -> None:
        self._squares_m2 = self._variances_m2 = 0.0

    @property
    def ratio(self) -> float:
        """1 before any scan told."""
        if self._variances_m2 == 0.0:
            return 1.0
        return math.sqrt(self._squares_m2 / self._variances_m2)

    def update(
        self, covariance: FloatArray, innovation: FloatArray, motion: SE2, least_facing: float
    ) -> None:
        """What a scan tells that moved the pose by an innovation (3,), of covariance (3, 3) before it,
        after a motion by the wheels; all in the frame at the end of that."""
        if math.hypot(motion.x, motion.y) <= _LEAST_WAY_M or least_facing < _LEAST_FACING:
            return
        bearing_rad = math.atan2(motion.y, motion.x) - motion.theta
        ahead = np.array([math.cos(bearing_rad), math.sin(bearing_rad), 0.0])
        variance_m2 = float(ahead @ covariance @ ahead)
        self._squares_m2 += min(float(ahead @ innovation) ** 2, _MOST_NIS * variance_m2)
        self._variances_m2 += variance_m2

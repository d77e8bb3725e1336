"""Odometry of logs that tell poses: how far it is trusted, and where the robot was in between."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray
from slam.measurements import LaserScan
from slam.readers.log_record import LogRecord
from slam.se2 import SE2

_MOST_WAITING = 256
"""Scans that wait for the next odometry record; chosen: some ten seconds of any laser."""
_NO_ODOMETRY = (1.0, 1.0, 1.0)
"""Sigmas [m, m, rad] of a motion of which nothing is known; chosen: no robot goes as far from one
scan to the next."""


@dataclass(frozen=True)
class LogOdometryNoise:
    """How far to trust odometry of which only the poses are known, not the wheels.

    Chosen: 5 cm after a metre, 2 degrees after a metre and 3 after a radian are what the classic
    indoor robots show against their corrected logs.
    """

    position_m_per_sqrt_m: float = 0.05
    heading_rad_per_sqrt_m: float = 0.035
    heading_rad_per_sqrt_rad: float = 0.05

    def covariance(self, motion: SE2) -> FloatArray:
        """(3, 3) of the tangent (x, y, theta) in the robot's frame at the end of the motion."""
        distance_m = math.hypot(motion.x, motion.y)
        position = self.position_m_per_sqrt_m**2 * distance_m
        heading = self.heading_rad_per_sqrt_m**2 * distance_m
        heading += self.heading_rad_per_sqrt_rad**2 * abs(motion.theta)
        return np.diag([position, position, heading])


USUAL_NOISE = LogOdometryNoise()


def unknown_motion(motion: SE2) -> FloatArray:
    """(3, 3) of a motion that nothing measured."""
    return np.diag(np.square(_NO_ODOMETRY))


class ScansBetweenPoses:
    """Scans without a pose of their own: they wait for the odometry record behind them, between
    whose pose and that of the one before they lie by their stamps."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, Callable[[], LaserScan]]] = deque()
        self._before: tuple[float, SE2] | None = None

    def add_pose(self, time_s: float, T_odom_base: SE2) -> Iterator[LogRecord]:
        """The scans that waited for an odometry record, then the record itself."""
        while self._waiting:
            scan_s, scan = self._waiting.popleft()
            T_odom_then = _between(self._before, (time_s, T_odom_base), scan_s)
            yield LogRecord(scan_s, T_odom_then, scan())
        yield LogRecord(time_s, T_odom_base, None)
        self._before = time_s, T_odom_base

    def add_scan(self, time_s: float, scan: Callable[[], LaserScan]) -> Iterator[LogRecord]:
        """Notes a scan, made when it is its turn; the oldest one where too many wait."""
        self._waiting.append((time_s, scan))
        if len(self._waiting) > _MOST_WAITING:
            yield self._without_pose()

    def rest(self) -> Iterator[LogRecord]:
        """The scans for which no odometry record came any more."""
        while self._waiting:
            yield self._without_pose()

    def _without_pose(self) -> LogRecord:
        scan_s, scan = self._waiting.popleft()
        T_odom_last = SE2.identity() if self._before is None else self._before[1]
        return LogRecord(scan_s, T_odom_last, scan())


def _between(before: tuple[float, SE2] | None, after: tuple[float, SE2], time_s: float) -> SE2:
    """The pose at a time on the arc between two odometry records, or at the nearer end of it."""
    if before is None or after[0] <= before[0]:
        return after[1]
    share = min(max((time_s - before[0]) / (after[0] - before[0]), 0.0), 1.0)
    return before[1] @ SE2.exp(share * (before[1].inverse() @ after[1]).log())

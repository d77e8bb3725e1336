"""One entry of a log, whatever its format."""

from __future__ import annotations

from dataclasses import dataclass

from slam.measurements import LaserScan
from slam.se2 import SE2


@dataclass(frozen=True)
class LogRecord:
    """One entry of a log: the robot's pose by wheel odometry alone, and the scan if it has one.

    late_sigma: [m], [rad], beside the noise of the wheels, of the motion since the record before, where that
    is a guess: its odometry was told late or unevenly (see `LateOdometry`, `UnevenOdometry`). is_denied: scans
    deny that the robot stands, as it tells.
    """

    time_s: float
    T_odom_base: SE2
    scan: LaserScan | None
    late_sigma: tuple[float, float] = (0.0, 0.0)
    is_denied: bool = False

"""What the robot knows: laser scans, and the wheel odometry between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray, frozen_array
from slam.se2 import SE2


@dataclass(frozen=True, eq=False)
class LaserScan:
    """One sweep of the laser range sensor (the paper's LRS data).

    time_s: the stamp of the sweep. angles_rad: (N,) increasing, laser frame, the only truth about
    beam directions. ranges_m: (N,); +inf no return, -inf too close (REP-117), nan invalid.
    beam_times_s: (N,) instant at which each beam fired, or None where it is not known.
    Raises ValueError on other shapes, angles that do not increase, or a negative finite range.
    """

    time_s: float
    angles_rad: FloatArray
    ranges_m: FloatArray
    beam_times_s: FloatArray | None = None

    def __post_init__(self) -> None:
        angles_rad = frozen_array(self.angles_rad, (None,), "angles_rad")
        ranges_m = frozen_array(self.ranges_m, angles_rad.shape, "ranges_m")
        if not math.isfinite(self.time_s):
            raise ValueError(f"time_s must be finite, not {self.time_s}")
        if not (np.isfinite(angles_rad).all() and (np.diff(angles_rad) > 0.0).all()):
            raise ValueError("angles_rad must be finite and increase from beam to beam")
        if (np.isfinite(ranges_m) & (ranges_m < 0.0)).any():
            raise ValueError("ranges_m must not be negative; -inf says 'too close' (REP-117)")
        object.__setattr__(self, "time_s", float(self.time_s))
        object.__setattr__(self, "angles_rad", angles_rad)
        object.__setattr__(self, "ranges_m", ranges_m)
        if self.beam_times_s is not None:
            beam_times_s = frozen_array(self.beam_times_s, angles_rad.shape, "beam_times_s")
            object.__setattr__(self, "beam_times_s", beam_times_s)

    @property
    def is_hit(self) -> NDArray[np.bool_]:
        """(N,) True where a beam measured a distance."""
        return np.isfinite(self.ranges_m)

    def points(self, T_base_laser: SE2) -> FloatArray:
        """Where the beams hit, (M, 2) [m], base frame, in the order of the beams; hits only."""
        hit = self.is_hit
        ranges_m, angles_rad = self.ranges_m[hit], self.angles_rad[hit]
        points_laser = np.column_stack(
            [ranges_m * np.cos(angles_rad), ranges_m * np.sin(angles_rad)]
        )
        return T_base_laser @ points_laser

    def cut(self, range_max_m: float) -> LaserScan:
        """The same scan, in which what lies farther than range_max_m is no return."""
        ranges_m = np.where(self.ranges_m > range_max_m, np.inf, self.ranges_m)
        return LaserScan(self.time_s, self.angles_rad, ranges_m, self.beam_times_s)


@dataclass(frozen=True, eq=False)
class Measurement:
    """One scan and the way the wheels say the robot went since the last one.

    motion: from the base frame at the last measurement to the base frame at this one.
    motion_covariance: (3, 3) of the tangent (x [m], y [m], theta [rad]) in the robot's frame at the
    END of the motion: true motion = motion @ SE2.exp(noise).
    Raises ValueError on another shape of the covariance.
    """

    time_s: float
    motion: SE2
    scan: LaserScan
    motion_covariance: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))

    def __post_init__(self) -> None:
        covariance = frozen_array(self.motion_covariance, (3, 3), "motion_covariance")
        object.__setattr__(self, "motion_covariance", covariance)

"""What the robot knows: laser scans, and the wheel odometry between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.arrays import FloatArray, frozen_array
from slam.kernels.beam_points import same_into
from slam.odometry import DifferentialDrive, OdometryNoise
from slam.se2 import FARTHEST_M, SE2

_LONGEST_SWEEP_S = 10.0
"""Chosen: no laser takes as long; a beam time farther off its stamp is no time."""
_ASSUMED_DRIVE = DifferentialDrive((0.5 / math.pi, 0.5 / math.pi), track_m=0.3, ticks_per_turn=1.0)
"""Where only a motion is known: the track of which `OdometryNoise` speaks; its ticks are metres."""
LATEST_S = 1e12
"""Thirty thousand years; nanoseconds since 1970 are a million times as many."""
BEAM_NOISE = 0.05, 0.01
"""[m], and share of a range, by which a beam may measure the same once more. Chosen: twice a cheap laser's
noise."""
_ROUNDING = 1e-9
"""Chosen: what sums of covariances leave of their largest entry."""


@dataclass(frozen=True, eq=False)
class LaserScan:
    """One sweep of the laser range sensor (the paper's LRS data).

    time_s: the stamp of the sweep, best that of its last beam: see `Measurement`. angles_rad: (N,) increasing, laser frame, the only truth about
    beam directions. ranges_m: (N,); +inf no return, -inf too close (REP-117), nan invalid.
    beam_times_s: (N,) instant at which each beam fired, or None where it is not known. Of a beam whose
    time is not finite or 10 s off the stamp, nothing is known: its range becomes nan, its time one
    between its neighbours'. If no beam has a time, they count as not known.
    Raises ValueError on other shapes, angles that do not increase, or a negative finite range.
    """

    time_s: float
    angles_rad: FloatArray
    ranges_m: FloatArray
    beam_times_s: FloatArray | None = None

    def __post_init__(self) -> None:
        angles_rad = frozen_array(self.angles_rad, (None,), "angles_rad")
        ranges_m = frozen_array(_quiet(self.ranges_m), angles_rad.shape, "ranges_m")
        check_stamped("scan", self.time_s, SE2.identity())
        if not (np.isfinite(angles_rad).all() and (np.diff(angles_rad) > 0.0).all()):
            raise ValueError("angles_rad must be finite and increase from beam to beam")
        if (np.isfinite(ranges_m) & (ranges_m < 0.0)).any():
            raise ValueError("ranges_m must not be negative; -inf says 'too close' (REP-117)")
        object.__setattr__(self, "time_s", float(self.time_s))
        object.__setattr__(self, "angles_rad", angles_rad)
        object.__setattr__(self, "ranges_m", ranges_m)
        if self.beam_times_s is not None:
            times_s = _quiet(self.beam_times_s)
            beam_times_s = frozen_array(times_s, angles_rad.shape, "beam_times_s")
            object.__setattr__(self, "beam_times_s", beam_times_s)
            self._mend_times(beam_times_s)

    def _mend_times(self, beam_times_s: FloatArray) -> None:
        """Makes beams without a time such of which nothing is known."""
        # also False where it is nan
        has_time = np.abs(beam_times_s - self.time_s) <= _LONGEST_SWEEP_S
        if has_time.all():
            return
        if not has_time.any():
            object.__setattr__(self, "beam_times_s", None)
            return
        beams = np.arange(len(has_time))
        times_s = np.interp(beams, beams[has_time], beam_times_s[has_time])
        ranges_m = np.where(has_time, self.ranges_m, np.nan)
        object.__setattr__(self, "ranges_m", frozen_array(ranges_m, (None,), "ranges_m"))
        object.__setattr__(self, "beam_times_s", frozen_array(times_s, (None,), "beam_times_s"))

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

    def likeness(self, other: LaserScan) -> float:
        """Share of the beams, of those that came back in either scan, that measured the same in both but for
        noise; 0 for scans of another laser."""
        if len(other.ranges_m) != len(self.ranges_m):
            return 0.0
        shares = np.empty(1)
        same_into(other.ranges_m[None], self.ranges_m, *BEAM_NOISE, shares)
        return float(shares[0])

    def cut(self, range_max_m: float) -> LaserScan:
        """The same scan, in which what lies farther than range_max_m is no return."""
        is_far = self.ranges_m > range_max_m
        if not is_far.any():
            return self
        ranges_m = np.where(is_far, np.inf, self.ranges_m)
        return LaserScan(self.time_s, self.angles_rad, ranges_m, self.beam_times_s)

    def shortened(self, offset_m: float) -> LaserScan:
        """The same scan with ranges that are less by an offset [m]; what is nearer than that is too close."""
        if offset_m == 0.0:
            return self
        shorter_m = self.ranges_m - offset_m
        is_close = self.is_hit & (shorter_m < 0.0)
        ranges_m = np.where(is_close, -np.inf, np.where(self.is_hit, shorter_m, self.ranges_m))
        return LaserScan(self.time_s, self.angles_rad, ranges_m, self.beam_times_s)


@dataclass(frozen=True, eq=False)
class Measurement:
    """One scan and the way the wheels say the robot went since the last one.

    time_s: the instant up to which the motion reaches, and of which the pose is told. It should not
    lie before the last beam: of those fired later (ROS stamps a sweep by its first beam) it is
    guessed where the robot was, which makes the pose much less sure, and is warned of.
    motion: from the base frame at the last measurement to the base frame at this one, at time_s.
    motion_covariance: (3, 3) of the tangent (x [m], y [m], theta [rad]) in the robot's frame at the
    END of the motion: true motion = motion @ SE2.exp(noise). If not given, what `OdometryNoise` says
    by default of two wheels 0.3 m apart that went this way; while they stand, 0.1 mm and 0.1 mrad.
    longest_step_m: of the motions that it is the sum of, the longest [m]; inf: nobody knows. Odometry that jumps
    does so within one.
    Raises ValueError if time or motion are not finite, or if the covariance is none: finite (3, 3),
    symmetric, without negative eigenvalue.
    """

    time_s: float
    motion: SE2
    scan: LaserScan
    # None may be given, and is replaced at once: who reads it finds an array
    motion_covariance: FloatArray = None  # type: ignore[assignment]
    longest_step_m: float = math.inf

    def __post_init__(self) -> None:
        covariance = self.motion_covariance
        if covariance is None:
            check_stamped("motion", self.time_s, self.motion)
            covariance = _assumed_covariance(self.motion)
        covariance = checked_motion(self.time_s, self.motion, covariance)
        object.__setattr__(self, "motion_covariance", covariance)

    def shortened(self, offset_m: float) -> Measurement:
        """The same with ranges that are less by an offset [m]: see `LaserScan.shortened`."""
        return self if offset_m == 0.0 else replace(self, scan=self.scan.shortened(offset_m))


def check_stamped(what: str, time_s: float, pose: SE2) -> None:
    """Raises ValueError, in one line, for a stamp, a pose or a motion that no robot can have."""
    if not abs(time_s) <= LATEST_S:
        raise ValueError(
            f"time_s must be finite, not {time_s}"
            if not math.isfinite(time_s)
            else f"time_s must be seconds, at most {LATEST_S:g}, not {time_s}"
        )
    if not np.isfinite(pose.as_array()).all():
        raise ValueError(f"{what} must be finite, not {pose}")
    if max(abs(pose.x), abs(pose.y)) > FARTHEST_M:
        raise ValueError(f"{what} must be at most {FARTHEST_M:g} m, not {pose}")


def checked_motion(time_s: float, motion: SE2, motion_covariance: ArrayLike) -> FloatArray:
    """(3, 3) the covariance of a motion up to a stamp. Raises ValueError if one of them is none."""
    check_stamped("motion", time_s, motion)
    covariance = frozen_array(motion_covariance, (3, 3), "motion_covariance")
    _check_covariance(covariance)
    return covariance


def _assumed_covariance(motion: SE2) -> FloatArray:
    """(3, 3) of a motion by wheels of which nothing is known."""
    x, y, turn_rad = motion.log()
    way_m, half_m = math.copysign(math.hypot(x, y), x), turn_rad * _ASSUMED_DRIVE.track_m / 2.0
    return OdometryNoise().covariance(_ASSUMED_DRIVE, [way_m - half_m, way_m + half_m])


def _check_covariance(covariance: FloatArray) -> None:
    """Raises ValueError, in one line, unless a matrix (3, 3) is a covariance, rounding aside."""
    values = covariance.tolist()
    if not np.isfinite(covariance).all():
        raise ValueError(f"motion_covariance must be finite, not {values}")
    rounding = _ROUNDING * float(np.abs(covariance).max())
    if np.abs(covariance - covariance.T).max() > rounding:
        raise ValueError(f"motion_covariance must be symmetric, not {values}")
    least = float(np.linalg.eigvalsh(covariance)[0])
    if least < -rounding:
        raise ValueError(
            f"motion_covariance must have no negative eigenvalue; the least of {values} is {least:.3g}"
        )


def _quiet(values: ArrayLike) -> FloatArray:
    """The same, each nan the usual one: those that signal make warnings of whatever they are asked."""
    with np.errstate(invalid="ignore"):
        array = np.asarray(values, dtype=np.float64)
        return np.where(np.isnan(array), np.nan, array)

"""Odometry of a robot with two driven wheels (the paper's "Odometeri")."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from slam.arrays import FloatArray
from slam.kernels.normal_equations import carry_into
from slam.se2 import SE2


@dataclass(frozen=True)
class DifferentialDrive:
    """Two driven wheels with encoders: left, right, in this order always.

    wheel_radius_m: (left, right). track_m: distance between the wheels' contacts.
    ticks_per_turn: encoder ticks per turn of a wheel, after all gears.
    Raises ValueError when a size is not positive.
    """

    wheel_radius_m: tuple[float, float]
    track_m: float
    ticks_per_turn: float

    def __post_init__(self) -> None:
        sizes = (*self.wheel_radius_m, self.track_m, self.ticks_per_turn)
        if len(self.wheel_radius_m) != 2 or not all(
            math.isfinite(size) and size > 0.0 for size in sizes
        ):
            raise ValueError(
                f"a drive needs two wheel radii, a track and ticks per turn above 0, not {self}"
            )

    def wheel_travel_m(self, ticks_delta: ArrayLike) -> FloatArray:
        """How far each wheel rolled, (2,) [m], left and right."""
        ticks = np.asarray(ticks_delta, dtype=np.float64)
        if ticks.shape != (2,):
            raise ValueError(f"ticks_delta must have shape (2,), left and right, not {ticks.shape}")
        turns = ticks / self.ticks_per_turn
        return np.asarray(2.0 * math.pi * turns * np.asarray(self.wheel_radius_m))

    def motion(self, ticks_delta: ArrayLike) -> SE2:
        """The motion of the base while the wheels turned by ticks_delta (2,): the exact arc.

        Exact for constant wheel speeds, whatever the angle: no half-angle approximation.
        Paper, Section 3.2, step 1.
        """
        left_m, right_m = self.wheel_travel_m(ticks_delta)
        return SE2.exp([(left_m + right_m) / 2.0, 0.0, (right_m - left_m) / self.track_m])


@dataclass(frozen=True)
class OdometryNoise:
    """How the error of the wheel odometry grows with the way travelled.

    Each wheel's travel is wrong by a random walk, so its variance grows with the distance that the
    wheel rolled; turning adds scrub of the contact, so the heading also with the angle turned.
    Values chosen: 3 mm after a metre of each wheel, which with a track of 0.3 m is 0.8 degrees per
    metre driven straight; 2 degrees per turn on the spot, a track known to 0.5 %.
    pivot_m_per_sqrt_turn: ahead and aside, as far as the wheels turn against each other, tires
    scrub; by default no more than they do anyway.
    """

    wheel_travel_m_per_sqrt_m: float = 0.003
    lateral_m_per_sqrt_m: float = 0.003
    heading_rad_per_sqrt_turn: float = 0.035
    pivot_m_per_sqrt_turn: float = 0.0
    # chosen: far below a tick; keeps the matrix invertible while the robot stands
    floor_m: float = 1e-4
    floor_rad: float = 1e-4

    def covariance(self, drive: DifferentialDrive, ticks_delta: ArrayLike) -> FloatArray:
        """(3, 3) of the tangent (x, y, theta) in the robot's frame at the end of the motion."""
        travel_m = drive.wheel_travel_m(ticks_delta)
        left_variance, right_variance = self.wheel_travel_m_per_sqrt_m**2 * np.abs(travel_m)
        turns = abs(travel_m[1] - travel_m[0]) / drive.track_m / (2.0 * math.pi)
        along = (left_variance + right_variance) / 4.0
        across = self.lateral_m_per_sqrt_m**2 * float(np.abs(travel_m).mean())
        heading = (left_variance + right_variance) / drive.track_m**2
        heading += self.heading_rad_per_sqrt_turn**2 * turns
        against_m = (np.abs(travel_m).sum() - abs(travel_m.sum())) / 2.0
        pivot = self.pivot_m_per_sqrt_turn**2 * against_m / drive.track_m / math.pi
        along, across = along + pivot, across + pivot
        along_heading = (right_variance - left_variance) / (2.0 * drive.track_m)
        covariance = np.diag([along, across, heading])
        covariance[0, 2] = covariance[2, 0] = along_heading
        floor = np.diag([self.floor_m, self.floor_m, self.floor_rad])
        return np.asarray(covariance + floor**2)


def compose_covariance(
    covariance_first: FloatArray, motion_second: SE2, covariance_second: FloatArray
) -> FloatArray:
    """(3, 3) covariance of `first @ second`, each in the robot's frame at the end of its motion.

    First order: (A exp(a)) (B exp(b)) = A B exp(Ad(B^-1) a) exp(b), a and b independent.
    """
    covariance = np.empty((3, 3))
    carry_into(covariance_first, motion_second.x, motion_second.y, motion_second.theta, covariance)
    covariance += covariance_second
    return covariance


def place_sigma_m(covariance: FloatArray) -> float:
    """Standard deviation [m] of a pose's place, by its covariance (3, 3), in the direction in which it is
    known least."""
    (xx, xy, _), (_, yy, _), _ = covariance.tolist()
    return math.sqrt((xx + yy) / 2.0 + math.hypot((xx - yy) / 2.0, xy))


@dataclass(frozen=True)
class WheelModel:
    """How ticks and scans of a robot come to be: what a calibration finds of it.

    T_base_laser: the laser's mounting. side_slip_s: metres aside, to the left, per metre ahead and
    rad/s of turn: tires give way in curves. late_s: from the last beam of a scan to its stamp.
    """

    drive: DifferentialDrive
    T_base_laser: SE2
    side_slip_s: float = 0.0
    late_s: float = 0.0

    def motion(self, ticks_delta: ArrayLike, duration_s: float) -> SE2:
        """The motion of the base while the wheels turned by ticks_delta (2,), in such a time."""
        motion = self.drive.motion(ticks_delta)
        if self.side_slip_s == 0.0 or duration_s <= 0.0:
            return motion
        ahead_m, _, turn_rad = motion.log()
        return SE2.exp([ahead_m, self.side_slip_s * ahead_m * turn_rad / duration_s, turn_rad])

"""Scans straightened: each beam from where the robot was when it fired."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.measurements import LaserScan
from slam.se2 import SE2


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """How the base moved up to a stamp: its velocity, changing evenly, seen from the base there.

    end_s: the stamp. middle_s: when velocity held. velocity: (3,) twist per second (x, y [m/s],
    theta [rad/s]); acceleration: (3,) its change per second. unsteadiness: (3,) standard deviation
    of a pose amid the interval, seen from its end [m], [rad]: a sixteenth of how far the robot goes
    astray in it by the acceleration's own change, which nothing tells before the next interval.
    """

    end_s: float
    middle_s: float
    velocity: FloatArray
    acceleration: FloatArray
    unsteadiness: FloatArray

    @staticmethod
    def over(
        motion: SE2, start_s: float, end_s: float, before: BodyMotion | None = None
    ) -> BodyMotion:
        """The motion over an interval; from the one before it comes how the velocity changes.

        Wheels tell one mean velocity for each interval. With the last one it is a line in time: a
        robot that speeds up at 1 rad/s2 is then 1 mrad less off in the middle of 0.1 s.
        Raises ValueError unless the interval has a length.
        """
        if not end_s > start_s:
            raise ValueError(f"a motion needs a start before its end, not {start_s} and {end_s} s")
        velocity, middle_s = motion.log() / (end_s - start_s), (start_s + end_s) / 2.0
        acceleration = before_that = np.zeros(3)
        if before is not None and abs(before.end_s - start_s) < 1e-9:
            acceleration = (velocity - before.velocity) / (middle_s - before.middle_s)
            before_that = before.acceleration
        astray = np.abs(acceleration - before_that) * (end_s - start_s) ** 2
        return BodyMotion(end_s, middle_s, velocity, acceleration, astray / 16.0)

    def less_sure(self, information: FloatArray) -> FloatArray:
        """(3, 3) information of a match, less what its scan's straightening may have missed."""
        if not self.unsteadiness.any():
            return information
        variance = np.diag(self.unsteadiness**2)
        # (R + D)^-1 for an R that may have no inverse
        loosened = np.linalg.solve(np.eye(3) + information @ variance, information)
        return np.asarray((loosened + loosened.T) / 2.0)

    def poses_at(self, times_s: FloatArray) -> FloatArray:
        """(N, 3) pose of the base at each time (N,) in the frame of the base at the stamp."""
        before_end_s = self.end_s - times_s
        leads = ((self.end_s - self.middle_s) ** 2 - (times_s - self.middle_s) ** 2) / 2.0
        twists = np.outer(before_end_s, self.velocity) + np.outer(leads, self.acceleration)
        return _exp_all(-twists)


def deskewed(scan: LaserScan, T_base_laser: SE2, motion: BodyMotion) -> Beams:
    """The beams of a scan as seen from the base at the end of the motion.

    Raises ValueError if the scan has no beam times.
    """
    if scan.beam_times_s is None:
        raise ValueError("a scan without beam_times_s cannot be deskewed")
    poses = motion.poses_at(scan.beam_times_s)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, 0] + c * T_base_laser.x - s * T_base_laser.y
    y = poses[:, 1] + s * T_base_laser.x + c * T_base_laser.y
    angles_rad = scan.angles_rad + T_base_laser.theta + poses[:, 2]
    # interlaced beams of a turning robot may overtake their neighbours
    order = np.argsort(angles_rad, kind="stable")
    return Beams(np.column_stack([x, y])[order], angles_rad[order], scan.ranges_m[order])


def _exp_all(twists: FloatArray) -> FloatArray:
    """(N, 3) `SE2.exp` of each twist (N, 3), angles not wrapped."""
    omega = twists[:, 2]
    is_small = np.abs(omega) < 1e-4
    safe = np.where(is_small, 1.0, omega)
    sine = np.where(is_small, 1.0 - omega**2 / 6.0, np.sin(safe) / safe)
    cosine = np.where(is_small, omega / 2.0, (1.0 - np.cos(safe)) / safe)
    x = sine * twists[:, 0] - cosine * twists[:, 1]
    y = cosine * twists[:, 0] + sine * twists[:, 1]
    return np.column_stack([x, y, omega])

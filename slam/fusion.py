"""Odometry and scan matches fused: an error-state Kalman filter that also learns the wheels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray
from slam.se2 import SE2


@dataclass(frozen=True)
class WheelPrior:
    """How wrong the wheels' constants may be, beside the noise of each motion: standard deviations.

    forward_scale: of both radii together; turn_scale: of the track; curvature_per_m: heading gained
    on a straight metre by unequal wheels [rad/m]; side_slip_s: metres to the left per metre driven
    and radian turned per second, by which tires give way in a curve [s]; lag_s: by which the body
    follows the wheels, forward and turning, as the speed changes [s]; turn_shift_m: way forward per
    radian turned on the spot by unequal wheels [m]; lag_noise_s: of each change of speed anew [s].
    chosen: what a tape measure leaves; a slip of 3 mm/s at 1 m/s and 1 rad/s; a hundredth of a
    second, and a fifth of it for what differs from one change to the next.
    """

    forward_scale: float = 0.01
    turn_scale: float = 0.02
    curvature_per_m: float = 0.02
    side_slip_s: float = 0.003
    lag_s: float = 0.01
    turn_shift_m: float = 0.001
    lag_noise_s: float = 0.002


class PoseFilter:
    """A pose with its covariance, moved by odometry and corrected by scan matches.

    Error state: (x, y, theta) in the base frame, true = T_map_base @ SE2.exp(error), and six
    constants of the wheels: the twist (v, y, w) that they tell of a time dt, after one at velocity
    (v', y', w'), is truly (v (1 + forward) + lag (v / dt - v') + shift w,
    y + slip v w / dt, w (1 + turn) + curvature v + lag (w / dt - w')).
    """

    def __init__(
        self, T_map_base: SE2, covariance: FloatArray, wheels: WheelPrior | None = None
    ) -> None:
        """covariance: (3, 3) of the pose's error."""
        self._wheels = wheels = wheels or WheelPrior()
        self.T_map_base = T_map_base
        self.wheel_errors: FloatArray = np.zeros(6)
        deviations = [
            wheels.forward_scale, wheels.turn_scale, wheels.curvature_per_m, wheels.side_slip_s,
            wheels.lag_s, wheels.turn_shift_m,
        ]  # fmt: skip
        self._deviations = np.array(deviations)
        self._velocity: FloatArray | None = None
        self._P: FloatArray = np.zeros((9, 9))
        self._P[:3, :3] = covariance
        self._P[3:, 3:] = np.diag(np.square(deviations))

    @property
    def strain(self) -> float:
        """Largest of the wheels' learnt constants, in standard deviations of what was thought of it."""
        return float((np.abs(self.wheel_errors) / self._deviations).max())

    @property
    def covariance(self) -> FloatArray:
        """(3, 3) of the pose's error, base frame."""
        return self._P[:3, :3].copy()

    def predict(self, motion: SE2, duration_s: float, covariance: FloatArray) -> SE2:
        """Moves on by what the wheels told over some time [s]; the motion as it truly was.

        covariance: (3, 3) of the noise at its end. duration_s: inf where it is not known.
        """
        v, y, w = motion.log()
        velocity = motion.log() / duration_s
        change = np.zeros(3) if self._velocity is None else velocity - self._velocity
        self._velocity = velocity
        forward, turn, curvature, slip, lag, shift = self.wheel_errors
        moved = SE2.exp(
            [
                v * (1.0 + forward) + lag * change[0] + shift * w,
                y + slip * v * velocity[2],
                w * (1.0 + turn) + curvature * v + lag * change[2],
            ]
        )
        transition = np.eye(9)
        transition[:3, :3] = moved.inverse().adjoint()
        transition[0, 3], transition[0, 7], transition[0, 8] = v, change[0], w
        transition[2, 4], transition[2, 5], transition[2, 7] = w, v, change[2]
        # a change of heading on the way shifts the end of it sideways by half the way
        transition[1, 4], transition[1, 5] = v * w / 2.0, v * v / 2.0
        transition[1, 6] = v * velocity[2]
        self._P = transition @ self._P @ transition.T
        creep = self._wheels.lag_noise_s * np.array([change[0], 0.0, change[2]])
        self._P[:3, :3] += covariance + np.diag(creep**2)
        self.T_map_base = self.T_map_base @ moved
        return moved

    def innovation(self, T_map_base: SE2, information: FloatArray) -> float:
        """Normalised innovation squared of a match (3 on average where all is as assumed).

        Directions of which the match has no information do not count.
        """
        innovation = (self.T_map_base.inverse() @ T_map_base).log()
        # (P + R)^-1 = R^-1 - R^-1 (P^-1 + R^-1)^-1 R^-1, which needs no R where there is none
        P = self._P[:3, :3]
        gain = np.linalg.solve(np.eye(3) + information @ P, information)
        return float(innovation @ gain @ innovation)

    def update(self, T_map_base: SE2, information: FloatArray) -> None:
        """Corrects the pose by a match with its information (3, 3), its base frame."""
        innovation = (self.T_map_base.inverse() @ T_map_base).log()
        P = self._P
        gain = P[:, :3] @ np.linalg.solve(np.eye(3) + information @ P[:3, :3], information)
        error = gain @ innovation
        P = P - gain @ P[:3, :]
        self._P = (P + P.T) / 2.0
        self.T_map_base = self.T_map_base @ SE2.exp(error[:3])
        self.wheel_errors = self.wheel_errors + error[3:]

    def loosen(self, factor: float) -> None:
        """Makes the pose's variance larger by a factor, as after a slip that no noise foresaw."""
        root = np.sqrt(factor)
        self._P[:3, :] *= root
        self._P[:, :3] *= root

    def restart(self, T_map_base: SE2, covariance: FloatArray) -> None:
        """Forgets the pose, not the wheels: the robot is where a match says."""
        self.T_map_base = T_map_base
        self._P[:3, :] = 0.0
        self._P[:, :3] = 0.0
        self._P[:3, :3] = covariance

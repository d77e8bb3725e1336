"""Odometry and scan matches fused: an error-state Kalman filter that also learns the wheels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray
from slam.heavy_tails import (
    EDGES,
    SLIPS_M,
    SMOOTH,
    WHOLE,
    WIDEST,
    SlipOdds,
    Tails,
    corrected,
    slip_covariance,
)
from slam.scan_match import PoseInformation, ScanMatch
from slam.se2 import SE2
from slam.wheel_prior import WheelPrior

_LAG, _SHIFT = 7, 8
_VAGUE = 10.0
"""Chosen: times a match's variance, of a prediction that has no say."""
_TOLD = 1.0
"""Chosen: information [1/m^2] or [1/rad^2] below which a match tells nothing of a direction."""
_TURNING_RADPS = 0.05
"""Chosen: slower turns to either side are what a robot that drives straight makes."""
_ANOTHER_VIEW = 1.0
"""Chosen: squared motion, in standard deviations of one scan, after which it sees other edges."""
_VIEW_M, _VIEW_RAD = 0.3, 0.3
"""Chosen: after such a way or turn the same walls are met by other points. In drives through three
rooms the errors of `fast` correlate by a tenth to a third from scan to scan, over 0.2 to 0.4 m."""


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
        self._side = 0.0
        self._slips = SlipOdds(wheels.slips_per_m)
        self._is_timed = False
        self.motion_sigma: FloatArray = np.zeros(3)
        """Of the latest motion, by what is not known of how the body follows the wheels."""
        self._P: FloatArray = np.zeros((9, 9))
        self._P[3:, 3:] = np.diag(np.square(deviations))
        self.restart(T_map_base, covariance)

    @property
    def strain(self) -> float:
        """Largest of the wheels' learnt constants, in standard deviations of what was thought of it."""
        known = self._deviations > 0.0
        strains = np.abs(self.wheel_errors[known]) / self._deviations[known]
        return float(strains.max(initial=0.0))

    @property
    def covariance(self) -> FloatArray:
        """(3, 3) of the pose's error, base frame."""
        return self._P[:3, :3].copy()

    def predict(self, motion: SE2, duration_s: float, covariance: FloatArray) -> SE2:
        """Moves on by what the wheels told over some time [s]; the motion as it truly was.

        covariance: (3, 3) of the noise at its end. duration_s: inf where it is not known; then
        nothing is said of a change of speed, now or by the next motion. The first of which it is
        known may be a start from rest.
        """
        v, y, w = twist = motion.log()
        self._slips.move(twist)
        velocity = twist / duration_s
        change, creep = self._changed(velocity, np.isfinite(duration_s))
        self._velocity = velocity if np.isfinite(duration_s) else None
        self._turn_to(velocity[2])
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
        self._P[:3, :3] += covariance + np.diag([creep[0] ** 2, 0.0, creep[2] ** 2])
        self._narrow()
        self.T_map_base = self.T_map_base @ moved
        return moved

    def _changed(
        self, velocity: FloatArray, is_timed: np.bool_ | bool
    ) -> tuple[FloatArray, FloatArray]:
        """(3,) by how much the velocity has changed, and by how much more or less than the lag learnt
        makes of it the body may have followed: a standard deviation."""
        self.motion_sigma, wheels = np.zeros(3), self._wheels
        if not is_timed:
            return np.zeros(3), np.zeros(3)
        if self._velocity is not None:
            change = velocity - self._velocity
            lag_s = np.hypot(np.sqrt(self._P[_LAG, _LAG]), wheels.lag_noise_s)
            self.motion_sigma = lag_s * change
            return change, wheels.lag_noise_s * change
        if not self._is_timed:  # of a robot of which nothing is known: it may just have started
            self.motion_sigma = wheels.lag_s * velocity
        self._is_timed = True
        return np.zeros(3), self.motion_sigma

    def _turn_to(self, turn_rate_radps: float) -> None:
        """Forgets the way forward per radian where the robot now turns to its other side."""
        if abs(turn_rate_radps) < _TURNING_RADPS:
            return
        side = np.sign(turn_rate_radps)
        if self._side * side < 0.0:
            self.wheel_errors[_SHIFT - 3] = 0.0
            self._P[_SHIFT, :] = 0.0
            self._P[:, _SHIFT] = 0.0
            self._P[_SHIFT, _SHIFT] = self._deviations[_SHIFT - 3] ** 2
        self._side = side

    def innovation(
        self, T_map_base: SE2, information: FloatArray, *, after_slip: bool = False
    ) -> float:
        """Normalised innovation squared of a match (3 on average where all is as assumed).

        Directions of which the match has no information do not count. after_slip: had the wheels
        slipped as far as they may.
        """
        innovation = (self.T_map_base.inverse() @ T_map_base).log()
        # (P + R)^-1 = R^-1 - R^-1 (P^-1 + R^-1)^-1 R^-1, which needs no R where there is none
        P = self._P[:3, :3]
        if after_slip:
            P = P + slip_covariance(float(SLIPS_M[-1]))
        gain = np.linalg.solve(np.eye(3) + information @ P, information)
        return float(innovation @ gain @ innovation)

    def share_of_match(self, information: FloatArray) -> tuple[int, float]:
        """How many directions a match (3, 3) tells of, and of the innovation's expected variance along
        them what is its own, from 0 to 1; the rest is the prediction's. 0 and 0 for nothing told.
        """
        told = int(np.count_nonzero(np.linalg.eigvalsh(information) > _TOLD))
        if told == 0:
            return 0, 0.0
        # tr((P + R)^-1 R), which needs no R where there is none; an open direction counts 1
        own = float(np.trace(np.linalg.inv(np.eye(3) + information @ self._P[:3, :3])))
        return told, max(own - (3 - told), 0.0) / told

    def update(self, T_map_base: SE2, information: FloatArray) -> None:
        """Corrects the pose by a match with its information (3, 3), its base frame."""
        innovation = (self.T_map_base.inverse() @ T_map_base).log()
        P = self._P
        left = np.linalg.inv(np.eye(3) + information @ P[:3, :3])
        gain = P[:, :3] @ left @ information
        error = gain @ innovation
        # Joseph's form, its gain R gain^T such that it needs no R: a sum of squares stays a covariance
        kept = np.eye(9)
        kept[:, :3] -= gain
        spread = P[:, :3] @ left
        P = kept @ P @ kept.T + spread @ information @ spread.T
        self._P = (P + P.T) / 2.0
        self.T_map_base = self.T_map_base @ SE2.exp(error[:3])
        self.wheel_errors = self.wheel_errors + error[3:]

    def take(self, match: ScanMatch, scale: float = 1.0) -> None:
        """Corrects the pose by a match that may err more than it says, if the wheels did not slip.

        scale: of its covariance. What its edges tell is taken for itself where the match tells it
        apart: if they lead astray, the rest still holds. A pose that is known far worse than by the
        match tells nothing of its error: then it is as sure as it says.
        """
        assert match.information is not None
        if self._is_vague(match.information / scale):
            self._slips.clear()
            self.update(match.T_map_base, match.information / scale)
            return
        smooth = match.smooth or PoseInformation(match.T_map_base, match.information)
        information = smooth.information / scale
        pull = information @ (self.T_map_base.inverse() @ smooth.T_map_base).log()
        tails = WHOLE if match.smooth is None else SMOOTH
        self._slips.take(self._correct(pull, information, tails, self._slips.odds))
        edges = match.information / scale - information
        if not edges.any():
            return
        back = self.T_map_base.inverse()
        pull = match.information / scale @ (back @ match.T_map_base).log()
        pull = pull - information @ (back @ smooth.T_map_base).log()
        self._correct(pull, edges, EDGES, None)

    def _is_vague(self, information: FloatArray) -> bool:
        """Whether the pose is known far worse than by a match of this information, every way."""
        return bool(np.linalg.eigvals(information @ self._P[:3, :3]).real.min() > _VAGUE)

    def _correct(
        self, pull: FloatArray, information: FloatArray, tails: Tails, slips: FloatArray | None
    ) -> FloatArray:
        error, self._P, of_slips = corrected(self._P, pull, information, tails, slips)
        self.T_map_base = self.T_map_base @ SE2.exp(error[:3])
        self.wheel_errors = self.wheel_errors + error[3:]
        self._narrow()
        return of_slips

    def restart(self, T_map_base: SE2, covariance: FloatArray) -> None:
        """Forgets the pose, not the wheels: the robot is where a match says.

        covariance: (3, 3); beyond 100 m or a full turn it counts as so much.
        """
        self.T_map_base = T_map_base
        self._slips.clear()
        self._P[:3, :] = 0.0
        self._P[:, :3] = 0.0
        is_known = np.isfinite(covariance)
        self._P[:3, :3] = np.where(is_known, covariance, np.diag(WIDEST**2))
        self._narrow()

    def _narrow(self) -> None:
        """Keeps the pose's variance where a filter of first order means something."""
        deviations = np.sqrt(np.diag(self._P)[:3])
        if (deviations > WIDEST).any():
            scale = np.minimum(1.0, WIDEST / np.maximum(deviations, WIDEST))
            self._P[:3, :] *= scale[:, np.newaxis]
            self._P[:, :3] *= scale


def covariance_held(information: FloatArray) -> FloatArray:
    """(3, 3) covariance of what an information fixes; 100 m, or a full turn, along the rest."""
    return np.asarray(np.linalg.inv(information + np.diag(WIDEST**-2.0)))


class Viewpoint:
    """From where the robot looks, and how much of that view has been used already.

    While the robot stands, its scans are no independent looks: edges lie between the same beams, the
    same points in the same cells, each time. What repeats is taken once per pose: of a match that
    tells its smooth part apart, the edges; of another, the share that `ScanMatch.repeated` names.
    """

    def __init__(self) -> None:
        self._moved = SE2.identity()
        self._looks = 0

    def move(self, moved: SE2) -> None:
        """Notes that the robot moved on."""
        self._moved = self._moved @ moved

    def fresh(self, match: ScanMatch) -> ScanMatch:
        """The part of a match with information that no match from here has told before."""
        part = match.smooth
        assert match.information is not None
        if self._looks == 0 or self._is_another(part):
            self._moved, self._looks = SE2.identity(), 0
            return match
        if part is not None:
            return replace(match, T_map_base=part.T_map_base, information=part.information)
        # so that n scans have the covariance repeated + (1 - repeated) / n of one
        after, before = (
            n / (match.repeated * n + 1.0 - match.repeated) for n in (self._looks + 1, self._looks)
        )
        return replace(match, information=(after - before) * match.information)

    def _is_another(self, part: PoseInformation | None) -> bool:
        if part is None:
            return not self._moved.is_near(SE2.identity(), _VIEW_M, _VIEW_RAD)
        way = self._moved.log()
        return float(way @ part.information @ way) > _ANOTHER_VIEW

    def take(self, *, is_anew: bool = False) -> None:
        """Notes that what was fresh of a match has been used; is_anew: and nothing before counts."""
        if is_anew:
            self._moved, self._looks = SE2.identity(), 0
        self._looks += 1


def mixed(matches: Sequence[ScanMatch], log_weights: FloatArray) -> ScanMatch:
    """One match for several ways in which the robot may have moved while the scan was taken.

    matches: with information, in an order in which neighbours stand for what lies between them.
    log_weights: (K,) of their probabilities. The mean, and the covariance of the mixture: what each
    says of itself, how far they lie apart, and that the truth lies between two of them.
    """
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    best = matches[int(weights.argmax())]
    back = best.T_map_base.inverse()
    offs = np.array([(back @ match.T_map_base).log() for match in matches])
    mean = weights @ offs
    steps = np.gradient(offs, axis=0) if len(matches) > 1 else np.zeros_like(offs)
    covariance = np.zeros((3, 3))
    for weight, match, off, step in zip(weights, matches, offs - mean, steps, strict=True):
        assert match.information is not None
        own = covariance_held(match.information)
        covariance += weight * (own + np.outer(off, off) + np.outer(step, step) / 12.0)
    return replace(
        best,
        T_map_base=best.T_map_base @ SE2.exp(mean),
        information=np.asarray(np.linalg.inv(covariance), dtype=np.float64),
        smooth=None,
    )

"""Self-localisation: odometry predicts, the laser corrects (Section 3.2, Fig. 2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.consistency import InnovationMonitor
from slam.frozen_laser import FrozenLaser
from slam.fusion import PoseFilter, Viewpoint, covariance_held
from slam.guard.look import Look, Step
from slam.innovation_scales import InnovationScales
from slam.lost import Guard
from slam.matchers import Matcher
from slam.measurements import LaserScan, Measurement, check_stamped, checked_motion
from slam.odometry import compose_covariance
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2
from slam.straightening import Straightener
from slam.verdict import Judgement, Status, Verdict, verdict_of
from slam.wheel_prior import WheelPrior

_FROZEN = "the scan is one of the last ones bit for bit: the laser has frozen"
_UNUSED = {
    Status.TRACKING: MatchStatus.NOT_ATTEMPTED,
    Status.UNSURE: MatchStatus.NOT_ATTEMPTED,
    Status.LOST: MatchStatus.LOST,
}


@dataclass(frozen=True)
class LocalizerConfig:
    """How a `Localizer` follows the robot.

    deskew: straighten each scan by the wheels; False: take it as it is. sweep_s: what a scan
    without beam times may have taken, so that much the pose may be late; chosen: a slow laser's
    turn. range_max_m: what lies farther is no return. fastest: (m/s, rad/s) of a robot of whose motion the first scan tells only that there is
    one.
    fuse: join a match that knows its covariance with the prediction; otherwise it replaces it.
    start_sigma_m, start_sigma_rad: how uncertain the first pose is, on each axis. max_nis:
    normalised innovation squared beyond which match and prediction contradict each other, even if
    the wheels slipped: a match that explains the scan is then believed alone. chosen: 30 is exceeded
    by chance once in a million.
    max_scale: by how much the innovations seen may widen the covariances of matches, and of motions.
    They never narrow them: small innovations may be the other's doing just as well.
    mount_sigma: (m, m, rad) of the laser's place on the robot; it stays what it is, so that no
    number of scans makes it less. Added to the covariance of the pose.
    """

    deskew: bool = True
    sweep_s: float = 0.1
    range_max_m: float = math.inf
    fastest: tuple[float, float] = (0.5, 1.0)
    fuse: bool = True
    start_sigma_m: float = 0.1
    start_sigma_rad: float = 0.1
    max_nis: float = 30.0
    max_scale: float = 10.0
    wheels: WheelPrior = field(default_factory=WheelPrior)
    mount_sigma: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        starts = (self.start_sigma_m, self.start_sigma_rad)
        if not all(math.isfinite(sigma) and sigma > 0.0 for sigma in starts):
            raise ValueError(f"start_sigma_m and start_sigma_rad must be above 0, not {starts}")
        if not self.max_nis > 0.0:
            raise ValueError(f"max_nis must be above 0, not {self.max_nis}")
        if not 1.0 <= self.max_scale < math.inf:
            raise ValueError(f"max_scale must be 1 or more, not {self.max_scale}")
        if not self.range_max_m > 0.0:
            raise ValueError(f"range_max_m must be above 0, not {self.range_max_m}")
        bounds = (self.sweep_s, *self.fastest, *self.mount_sigma)
        if not all(math.isfinite(bound) and bound >= 0.0 for bound in bounds):
            raise ValueError(f"sweep_s, fastest and mount_sigma must be 0 or more, not {bounds}")


@dataclass(frozen=True, eq=False)
class Estimate:
    """What the robot believes after one measurement.

    T_map_base: the pose matched, fused with the prediction where the match knows its covariance;
    or the predicted one where nothing matched. covariance: (3, 3) of its tangent (x, y, theta) in
    the base frame, or None where the method claims nothing. nis: normalised innovation squared of
    the match. warnings: what does not fit map, laser or wheels, in words. verdict: whether the pose
    is to be believed, and why not; without a `Guard`, what the match says of itself.
    """

    time_s: float
    T_predicted: SE2
    T_map_base: SE2
    match: ScanMatch
    covariance: FloatArray | None = None
    nis: float | None = None
    warnings: tuple[str, ...] = ()
    verdict: Verdict = field(default_factory=lambda: Verdict(Status.TRACKING))

    @property
    def is_matched(self) -> bool:
        """False when the pose is the odometry's word alone."""
        return self.match.is_matched


class Localizer:
    """Follows a robot on a known map. `T_map_base` is its pose at the last measurement.

    With a guard it knows when it is lost, and finds itself again anywhere on the map; it may then
    also start without a pose. Raises ValueError for a start without a pose and without a guard, and
    for poses that are not finite.
    """

    def __init__(
        self,
        matcher: Matcher,
        T_map_base: SE2 | None,
        T_base_laser: SE2,
        config: LocalizerConfig | None = None,
        guard: Guard | None = None,
    ) -> None:
        if T_map_base is None and guard is None:
            raise ValueError("a start without a pose needs a guard, which searches the map")
        check_stamped("T_base_laser", 0.0, T_base_laser)
        if T_map_base is not None:
            check_stamped("T_map_base", 0.0, T_map_base)
        self.guard = guard
        if guard is not None and T_map_base is None:
            guard.is_lost = True
        T_map_base = SE2.identity() if T_map_base is None else T_map_base
        self.matcher = matcher
        self.T_base_laser = T_base_laser
        self.config = config or LocalizerConfig()
        start = np.square([self.config.start_sigma_m] * 2 + [self.config.start_sigma_rad])
        self._filter = PoseFilter(T_map_base, np.diag(start), self.config.wheels)
        self._monitor = InnovationMonitor()
        self._viewpoint = Viewpoint()
        self._straightener = Straightener(
            T_base_laser,
            deskew=self.config.deskew,
            sweep_s=self.config.sweep_s,
            fastest=self.config.fastest,
        )
        self._last: Measurement | None = None
        self._laser = FrozenLaser()
        self._T_last, self._moved_noise = T_map_base, np.zeros((3, 3))
        self._claims_nothing = False
        self._scales = InnovationScales(self.config.max_scale)
        self._offset_m = 0.0

    @property
    def T_map_base(self) -> SE2:
        """The pose at the last measurement."""
        return self._filter.T_map_base

    @property
    def _covariance(self) -> FloatArray:
        mount = np.diag(np.square(self.config.mount_sigma))
        return np.asarray(self._filter.covariance + self._straightener.late + mount)

    def update(self, measurement: Measurement) -> Estimate:
        """One pass of Fig. 2. Without a match the prediction stands."""
        measurement = replace(measurement, scan=measurement.scan.cut(self.config.range_max_m))
        motion, noise = measurement.motion, measurement.motion_covariance
        T_last, beam_times_s = self._T_last, measurement.scan.beam_times_s
        moved = self._predict(measurement.time_s, beam_times_s, motion, noise)  # step 1
        T_predicted = self.T_map_base
        since = compose_covariance(self._moved_noise, motion, noise)
        step = Step(T_last, T_predicted, self._filter.covariance, since)
        judged, said = self._judged(measurement, step, moved)
        # a match that is not to be used leaves the prediction as it is
        match = judged.match or ScanMatch(T_predicted, _UNUSED[judged.verdict.status])
        self._last = measurement
        scale = self._scales.match
        if judged.is_restart:
            nis = None
            self._restart(match)
        else:
            nis = self._correct(match)
        self._T_last, self._moved_noise = self.T_map_base, np.zeros((3, 3))
        fit = match.fit if match.is_matched else None
        # as it would be had the matches' covariances not been widened to fit
        unscaled = None if nis is None else nis * scale
        self._monitor.take(unscaled, fit, self._filter.strain, self._offset_m)
        if self._monitor.has_offset:
            self._offset_m = self._monitor.offset_m
        claims_nothing = self._claims_nothing or (self.guard is not None and self.guard.is_lost)
        covariance = None if claims_nothing else self._covariance
        return Estimate(
            measurement.time_s, T_predicted, self.T_map_base, match, covariance, nis,
            self._monitor.warnings + said, judged.verdict,
        )  # fmt: skip

    def move(self, time_s: float, motion: SE2, motion_covariance: FloatArray) -> None:
        """Follows the wheels to a time without a scan, as `update` would first do.

        Raises ValueError for a motion as `Measurement` does.
        """
        motion_covariance = checked_motion(time_s, motion, motion_covariance)
        moved = self._predict(time_s, None, motion, motion_covariance)
        self._moved_noise = compose_covariance(self._moved_noise, motion, motion_covariance)
        if self.guard is not None:
            self.guard.follow(moved)

    def telling_turn_rad(self) -> float:
        """The turn on the spot [rad] after which a scan would tell most of where the robot is.

        0 where none is needed, or nothing searches the map.
        """
        if self.guard is None or self._last is None:
            return 0.0
        return self.guard.telling_turn_rad(self._beams_of(self._last.scan))

    def _judged(
        self, measurement: Measurement, step: Step, moved: SE2
    ) -> tuple[Judgement, tuple[str, ...]]:
        """The scan matched, and what to make of it; while lost, searched for all over the map. What
        is to be said of the scan itself as well."""
        guard, scan = self.guard, measurement.scan
        if self._laser.repeats(scan):
            # the same noise twice is no second look: it would be counted as one
            if guard is not None:
                guard.carry(moved)
            return Judgement(Verdict(Status.UNSURE, (_FROZEN,)), None), ()
        beams, T_predicted = self._beams_of(scan), self.T_map_base
        look = Look(measurement.time_s, beams, self.matcher)
        if guard is not None:
            judged = (
                guard.search(look, moved, step.noise)
                if guard.is_lost
                else guard.carried_off(look, step)
            )
            if judged is not None:
                self._straightener.late = np.zeros((3, 3))  # that of the pose before is over
                return judged, ()
        match, said = self._straightener.matched(  # steps 2 to 7
            scan, lambda beams: self.matcher(beams.shortened(self._offset_m), T_predicted)
        )
        if guard is None:
            return Judgement(verdict_of(match), match), said
        return guard.judge(look, match, step), said

    def _predict(
        self, time_s: float, beam_times_s: FloatArray | None, motion: SE2, noise: FloatArray
    ) -> SE2:
        """Moves the pose on by what the wheels told up to a stamp; the motion as it truly was."""
        duration_s = self._straightener.duration_s(time_s, motion)
        moved = self._filter.predict(motion, duration_s, self._scales.motion * noise)
        self._viewpoint.move(moved)
        sigma = self._filter.motion_sigma
        self._straightener.take_motion(time_s, beam_times_s, moved, duration_s, sigma)
        return moved

    def _beams_of(self, scan: LaserScan) -> Beams:
        """The beams of a scan, straightened where the motion is known, freed of the offset."""
        return self._straightener.beams(scan).shortened(self._offset_m)

    def _restart(self, match: ScanMatch) -> None:
        """The pose is the match's, whatever was believed before."""
        known = match.information
        self._claims_nothing = known is None
        covariance = np.zeros((3, 3)) if known is None else covariance_held(known)
        self._filter.restart(match.T_map_base, covariance)
        self._viewpoint.take(is_anew=True)

    def _correct(self, match: ScanMatch) -> float | None:
        """The match made part of the pose; its normalised innovation squared, if it has one."""
        holds = match.is_matched or match.status is MatchStatus.DEGENERATE
        if match.information is None or not self.config.fuse:
            if holds:  # of a degenerate match, what it holds
                known = match.information
                self._claims_nothing = known is None
                covariance = np.zeros((3, 3)) if known is None else covariance_held(known)
                self._filter.restart(match.T_map_base, covariance)
            return None
        if not holds:
            return None
        whole, match = match, self._viewpoint.fresh(match)
        assert match.information is not None
        assert whole.information is not None
        information = match.information / self._scales.match
        nis = self._filter.innovation(match.T_map_base, information)
        told, own = self._filter.share_of_match(information)
        if nis <= self.config.max_nis or not self._is_elsewhere(match):
            self._filter.take(match, self._scales.match)
            self._viewpoint.take()
            if told:
                self._scales.learn(nis / told, own)
        elif match.is_matched:
            self._filter.restart(whole.T_map_base, covariance_held(whole.information))
            self._viewpoint.take(is_anew=True)
        self._claims_nothing = False
        return nis

    def _is_elsewhere(self, match: ScanMatch) -> bool:
        """Whether a match is farther from the prediction than wheels may slip."""
        assert match.information is not None
        information = match.information / self._scales.match
        nis = self._filter.innovation(match.T_map_base, information, after_slip=True)
        return nis > self.config.max_nis

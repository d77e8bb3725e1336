"""Self-localisation: odometry predicts, the laser corrects (Section 3.2, Fig. 2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.consistency import InnovationMonitor
from slam.deskew import BodyMotion, SweepClock, deskewed
from slam.fusion import PoseFilter, Viewpoint, WheelPrior, covariance_held, mixed
from slam.lost import Guard, Judgement, Status, Verdict, verdict_of
from slam.matchers import Matcher
from slam.measurements import LaserScan, Measurement
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2

_FROZEN = "the scan is the last one bit for bit: the laser has frozen"
_UNUSED = {
    Status.TRACKING: MatchStatus.NOT_ATTEMPTED,
    Status.UNSURE: MatchStatus.NOT_ATTEMPTED,
    Status.LOST: MatchStatus.LOST,
}
_DIMENSIONS = 3.0
"""Mean of a normalised innovation squared of as many numbers."""
_LATE = 9.0
"""Chosen: squared lateness, in standard deviations of the match, that is worth a word."""
_CHANGE_ODDS = np.array([-2.0, 0.0, -5.0, -5.0, -5.0])
"""Chosen, log of, for `BodyMotion.alternatives`: robots speed up evenly, most of the time."""
_TRUST = 0.1
"""Chosen: beams that pass edges make a scan's log-likelihood jump by 15 from one pose to the next."""
_PROBES = np.diag([0.02, 0.0, 0.02])[[0, 2]]
"""Ways within a sweep by which a first scan is tried for motion: 2 cm ahead, 20 mrad of a turn;
shorter ones tell less than beams at edges make the log-likelihood jump."""
_IS_MOVING = 15.0
"""Chosen: gain in log-likelihood. In 15 poses each of room_fig4 a robot at rest exceeded it in one, at
0.5 rad/s in all, at 0.2 m/s in ten, at 0.1 rad/s in two: slow motion is missed."""


@dataclass(frozen=True)
class LocalizerConfig:
    """How a `Localizer` follows the robot.

    deskew: straighten each scan by the wheels; False: take it as it is. sweep_s: what a scan without
    beam times may have taken, so that much the pose may be late. chosen: a slow laser's turn.
    fastest: (m/s, rad/s) of a robot of whose motion the first scan tells only that there is one.
    fuse: join a match that knows its covariance with the prediction; otherwise it replaces it.
    start_sigma_m,
    start_sigma_rad: how uncertain the first pose is, on each axis. max_nis: normalised innovation
    squared beyond which match and prediction contradict each other: a match that explains the scan
    is then believed alone. chosen: 30 is exceeded by chance once in a million. slip_nis: beyond it
    the prediction's variance is made to fit, since wheels do slip. match_scales: by how much the
    innovations seen may narrow and widen the matches' covariances.
    """

    deskew: bool = True
    sweep_s: float = 0.1
    fastest: tuple[float, float] = (0.5, 1.0)
    fuse: bool = True
    start_sigma_m: float = 0.1
    start_sigma_rad: float = 0.1
    max_nis: float = 30.0
    slip_nis: float = 12.0
    match_scales: tuple[float, float] = (0.5, 10.0)
    wheels: WheelPrior = field(default_factory=WheelPrior)

    def __post_init__(self) -> None:
        starts = (self.start_sigma_m, self.start_sigma_rad)
        if not all(math.isfinite(sigma) and sigma > 0.0 for sigma in starts):
            raise ValueError(f"start_sigma_m and start_sigma_rad must be above 0, not {starts}")
        if not 0.0 < self.slip_nis <= self.max_nis:
            raise ValueError(f"0 < slip_nis <= max_nis, not {self.slip_nis} and {self.max_nis}")
        low, high = self.match_scales
        if not 0.0 < low <= 1.0 <= high < math.inf:
            raise ValueError(f"match_scales must lie about 1, not {self.match_scales}")
        bounds = (self.sweep_s, *self.fastest)
        if not all(math.isfinite(bound) and bound >= 0.0 for bound in bounds):
            raise ValueError(f"sweep_s and fastest must be 0 or more, not {bounds}")


@dataclass(frozen=True, eq=False)
class Estimate:
    """What the robot believes after one measurement.

    T_map_base: the pose matched, fused with the prediction where the match knows its covariance;
    or the predicted one where nothing matched. covariance: (3, 3) of its tangent (x, y, theta) in
    the base frame, or None where the method claims nothing. nis: normalised innovation squared of
    the match. warnings: what does not fit map, laser or wheels, in words. verdict: whether the pose is to
    be believed, and why not; without a `Guard`, what the match says of itself.
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
    also start without a pose. Raises ValueError for a start without a pose and without a guard.
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
        self._motion: BodyMotion | None = None
        self._clock, self._viewpoint = SweepClock(), Viewpoint()
        self._last: Measurement | None = None
        self._lead_s = 0.0
        self._moved: FloatArray = np.zeros(3)
        self._late: FloatArray = np.zeros((3, 3))
        self._claims_nothing = False
        self._match_scale, self._fused = 1.0, 0
        self._offset_m = 0.0

    @property
    def T_map_base(self) -> SE2:
        """The pose at the last measurement."""
        return self._filter.T_map_base

    def update(self, measurement: Measurement) -> Estimate:
        """One pass of Fig. 2. Without a match the prediction stands."""
        motion, noise = measurement.motion, measurement.motion_covariance
        T_last, duration_s = self.T_map_base, self._clock.duration_s(measurement.time_s, motion)
        moved = self._filter.predict(motion, duration_s, noise)  # step 1
        self._viewpoint.move(moved)
        T_predicted = self.T_map_base
        self._take_motion(measurement.time_s, measurement.scan.beam_times_s, moved, duration_s)
        judged, said = self._judged(measurement, T_last, moved)
        # a match that is not to be used leaves the prediction as it is
        match = judged.match or ScanMatch(T_predicted, _UNUSED[judged.verdict.status])
        self._last = measurement
        scale = self._match_scale
        if judged.is_restart:
            nis = None
            self._restart(match)
        else:
            nis = self._correct(match)
        fit = match.fit if match.is_matched else None
        # as it would be had the matches' covariances not been widened to fit
        unscaled = None if nis is None else nis * scale
        self._monitor.take(unscaled, fit, self._filter.strain, self._offset_m)
        if self._monitor.has_offset:
            self._offset_m = self._monitor.offset_m
        claims_nothing = self._claims_nothing or (self.guard is not None and self.guard.is_lost)
        covariance = None if claims_nothing else self._filter.covariance + self._late
        return Estimate(
            measurement.time_s, T_predicted, self.T_map_base, match, covariance, nis,
            self._monitor.warnings + said, judged.verdict,
        )  # fmt: skip

    def move(self, time_s: float, motion: SE2, motion_covariance: FloatArray) -> None:
        """Follows the wheels to a time without a scan, as `update` would first do."""
        duration_s = self._clock.duration_s(time_s, motion)
        moved = self._filter.predict(motion, duration_s, motion_covariance)
        self._viewpoint.move(moved)
        self._take_motion(time_s, None, moved, duration_s)
        if self.guard is not None:
            self.guard.carry(moved)

    def telling_turn_rad(self) -> float:
        """The turn on the spot [rad] after which a scan would tell most of where the robot is.

        0 where none is needed, or nothing searches the map.
        """
        if self.guard is None or self._last is None:
            return 0.0
        return self.guard.telling_turn_rad(self._beams_of(self._last.scan))

    def _judged(
        self, measurement: Measurement, T_last: SE2, moved: SE2
    ) -> tuple[Judgement, tuple[str, ...]]:
        """The scan matched, and what to make of it; while lost, searched for all over the map.
        What is to be said of the scan itself as well."""
        guard, T_predicted, scan = self.guard, self.T_map_base, measurement.scan
        if self._is_repeated(measurement):
            # the same noise twice is no second look: it would be counted as one
            if guard is not None:
                guard.carry(moved)
            return Judgement(Verdict(Status.UNSURE, (_FROZEN,)), None), ()
        self._late = np.zeros((3, 3))
        if guard is not None and guard.is_lost:
            beams = self._beams_of(scan)
            return guard.search(beams, moved, self.matcher, measurement.time_s), ()
        match, said = self._straightened(scan)  # steps 2 to 7
        if guard is None:
            return Judgement(verdict_of(match), match), said
        judged = guard.judge(
            self._beams_of(scan), match, self.matcher, T_last, T_predicted,
            self._filter.covariance, measurement.motion_covariance, measurement.time_s,
        )  # fmt: skip
        return judged, said

    def _beams_of(self, scan: LaserScan) -> Beams:
        """The beams of a scan, straightened by the motion where it is known, freed of the offset."""
        if self._motion is None or scan.beam_times_s is None or not self.config.deskew:
            return Beams.of(scan, self.T_base_laser).shortened(self._offset_m)
        return deskewed(scan, self.T_base_laser, self._motion).shortened(self._offset_m)

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
        information = match.information / self._match_scale
        nis = self._filter.innovation(match.T_map_base, information)
        if nis <= self.config.max_nis:
            if nis > self.config.slip_nis:
                self._filter.loosen(nis / _DIMENSIONS)
            self._filter.update(match.T_map_base, information)
            self._viewpoint.take()
            self._learn_scale(nis)
        elif match.is_matched:
            self._filter.restart(whole.T_map_base, covariance_held(whole.information))
            self._viewpoint.take(is_anew=True)
        self._claims_nothing = False
        return nis

    def _learn_scale(self, nis: float) -> None:
        """Innovations tell how wide the matches' covariances truly are (Mehra, 1972)."""
        self._fused += 1
        share = 1.0 / min(self._fused + 20.0, 100.0)
        low, high = self.config.match_scales
        scale = self._match_scale * (1.0 + share * (min(nis, 12.0) / _DIMENSIONS - 1.0))
        self._match_scale = min(max(scale, low), high)

    def _take_motion(
        self, time_s: float, beam_times_s: FloatArray | None, moved: SE2, duration_s: float
    ) -> None:
        """Notes the motion up to a stamp; none where it is not known how long it took."""
        end_s, times_s = time_s, beam_times_s
        if times_s is None or not len(times_s):
            pass
        elif self._clock.is_told:
            self._lead_s = end_s - float(times_s.max())
        else:  # a stamp not to believe: the beams' own times tell when it ended
            end_s = float(times_s.max()) + self._lead_s
        self._moved, before, self._motion = moved.log(), self._motion, None
        if np.isfinite(duration_s):
            start_s = end_s - duration_s
            before = None if before is None else before.ended(start_s)
            self._motion = BodyMotion.over(moved, start_s, end_s, before)

    def _straightened(self, scan: LaserScan) -> tuple[ScanMatch, tuple[str, ...]]:
        """The match of a scan, straightened as far as it can be, and what is to be said of it."""
        motion = self._motion
        if motion is None:
            return self._match_of_unknown_motion(scan)
        if scan.beam_times_s is None or not self.config.deskew:
            return self._match_skewed(scan, motion)
        match = self._match_along(scan, motion)
        if match.information is None or motion.is_steady(match.information):
            return match, ()
        ways = motion.alternatives()
        found = [match if way is motion else self._match_along(scan, way) for way in ways]
        return _likeliest(found, _CHANGE_ODDS, _TRUST), ()

    def _match(self, beams: Beams) -> ScanMatch:
        return self.matcher(beams.shortened(self._offset_m), self.T_map_base)

    def _match_along(self, scan: LaserScan, motion: BodyMotion) -> ScanMatch:
        """The match of a scan straightened by a motion, less sure by what that does not know."""
        match = self._match(deskewed(scan, self.T_base_laser, motion))
        if match.information is None:
            return match
        return replace(match, information=motion.less_sure(match.information))

    def _match_skewed(
        self, scan: LaserScan, motion: BodyMotion
    ) -> tuple[ScanMatch, tuple[str, ...]]:
        """The match of a scan as it is, its lateness noted: an error that never averages out."""
        beams = Beams.of(scan, self.T_base_laser)
        match, sweep_s = self._match(beams), self.config.sweep_s
        if scan.beam_times_s is not None and len(beams):
            sweep_s = motion.end_s - float(scan.beam_times_s.min())
        lever_m = float(np.hypot(*beams.points.T).mean()) if beams.is_hit.any() else 0.0
        self._late = motion.lateness(min(sweep_s, motion.end_s - motion.start_s), lever_m)
        if match.information is None or np.trace(match.information @ self._late) < _LATE:
            return match, ()
        speed_mps, turn_radps = math.hypot(*motion.velocity[:2]), abs(motion.velocity[2])
        why = "it has no beam times" if scan.beam_times_s is None else "deskew is switched off"
        return match, (
            f"scan not straightened: {why}, and the robot moved at {speed_mps:.2f} m/s and"
            f" {turn_radps:.2f} rad/s",
        )

    def _match_of_unknown_motion(self, scan: LaserScan) -> tuple[ScanMatch, tuple[str, ...]]:
        """The match of a scan before any motion is known: at rest, unless it says otherwise."""
        match = self._match(Beams.of(scan, self.T_base_laser))
        times_s = scan.beam_times_s
        sweep_s = np.inf if times_s is None or not len(times_s) else float(np.ptp(times_s))
        if sweep_s == 0.0:
            return match, ()
        # the motion told took as long as the sweep at least
        self._late = np.outer(self._moved, self._moved) / 4.0
        if np.isinf(sweep_s) or match.information is None or match.log_likelihood is None:
            return match, ()
        late, is_moving = np.zeros((3, 3)), False
        fastest = np.array([self.config.fastest[0], 0.0, self.config.fastest[1]])
        for probe in _PROBES:
            gain, slope = self._tried(scan, match, probe / sweep_s)
            is_moving = is_moving or gain > _IS_MOVING
            off = slope * float(fastest @ (probe > 0.0)) * sweep_s / probe.max()
            late += np.outer(off, off)
        if not is_moving:
            return match, ()
        self._late = self._late + late
        return match, (
            "scan not straightened: the robot moved while it was taken, and nothing tells how",
        )

    def _tried(
        self, scan: LaserScan, match: ScanMatch, velocity: FloatArray
    ) -> tuple[float, FloatArray]:
        """Most that a motion along a velocity (3,) gains in log-likelihood; half the change (3,) of
        the pose from minus to plus that velocity."""
        end_s, back = scan.time_s, match.T_map_base.inverse()
        found = []
        for sign in (-1.0, 1.0):
            motion = BodyMotion.over(SE2.exp(sign * velocity), end_s - 1.0, end_s)
            found.append(self._match(deskewed(scan, self.T_base_laser, motion)))
        before, after = (
            -math.inf if one.log_likelihood is None else one.log_likelihood for one in found
        )
        first, last = ((back @ one.T_map_base).log() for one in found)
        assert match.log_likelihood is not None
        half, bend = (after - before) / 2.0, 2.0 * match.log_likelihood - before - after
        best = half * half / (2.0 * bend) if bend > 0.0 else 0.0
        gain = max(best, before - match.log_likelihood, after - match.log_likelihood)
        return gain, (last - first) / 2.0

    def _is_repeated(self, measurement: Measurement) -> bool:
        """True where a laser that froze gives the last scan once more, bit for bit."""
        if self._last is None:
            return False
        now, before = measurement.scan.ranges_m, self._last.scan.ranges_m
        return bool(np.isfinite(now).any() and np.array_equal(now, before, equal_nan=True))


def _likeliest(found: list[ScanMatch], log_odds: FloatArray, trust: float = 1.0) -> ScanMatch:
    """Those of several matches that hold, mixed by their odds and by what each says of the scan.

    trust: share of a log-likelihood that counts.
    """
    usable = [
        k for k, match in enumerate(found) if match.is_matched and match.information is not None
    ]
    if not usable:
        return found[0]
    log_likelihoods = np.array([found[k].log_likelihood or 0.0 for k in usable])
    return mixed([found[k] for k in usable], log_odds[usable] + trust * log_likelihoods)

"""The verdict: whether the robot is where it believes to be, why not, and where else it may be."""

from __future__ import annotations

import enum
import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.evidence import Evidence
from slam.hypotheses import Hypotheses, HypothesesConfig, most_telling_turn
from slam.matchers import Matcher
from slam.relocalization import Hypothesis, Relocalizer
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2, wrap_angle
from slam.verdict_limits import VerdictLimits


class Status(enum.Enum):
    """What a robot can say of its pose."""

    TRACKING = "tracking"  # the pose is believed
    UNSURE = "unsure"  # a best guess: the scan says too little, or too much for one place
    LOST = "lost"  # the pose believed before is wrong, or nothing on the map explains the scans


@dataclass(frozen=True)
class Verdict:
    """What the robot says of its pose, and why.

    reasons: in words, empty where all is as usual. hypotheses: places it may be at, most likely
    first, while it is not tracking. recovery_s: at the scan with which it tracks again, the time
    since it was lost, or since the first scan of one that had no idea.
    """

    status: Status
    reasons: tuple[str, ...] = ()
    hypotheses: tuple[Hypothesis, ...] = ()
    recovery_s: float | None = None


_STATUS_OF_MATCH = {
    MatchStatus.MATCHED: Status.TRACKING,
    MatchStatus.DEGENERATE: Status.UNSURE,
    MatchStatus.NOT_ATTEMPTED: Status.UNSURE,
    MatchStatus.LOST: Status.LOST,
    MatchStatus.NOT_CONVERGED: Status.LOST,
}


def verdict_of(match: ScanMatch) -> Verdict:
    """The verdict where a method stands alone, with no search of the map to ask."""
    status = _STATUS_OF_MATCH[match.status]
    reasons = () if status is Status.TRACKING else (f"scan match: {match.status.value}",)
    return Verdict(status, reasons)


@dataclass(frozen=True)
class GuardConfig:
    """How a `Guard` judges.

    hypotheses: None: what suits the map. jump_m, jump_rad: standard deviations of a match beside what it claims, when its innovation is
    judged; max_jump: normalised innovation squared that no wheel explains: 30 is exceeded by chance
    once in a million. slip_scans, slip_way_m, slip_m, slip_rad: over so many scans, or such a way, wheels and scans may differ by
    so much, and by what the wheels' own noise explains. slack: by which a fit may be worse than usual before the map is searched.
    patience: scans in a row that nothing explains before the robot says that it is lost.
    blocked_m, blocked_share: a laser of which that share of the beams ends so near, where the map has
    nothing, is blocked; blocked_all: wherever it is.
    min_hits: a scan of fewer says nothing. turn_rad: steps of looking around. drop: of the share that
    fits, below its mean so far, that is not usual where a map is poor. recheck_drop, recheck_m: a scan
    that was found to fit here best is not searched for again before it fits so much worse, or the
    robot went so far. Chosen, all of these.
    """

    hypotheses: HypothesesConfig | None = None
    jump_m: float = 0.03
    jump_rad: float = math.radians(1.2)
    max_jump: float = 30.0
    slip_scans: int = 10
    slip_way_m: float = 0.5
    slip_m: float = 0.05
    slip_rad: float = math.radians(3.0)
    slack: float = 0.02
    patience: int = 3
    blocked_m: float = 0.2
    blocked_share: float = 0.15
    blocked_all: float = 0.8
    min_hits: int = 20
    turn_rad: float = math.radians(40.0)
    drop: float = 0.15
    recheck_drop: float = 0.05
    recheck_m: float = 0.5


@dataclass(frozen=True)
class Judgement:
    """A verdict, with the match that the pose is to be corrected by; None: by none.

    is_restart: the match replaces the prediction instead of being joined with it.
    """

    verdict: Verdict
    match: ScanMatch | None
    is_restart: bool = False


class Guard:
    """Judges each match of a tracker, and searches the map when it is lost."""

    def __init__(
        self,
        relocalizer: Relocalizer,
        config: GuardConfig | None = None,
        *,
        is_lost: bool = False,
    ) -> None:
        self.relocalizer = relocalizer
        self.config = config or GuardConfig()
        self.is_lost = is_lost
        self._search = Hypotheses(relocalizer, self.config.hypotheses)
        self._limits: VerdictLimits | None = None
        self._lost_s: float | None = None
        self._unexplained = self._beaten = 0
        self._mean_inliers = 1.0
        self._judged = 0
        self._checked: tuple[float, SE2] | None = None
        self._way: deque[tuple[SE2, SE2, FloatArray]] = deque(maxlen=self.config.slip_scans)

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """The places carried along while the robot is lost."""
        return self._search.places

    def telling_turn_rad(self, beams: Beams) -> float:
        """The turn on the spot after which a scan would tell most; 0 where none is needed."""
        search = self._search
        if not self.is_lost or (search.places and search.margin >= search.margin_needed):
            return 0.0
        return most_telling_turn(self.relocalizer, search.rivals, beams, self.config.turn_rad)

    def limits(self, beams: Beams) -> VerdictLimits:
        """What is usual on this map; found at the first scan."""
        if self._limits is None:
            self._limits = VerdictLimits.calibrated(self.relocalizer, beams)
        return self._limits

    def carry(self, moved: SE2) -> None:
        """Takes a motion without a scan that says anything."""
        self._way.clear()
        if self.is_lost:
            self._search.move(moved)

    def search(self, beams: Beams, moved: SE2, matcher: Matcher, time_s: float) -> Judgement:
        """While lost: the places once more, by this scan too; tracking as soon as one is sure."""
        self._search.move(moved)
        if self._lost_s is None:
            self._lost_s = time_s
        useless = self._useless(beams)
        if useless:
            return Judgement(Verdict(Status.UNSURE, (useless,), self.hypotheses), None)
        return self._placed(beams, matcher, time_s)

    def judge(
        self,
        beams: Beams,
        match: ScanMatch,
        matcher: Matcher,
        T_last: SE2,
        T_predicted: SE2,
        covariance: FloatArray,
        noise: FloatArray,
        time_s: float,
    ) -> Judgement:
        """While tracking: whether to believe a match, given the pose before the wheels moved, the
        one that they predict, its covariance (3, 3), and that (3, 3) of their last motion."""
        useless = self._useless(beams)
        if useless:
            self._way.clear()
            return Judgement(Verdict(Status.UNSURE, (useless,)), None)
        blocked = self._blocked(beams, T_predicted)
        if blocked:
            self._way.clear()
            return self._blocked_or_carried(blocked, beams, matcher, T_predicted, time_s)
        limits = self._usual(beams)
        has_pose = match.is_matched or match.status is MatchStatus.DEGENERATE
        T_now = match.T_map_base if has_pose else T_predicted
        evidence = self.relocalizer.at(beams, T_now).evidence
        misfits = self._misfits(evidence, limits)
        jump = self._jump(match, T_predicted, covariance) if has_pose else None
        if jump is None and match.is_matched:
            self._learn(evidence)
            slip = self._slipping(T_last.inverse() @ T_predicted, T_now, noise)
            if slip:
                return Judgement(Verdict(Status.UNSURE, (slip, *misfits)), match)
            if not misfits or self._is_checked(evidence, T_now):
                self._unexplained = self._beaten = 0
                return Judgement(Verdict(Status.TRACKING, misfits), match)
        if jump is not None and match.is_matched and not misfits:
            slip = _slip(T_last, T_predicted, match.T_map_base)
            if slip:
                return Judgement(Verdict(Status.UNSURE, (slip,)), match, is_restart=True)
        found = Hypotheses(self.relocalizer, self.config.hypotheses)
        found.look(beams)
        if jump is not None and found.places:
            # a match that went astray: the search agrees with the wheels
            again = matcher(beams, found.places[0].T_map_base)
            if again.is_matched and self._jump(again, T_predicted, covariance) is None:
                return Judgement(Verdict(Status.TRACKING, misfits), again)
        if found.places and found.beats(T_predicted if jump else T_now, beams):
            self._beaten += 1
            reasons = (jump or "carried away: the scan fits another place far better", *misfits)
            if jump is None and self._beaten < found.config.beaten_scans:
                self._way.clear()
                return Judgement(Verdict(Status.UNSURE, reasons), None)
            return self._lost(found, reasons, matcher, beams, time_s)
        self._beaten = 0
        if jump is not None:
            # nothing tells the place matched from the one predicted: neither is believed yet
            lost = self._lost(found, (jump, *misfits), matcher, beams, time_s)
            return Judgement(lost.verdict, match if match.is_matched else None, is_restart=True)
        if match.status is MatchStatus.DEGENERATE:
            open_way = "the scan leaves a direction open: the wheels alone tell where along it"
            return Judgement(Verdict(Status.UNSURE, (open_way, *misfits)), match)
        if evidence.inlier_ratio < limits.wrong_inlier_ratio or not match.is_matched:
            self._unexplained += 1
            reason = "nothing on the map explains the scan"
            self._way.clear()
            if self._unexplained < self.config.patience:
                return Judgement(Verdict(Status.UNSURE, (reason, *misfits)), None)
            return self._lost(found, (reason, *misfits), matcher, beams, time_s)
        self._unexplained = 0
        # worse than usual, but best explained where the robot believes to be: people in the way
        self._checked = evidence.inlier_ratio, T_now
        return Judgement(Verdict(Status.TRACKING, misfits), match)

    def _blocked_or_carried(
        self, blocked: str, beams: Beams, matcher: Matcher, T_predicted: SE2, time_s: float
    ) -> Judgement:
        """A laser with something on it, unless there is a wall as near at another place."""
        found = Hypotheses(self.relocalizer, self.config.hypotheses)
        # where a robot can stand, some beams go farther than that
        is_all = np.mean(beams.ranges_m < self.config.blocked_m) > self.config.blocked_all
        places = () if is_all else found.look(beams)
        is_wall = bool(places) and not self._blocked(beams, places[0].T_map_base)
        if is_wall and found.beats(T_predicted, beams):
            reason = "carried away: the scan fits another place far better"
            return self._lost(found, (reason,), matcher, beams, time_s)
        return Judgement(Verdict(Status.UNSURE, (blocked,)), None)

    def _lost(
        self,
        found: Hypotheses,
        reasons: tuple[str, ...],
        matcher: Matcher,
        beams: Beams,
        time_s: float,
    ) -> Judgement:
        """Lost from now on; the best place is what the pose becomes, not yet believed."""
        self.is_lost, self._lost_s, self._checked = True, time_s, None
        self._unexplained = self._beaten = 0
        self._way.clear()
        self._search = found
        if not found.places:
            return Judgement(Verdict(Status.LOST, reasons), None)
        match = matcher(beams, found.places[0].T_map_base)
        return Judgement(Verdict(Status.LOST, reasons, found.places), match, is_restart=True)

    def _placed(self, beams: Beams, matcher: Matcher, time_s: float) -> Judgement:
        search, limits = self._search, self.limits(beams)
        places = search.look(beams)
        if not places:
            return Judgement(Verdict(Status.LOST, ("no place on the map fits the scan",)), None)
        best = places[0]
        match = matcher(beams, best.T_map_base)
        config = search.config
        if not best.T_map_base.is_near(match.T_map_base, config.drift_m, config.drift_rad):
            match = ScanMatch(best.T_map_base, MatchStatus.NOT_CONVERGED)
        elif not self.relocalizer.segment_map.is_exact:
            # along corridors fitted walls bend a beam match by decimetres, points on surfaces less:
            # 0.17 and 0.24 m against 0.02 and 0.14 m on the Intel log
            match = replace(match, T_map_base=best.T_map_base)
        blocked = self._blocked(beams, best.T_map_base)
        if blocked:
            return Judgement(Verdict(Status.UNSURE, (blocked,), places), None)
        reasons = list(self._misfits(best.evidence, limits))
        if best.evidence.inlier_ratio < limits.wrong_inlier_ratio:
            return Judgement(
                Verdict(Status.LOST, ("no place on the map explains the scan", *reasons), places),
                match, is_restart=True,
            )  # fmt: skip
        doubts = []
        if search.margin < search.margin_needed:
            doubts.append(
                f"another place fits nearly as well: log-likelihood margin {search.margin:.1f}"
                f" of {search.margin_needed:.1f} needed, after {search.views} views"
            )
        if search.unexplained > search.config.max_unexplained:
            doubts.append("the best place on the map explains too little of the scans")
        if search.streak < search.config.min_views:
            doubts.append(
                f"the best place through {search.streak} of {search.config.min_views} views needed"
            )
        if match.status is MatchStatus.DEGENERATE:
            doubts.append("the scan leaves a direction open")
        elif not match.is_matched:
            doubts.append(f"scan match: {match.status.value}")
        if self.relocalizer.segment_map.is_exact and best.evidence.violation_ratio > (
            2.0 * limits.usual_violation_ratio + self.config.slack
        ):
            doubts.append("beams went through walls")
        if doubts:
            verdict = Verdict(Status.UNSURE, (*doubts, *reasons), places)
            return Judgement(verdict, match, is_restart=True)
        recovery_s = time_s - (time_s if self._lost_s is None else self._lost_s)
        self.is_lost, self._lost_s = False, None
        self._search = Hypotheses(self.relocalizer, config)
        verdict = Verdict(Status.TRACKING, tuple(reasons), places, recovery_s)
        return Judgement(verdict, match, is_restart=True)

    def _misfits(self, evidence: Evidence, limits: VerdictLimits) -> tuple[str, ...]:
        """What is not as usual, in words."""
        slack, found = self.config.slack, []
        if evidence.inlier_ratio < limits.usual_inlier_ratio - slack:
            found.append(
                f"{100 * evidence.inlier_ratio:.0f} % of the beams fit the map,"
                f" usually {100 * limits.usual_inlier_ratio:.0f} % and more"
            )
        if evidence.violation_ratio > limits.usual_violation_ratio + slack:
            found.append(
                f"{100 * evidence.violation_ratio:.0f} % of the beams went through walls,"
                f" usually {100 * limits.usual_violation_ratio:.0f} % and less"
            )
        return tuple(found)

    def take_limits(self, limits: VerdictLimits) -> None:
        """Uses limits that another guard of the same map and laser has found."""
        self._limits = limits

    def _slipping(self, told: SE2, T_now: SE2, noise: FloatArray) -> str:
        """That wheels and scans have gone different ways over the last scans, in words; or nothing."""
        way, config = self._way, self.config
        way.append((T_now, told, noise))
        motion = SE2.identity()
        bound = 2.0 * np.diag(np.square([0.01, 0.01, 0.01]))
        T_then, went_m = T_now, 0.0
        for k in range(len(way) - 1, 0, -1):
            _, step, spread = way[k]
            motion, bound, T_then = step @ motion, bound + spread, way[k - 1][0]
            went_m += math.hypot(step.x, step.y)
            if went_m > config.slip_way_m:  # scans far apart: not the drift of ten metres
                break
        seen = T_then.inverse() @ T_now
        off = (motion.inverse() @ seen).log()
        if math.hypot(off[0], off[1]) < config.slip_m and abs(off[2]) < config.slip_rad:
            return ""
        if float(off @ np.linalg.solve(bound, off)) < config.max_jump:
            return ""
        return _slip_in_words(motion, seen)

    def _usual(self, beams: Beams) -> VerdictLimits:
        """The limits of the map, made wider where its scans have fitted less than it promised."""
        limits = self.limits(beams)
        if self.relocalizer.segment_map.is_exact:
            return limits  # a fault that lasts must not become usual
        usual = min(limits.usual_inlier_ratio, self._mean_inliers - self.config.drop)
        return replace(limits, usual_inlier_ratio=usual)

    def _learn(self, evidence: Evidence) -> None:
        self._judged += 1
        share = 1.0 / min(self._judged, 50)
        self._mean_inliers += share * (evidence.inlier_ratio - self._mean_inliers)

    def _is_checked(self, evidence: Evidence, T_now: SE2) -> bool:
        """Whether a search has lately found that such a scan fits best where the robot is."""
        if self._checked is None:
            return False
        inlier_ratio, T_then = self._checked
        went_m = math.hypot(T_now.x - T_then.x, T_now.y - T_then.y)
        is_worse = evidence.inlier_ratio < inlier_ratio - self.config.recheck_drop
        return not is_worse and went_m < self.config.recheck_m

    def _useless(self, beams: Beams) -> str:
        """Why a scan says nothing at all; empty where it may."""
        config, hits = self.config, beams.is_hit
        count = int(np.count_nonzero(hits))
        if count < min(config.min_hits, len(beams)):
            return f"{count} of {len(beams)} beams came back: no laser, or nothing in its reach"
        return ""

    def _blocked(self, beams: Beams, T_map_base: SE2) -> str:
        """That something sits on the laser: beams that end near by, where the map has nothing."""
        config = self.config
        with np.errstate(invalid="ignore"):
            is_near = beams.ranges_m < config.blocked_m  # -inf, too close, is near as well
        if np.count_nonzero(is_near) <= config.blocked_share * len(beams):
            return ""
        walls_m, _ = self.relocalizer.segment_map.ranges(beams, T_map_base, 2.0 * config.blocked_m)
        near = int(np.count_nonzero(is_near & (walls_m > 1.5 * config.blocked_m)))
        if near <= config.blocked_share * len(beams):
            return ""
        return f"{near} of {len(beams)} beams end within {config.blocked_m} m: laser blocked"

    def _jump(self, match: ScanMatch, T_predicted: SE2, covariance: FloatArray) -> str | None:
        """That the match is farther from the prediction than wheels and laser explain, in words."""
        config = self.config
        innovation = (T_predicted.inverse() @ match.T_map_base).log()
        bound = covariance + np.diag(np.square([config.jump_m, config.jump_m, config.jump_rad]))
        known = match.information
        if known is None:
            squared = float(innovation @ np.linalg.solve(bound, innovation))
        else:  # (bound + known^-1)^-1, which needs no inverse where a direction is open
            told = np.linalg.solve(np.eye(3) + known @ bound, known @ innovation)
            squared = float(innovation @ told)
        if not squared > config.max_jump:
            return None
        off_m = math.hypot(innovation[0], innovation[1])
        return (
            f"carried away: the scan is {off_m:.2f} m and {math.degrees(abs(innovation[2])):.0f}"
            " degrees from where the wheels say"
        )


def _slip(T_last: SE2, T_predicted: SE2, T_matched: SE2) -> str:
    """That the robot moved less than its wheels, along the way they told, in words; or nothing."""
    told, seen = T_last.inverse() @ T_predicted, T_last.inverse() @ T_matched
    told_m = math.hypot(told.x, told.y)
    # the point of the way told that is nearest to where the scan says
    share = (told.x * seen.x + told.y * seen.y) / max(told_m * told_m, 1e-12)
    share = min(max(share, 0.0), 1.0)
    beside_m = math.hypot(seen.x - share * told.x, seen.y - share * told.y)
    turned, turn_told = wrap_angle(seen.theta), wrap_angle(told.theta)
    beyond_rad = max(turned - max(turn_told, 0.0), min(turn_told, 0.0) - turned, 0.0)
    if beside_m > 0.05 or beyond_rad > math.radians(3.0):
        return ""
    return _slip_in_words(told, seen)


def _slip_in_words(told: SE2, seen: SE2) -> str:
    return (
        f"wheels slip or spin: they told {math.hypot(told.x, told.y):.2f} m and"
        f" {math.degrees(told.theta):.0f} degrees, the scans {math.hypot(seen.x, seen.y):.2f} m and"
        f" {math.degrees(seen.theta):.0f} degrees"
    )

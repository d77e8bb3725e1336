"""Whether the robot is where it believes to be, why not, and where else it may be."""

from __future__ import annotations

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.guard.guard_config import GuardConfig
from slam.guard.hypotheses import Hypotheses
from slam.guard.laser_faults import (
    CompanionMonitor,
    blocked,
    is_covered,
    says_nothing,
)
from slam.guard.last_views import LastViews
from slam.guard.look import Fit, Look, Step
from slam.guard.lost_search import LostSearch
from slam.guard.slip import SlipMonitor
from slam.guard.unmapped import UnmappedObstacle
from slam.guard.usual_fit import BestHere, UsualFit
from slam.in_steps import Steps, all_at_once
from slam.relocalization import Hypothesis, Relocalizer
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2
from slam.verdict import Judgement, Status, Verdict

_ELSEWHERE = "carried away: the scan fits another place far better"
_OUTVOTED = "carried away: the last views together fit another place far better"
_MOVED = "moved by no wheel, and the scan fits another place nearly as well"
_UNMAPPED = "something stands before the walls that is not on the map, or the robot was moved"


class Guard:
    """Judges each match of a tracker, and searches the map when it is lost."""

    def __init__(self, relocalizer: Relocalizer, config: GuardConfig | None = None) -> None:
        self.relocalizer = relocalizer
        self.config = config or GuardConfig()
        self.is_lost = False
        self._slip = SlipMonitor(self.config.slip)
        self._usual = UsualFit(relocalizer, self.config.usual)
        self._companion = CompanionMonitor(self.config.laser_faults)
        self._obstacle = UnmappedObstacle(relocalizer, self.config.unmapped)
        self._search, self._views = self._lost_search(), LastViews(self._hypotheses())
        self._unexplained = self._beaten = 0
        self._best_here = BestHere(self.config.recheck_drop, self.config.recheck_m)
        self._found: tuple[Look, Hypotheses] | None = None

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """The places carried along while the robot is lost."""
        return self._search.hypotheses.places

    @property
    def likely(self) -> SE2 | None:
        """While it is searched for: see `LostSearch`."""
        return self._search.likely

    def telling_turn_rad(self, beams: Beams) -> float:
        """The turn on the spot after which a scan would tell most; 0 where none is needed."""
        if not self.is_lost:
            return 0.0
        return self._search.telling_turn_rad(beams, self.config.turn_rad)

    def follow(self, moved: SE2) -> None:
        """Takes a part of the motion to the next scan."""
        if self.is_lost:
            self._search.hypotheses.move(moved)

    def carry(self, moved: SE2) -> None:
        """Takes a motion with a scan that says nothing."""
        self._slip.clear()
        self.follow(moved)

    def search(self, look: Look, moved: SE2, noise: FloatArray) -> Judgement:
        """While lost: the places once more, by this scan too; tracking as soon as one is sure."""
        return all_at_once(self.search_in_steps(look, moved, noise))

    def search_in_steps(self, look: Look, moved: SE2, noise: FloatArray) -> Steps[Judgement]:
        """The same, a piece at a time; nothing else is to be asked in between."""
        self._search.hypotheses.move(moved)
        self._search.begin(look.time_s)
        nothing = self._says_nothing(look.beams)
        if nothing:
            return Judgement(Verdict(Status.UNSURE, (nothing,), self.hypotheses), None)
        is_told = self._search.hypotheses.are_told(noise)
        judged = yield from self._search.look_in_steps(look, is_motion_known=is_told)
        if judged.verdict.status is Status.TRACKING:
            assert judged.match is not None
            # what told this place from the others goes on telling
            self._views = LastViews(self._search.hypotheses, judged.match.T_map_base)
            self.is_lost, self._search = False, self._lost_search()
        return judged

    def carried_off(self, look: Look, step: Step) -> Judgement | None:
        """While tracking, before any match: that the robot is plainly elsewhere; None where not.

        Where the wheels lead less than half of it fits as is usual, and the search of the map, which
        looks there too, keeps no place near by, but one that is surely more likely. To match such a
        scan from there is vain, and takes several times as long as the search. Where the map is poor
        a match that jumps is asked, since one scan that fits elsewhere does not tell.
        """
        beams, T_predicted = look.beams, step.T_predicted
        if self._search.hypotheses.config.beaten_scans > 1:
            return None
        if self.relocalizer.off_surfaces(beams, T_predicted) < self.config.off_surfaces:
            return None
        if self._says_nothing(beams) or self._blocked(beams, T_predicted):
            return None
        limits = self._usual.limits_here(beams)
        evidence = self.relocalizer.at(beams, T_predicted).evidence
        fits = max(limits.wrong_inlier_ratio, 0.5 * limits.usual_inlier_ratio)
        if evidence.inlier_ratio >= fits:
            return None
        found = self._looked(look)
        if not found.places or not found.beats(T_predicted, beams):
            return None
        near = self.config.near_m, self.config.near_rad
        if any(
            place.T_map_base.is_near(T_predicted, *near)
            or self._jump(ScanMatch(place.T_map_base, MatchStatus.MATCHED), step) is None
            for place in found.places
        ):
            return None
        misfits = self._usual.misfits(evidence, limits)
        return self._beaten_by(found, misfits, look)

    def judge(self, look: Look, match: ScanMatch, step: Step) -> Judgement:
        """While tracking: whether to believe the match of a scan."""
        nothing = self._says_nothing(look.beams)
        if nothing:
            self._slip.clear()
            return Judgement(Verdict(Status.UNSURE, (nothing,)), None)
        blocked = self._blocked(look.beams, step.T_predicted)
        if blocked:
            self._slip.clear()
            return self._blocked_or_carried(blocked, look, step)
        fit = self._fit(look, match, step)
        beside = self._beside_obstacle(fit, look, step)
        if beside is not None:
            return beside
        if match.is_matched:
            is_jump = fit.jump is not None
            judged = self._slipped(fit, step) if is_jump else self._followed(fit, step, look)
            if judged is not None:
                return judged
        found = self._looked(look)
        if fit.jump is not None:
            return self._jumped(fit.jump, fit, found, look, step)
        return self._misfitting(fit, found, look)

    def _hypotheses(self) -> Hypotheses:
        return Hypotheses(self.relocalizer, self.config.hypotheses)

    def _lost_search(
        self, found: Hypotheses | None = None, since_s: float | None = None
    ) -> LostSearch:
        found, faults = found or self._hypotheses(), self.config.laser_faults
        return LostSearch(self.relocalizer, found, self._usual, faults, since_s)

    def _looked(self, look: Look) -> Hypotheses:
        """The places that a scan alone suggests, searched for once."""
        if self._found is None or self._found[0] is not look:
            self._found = look, self._hypotheses()
            self._found[1].look(look.beams)
        return self._found[1]

    def _says_nothing(self, beams: Beams) -> str:
        return says_nothing(beams, self._usual.beam_count(beams), self.config.laser_faults)

    def _blocked(self, beams: Beams, T_map_base: SE2) -> str:
        walls = self.relocalizer.segment_map
        return blocked(beams, T_map_base, walls, self.config.laser_faults)

    def _fit(self, look: Look, match: ScanMatch, step: Step) -> Fit:
        limits = self._usual.limits_here(look.beams)
        has_pose = match.is_matched or match.status is MatchStatus.DEGENERATE
        T_now = match.T_map_base if has_pose else step.T_predicted
        evidence = self.relocalizer.at(look.beams, T_now).evidence
        jump = self._jump(match, step) if has_pose else None
        return Fit(match, T_now, evidence, self._usual.misfits(evidence, limits), jump)

    def _followed(self, fit: Fit, step: Step, look: Look) -> Judgement | None:
        """A match where the wheels lead; None where it fits too badly to be taken as it is."""
        self._usual.take(fit.evidence)
        slip = self._slip.take(fit.T_map_base, step.told, step.noise)
        if slip:
            reasons = slip, *fit.misfits
            if self._slip.is_moved(step.told, step.T_last.inverse() @ fit.T_map_base):
                # by somebody, who may as well have put it where the map looks the same
                found = self._looked(look)
                if found.has_other(fit.T_map_base):
                    return self._lost(found, (_MOVED, *reasons), fit.match, look.time_s)
            return Judgement(Verdict(Status.UNSURE, reasons), fit.match)
        if fit.misfits and not self._best_here.holds(fit.evidence.inlier_ratio, fit.T_map_base):
            return None
        self._unexplained = 0
        if self.relocalizer.segment_map.is_exact:
            # carried to where the map looks nearly the same, all fits but the little that differs; a
            # map made of scans never shows all, and one scan that fits elsewhere does not tell
            found = self._looked(look)
            if found.places and found.beats(fit.T_map_base, look.beams):
                return self._beaten_by(found, fit.misfits, look)
        self._beaten = 0
        return self._by_views(fit, look)

    def _by_views(self, fit: Fit, look: Look) -> Judgement:
        """Tracking, unless the last views together say otherwise.

        Lost where they surely are of another place; unsure where they fit nowhere on an exact map.
        """
        limits = self._usual.limits(look.beams)
        if self._views.is_new_from(fit.T_map_base):
            suggested, views = self._looked(look).suggested, self._views
            if views.is_elsewhere(look.beams, suggested, limits):
                found = views.hypotheses
                match = look.matched(found.places[0].T_map_base)
                return self._lost(found, (_OUTVOTED, *fit.misfits), match, look.time_s)
        odd = self._views.doubts(limits)
        status = Status.UNSURE if odd else Status.TRACKING
        walls = self.relocalizer.segment_map
        along = self._companion.take(look.beams, fit.T_map_base, walls)
        reasons = (*odd, *((along,) if along else ()), *fit.misfits)
        return Judgement(Verdict(status, reasons), fit.match)

    def _slipped(self, fit: Fit, step: Step) -> Judgement | None:
        """A match behind where the wheels lead, which fits; None where that is no slip."""
        seen = step.T_last.inverse() @ fit.T_map_base
        slip = "" if fit.misfits else self._slip.of_one_step(step.told, seen)
        if not slip:
            return None
        return Judgement(Verdict(Status.UNSURE, (slip,)), fit.match, is_restart=True)

    def _beside_obstacle(self, fit: Fit, look: Look, step: Step) -> Judgement | None:
        """A scan that an unmapped obstacle may spoil; None where it does not."""
        limits = self._usual.limits_here(look.beams)
        match = self._obstacle.match_beside(look, fit, step, limits, self._jump)
        if match is None:
            return None
        self._slip.clear()
        return Judgement(Verdict(Status.UNSURE, (_UNMAPPED, *fit.misfits)), match)

    def _jumped(self, jump: str, fit: Fit, found: Hypotheses, look: Look, step: Step) -> Judgement:
        """A match that no wheel explains: it went astray, or the robot was carried."""
        reasons = jump, *fit.misfits
        match = fit.match if fit.match.is_matched else None
        if found.places:
            again = look.matched(found.places[0].T_map_base)
            if again.is_matched and self._jump(again, step) is None:
                # the match went astray: the search agrees with the wheels
                return Judgement(Verdict(Status.TRACKING, fit.misfits), again)
            if found.beats(step.T_predicted, look.beams):
                match = again
        # else nothing tells the place matched from the one predicted: neither is believed yet
        return self._lost(found, reasons, match, look.time_s)

    def _misfitting(self, fit: Fit, found: Hypotheses, look: Look) -> Judgement:
        """A scan that fits worse than usual where the wheels lead."""
        if found.places and found.beats(fit.T_map_base, look.beams):
            return self._beaten_by(found, fit.misfits, look)
        self._beaten = 0
        if fit.match.status is MatchStatus.DEGENERATE:
            open_way = "the scan leaves a direction open: the wheels alone tell where along it"
            return Judgement(Verdict(Status.UNSURE, (open_way, *fit.misfits)), fit.match)
        limits = self._usual.limits(look.beams)
        if fit.evidence.inlier_ratio < limits.wrong_inlier_ratio or not fit.match.is_matched:
            self._unexplained += 1
            reasons = "nothing on the map explains the scan", *fit.misfits
            return self._lost_in_time(
                self._unexplained >= self.config.patience, reasons, found, look
            )
        self._unexplained = 0
        # worse than usual, but best explained where the robot believes to be: people in the way
        self._best_here.take(fit.evidence.inlier_ratio, fit.T_map_base)
        if len(fit.misfits) > 1 and self.relocalizer.segment_map.is_exact:
            # people hide walls; that beams go through them as well is another building's
            return Judgement(Verdict(Status.UNSURE, fit.misfits), fit.match)
        return self._by_views(fit, look)

    def _blocked_or_carried(self, blocked: str, look: Look, step: Step) -> Judgement:
        """A laser with something on it, unless there is a wall as near at another place."""
        found = self._hypotheses()
        is_all = is_covered(look.beams, self.config.laser_faults)
        places = () if is_all else found.look(look.beams)
        is_wall = bool(places) and not self._blocked(look.beams, places[0].T_map_base)
        if is_wall and found.beats(step.T_predicted, look.beams):
            return self._lost_in_time(True, (_ELSEWHERE,), found, look)
        return Judgement(Verdict(Status.UNSURE, (blocked,)), None)

    def _beaten_by(self, found: Hypotheses, misfits: tuple[str, ...], look: Look) -> Judgement:
        """A scan that fits another place far better, through as many in a row as it takes."""
        self._beaten += 1
        is_time = self._beaten >= found.config.beaten_scans
        return self._lost_in_time(is_time, (_ELSEWHERE, *misfits), found, look)

    def _lost_in_time(
        self, is_time: bool, reasons: tuple[str, ...], found: Hypotheses, look: Look
    ) -> Judgement:
        """Lost if it is time to say so, at the best place, which is not yet believed."""
        if not is_time:
            self._slip.clear()
            return Judgement(Verdict(Status.UNSURE, reasons), None)
        match = look.matched(found.places[0].T_map_base) if found.places else None
        return self._lost(found, reasons, match, look.time_s)

    def _lost(
        self,
        found: Hypotheses,
        reasons: tuple[str, ...],
        match: ScanMatch | None,
        time_s: float,
    ) -> Judgement:
        """Lost from now on; the match is what the pose becomes."""
        self.is_lost = True
        self._best_here.clear()
        self._obstacle.clear()
        self._unexplained = self._beaten = 0
        self._slip.clear()
        self._search, self._views = self._lost_search(found, time_s), LastViews(self._hypotheses())
        verdict = Verdict(Status.LOST, reasons, found.places)
        return Judgement(verdict, match, is_restart=match is not None)

    def _jump(self, match: ScanMatch, step: Step) -> str | None:
        config = self.config
        return step.jump(match, (config.jump_m, config.jump_rad), config.max_jump)

"""How a robot that is lost searches its map, scan by scan, until one place is sure."""

from __future__ import annotations

from dataclasses import replace

from slam.beams import Beams
from slam.guard.hypotheses import Hypotheses
from slam.guard.laser_faults import LaserFaultConfig, blocked
from slam.guard.look import Look
from slam.guard.telling_turn import most_telling_turn
from slam.guard.usual_fit import UsualFit
from slam.guard.verdict_limits import VerdictLimits
from slam.in_steps import Steps
from slam.relocalization import Hypothesis, Relocalizer
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2
from slam.verdict import Judgement, Status, Verdict


class LostSearch:
    """One search, from the scan that showed the robot lost, or the first one, to the one that places it.

    hypotheses: the places to begin with. since_s: when it was lost; None: at the next scan.
    """

    def __init__(
        self,
        relocalizer: Relocalizer,
        hypotheses: Hypotheses,
        usual: UsualFit,
        laser_faults: LaserFaultConfig,
        since_s: float | None = None,
    ) -> None:
        self.hypotheses = hypotheses
        self.since_s = since_s
        self._relocalizer, self._usual, self._laser_faults = relocalizer, usual, laser_faults

    def telling_turn_rad(self, beams: Beams, step_rad: float) -> float:
        """The turn on the spot after which a scan would tell most; 0 where none is needed."""
        search = self.hypotheses
        if search.places and search.margin >= search.margin_needed:
            # one place is left: other views of it may be missing
            return 0.0 if search.is_enough(self._usual.limits(beams)) else step_rad
        return most_telling_turn(self._relocalizer, search.rivals, beams, step_rad)

    @property
    def likely(self) -> SE2 | None:
        """The place that is by far the best one through views enough, however little of them it explains; None
        where there is none: on a part of a map, where the rest is not mapped, no place explains more."""
        search = self.hypotheses
        is_best = search.margin >= search.margin_needed and search.streak >= search.config.min_views
        return search.places[0].T_map_base if search.places and is_best else None

    def begin(self, time_s: float) -> float:
        """When the search began: at this scan, if at none before."""
        if self.since_s is None:
            self.since_s = time_s
        return self.since_s

    def look_in_steps(self, look: Look, *, is_motion_known: bool = True) -> Steps[Judgement]:
        """The places once more, by this scan too, a piece at a time; tracking as soon as one is sure."""
        since_s = self.begin(look.time_s)
        limits = yield from self._usual.limits_in_steps(look.beams)
        places = yield from self.hypotheses.look_in_steps(
            look.beams, is_motion_known=is_motion_known
        )
        if not places:
            return Judgement(Verdict(Status.LOST, ("no place on the map fits the scan",)), None)
        best = places[0]
        match = self._match_at(best, look)
        walls = self._relocalizer.segment_map
        hidden = blocked(look.beams, best.T_map_base, walls, self._laser_faults)
        if hidden:
            return Judgement(Verdict(Status.UNSURE, (hidden,), places), None)
        misfits = self._usual.misfits(best.evidence, limits)
        if best.evidence.inlier_ratio < limits.wrong_inlier_ratio:
            reasons = "no place on the map explains the scan", *misfits
            return Judgement(Verdict(Status.LOST, reasons, places), match, is_restart=True)
        doubts = self._doubts(best, match, limits)
        if doubts:
            verdict = Verdict(Status.UNSURE, (*doubts, *misfits), places)
            return Judgement(verdict, match, is_restart=True)
        verdict = Verdict(Status.TRACKING, misfits, places, max(look.time_s - since_s, 0.0))
        return Judgement(verdict, match, is_restart=True)

    def _match_at(self, best: Hypothesis, look: Look) -> ScanMatch:
        """The match of a scan at the best place; not converged where it leads away from there."""
        match, config = look.matched(best.T_map_base), self.hypotheses.config
        if not best.T_map_base.is_near(match.T_map_base, config.drift_m, config.drift_rad):
            return ScanMatch(best.T_map_base, MatchStatus.NOT_CONVERGED)
        if self._relocalizer.segment_map.is_exact:
            return match
        # along corridors fitted walls bend a beam match by decimetres, points on surfaces less:
        # 0.17 and 0.24 m against 0.02 and 0.14 m on the Intel log
        return replace(match, T_map_base=self._relocalizer.centred(look.beams, best.T_map_base))

    def _doubts(self, best: Hypothesis, match: ScanMatch, limits: VerdictLimits) -> tuple[str, ...]:
        """Why the best place is not to be believed yet, in words."""
        doubts = list(self.hypotheses.doubts(limits))
        if match.status is MatchStatus.DEGENERATE:
            doubts.append("the scan leaves a direction open")
        elif not match.is_matched:
            doubts.append(match.said)
        if self._usual.has_violations(best.evidence, limits):
            doubts.append("beams went through walls")
        return tuple(doubts)

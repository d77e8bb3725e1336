"""Where the robot may be, judged by all scans since it was lost: likelihoods summed over views."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.guard.hypotheses_config import HypothesesConfig
from slam.guard.verdict_limits import VerdictLimits
from slam.in_steps import Steps, all_at_once
from slam.relocalization import REFINED, Hypothesis, Relocalizer
from slam.se2 import SE2


@dataclass
class _View:
    """A scan, and the pose it was taken at as seen from the robot now."""

    beams: Beams
    T_now_then: SE2


class Hypotheses:
    """The places where the robot may be, most likely first, after any number of scans."""

    def __init__(self, relocalizer: Relocalizer, config: HypothesesConfig | None = None) -> None:
        self.config = config or HypothesesConfig.fit_for(relocalizer.segment_map)
        self.places: tuple[Hypothesis, ...] = ()
        self._relocalizer = relocalizer
        self._views: list[_View] = []
        self._witnesses: list[_View] = []
        self.suggested: tuple[Hypothesis, ...] | None = None
        self._went_m = self._turned_rad = 0.0
        self.streak = 0
        """Views in a row through which the best place has been the same."""

    @property
    def views(self) -> int:
        """Scans that the likelihoods are sums over."""
        return len(self._witnesses) + (1 if self._views else 0)

    @property
    def is_map_exact(self) -> bool:
        """Whether the map shows all there is; one of scans or cells never does."""
        return self._relocalizer.segment_map.is_exact

    def move(self, motion: SE2) -> None:
        """Carries all places along with the robot."""
        self._went_m += math.hypot(motion.x, motion.y)
        self._turned_rad += abs(motion.theta)
        back = motion.inverse()
        for view in self._views:
            view.T_now_then = back @ view.T_now_then
        self.places = tuple(
            replace(place, T_map_base=place.T_map_base @ motion) for place in self.places
        )

    def look(
        self,
        beams: Beams,
        suggested: tuple[Hypothesis, ...] | None = None,
        T_believed: SE2 | None = None,
        *,
        is_motion_known: bool = True,
    ) -> tuple[Hypothesis, ...]:
        """The places once more, with one scan more; those that the scan alone suggests among them.

        suggested: those, where they are known already. T_believed: a place that is asked in any case,
        though the search, which returns a few, may not have it among them. is_motion_known: False:
        the robot moved as the best place did, since no wheels tell.
        """
        return all_at_once(
            self.look_in_steps(beams, suggested, T_believed, is_motion_known=is_motion_known)
        )

    def look_in_steps(
        self,
        beams: Beams,
        suggested: tuple[Hypothesis, ...] | None = None,
        T_believed: SE2 | None = None,
        *,
        is_motion_known: bool = True,
    ) -> Steps[tuple[Hypothesis, ...]]:
        """The same, a piece at a time; the places are not to be asked for in between."""
        is_new_view = self._see(beams)
        before = self.places[:1]
        relocalizer = self._relocalizer
        carried = [place.T_map_base for place in self.places]
        if T_believed is not None:
            carried.append(T_believed)
        starts = []
        for T_map_base in carried:
            yield REFINED
            starts.append(relocalizer.refined(beams, T_map_base))
        if suggested is None:
            suggested = tuple((yield from relocalizer.in_steps(beams)))
        self.suggested = suggested
        starts += suggested
        joined = []
        # however bad a place is by this scan alone, the other views may speak for it
        for start in relocalizer.distinct(starts, math.inf):
            yield REFINED * len(self._witnesses)
            joined.append(self._joined(start, beams))
        most = max((one.log_likelihood for one in joined), default=0.0)
        behind = max(relocalizer.config.max_behind, 2.0 * self._margin_needed(most, self.views))
        self.places = self._ranked(relocalizer.distinct(joined, behind)[: self.config.max_places])
        drift = self.config.drift_m, self.config.drift_rad
        if not (before and self.places) or not self.places[0].T_map_base.is_near(
            before[0].T_map_base, *drift
        ):
            self.streak, self._went_m, self._turned_rad = 1, 0.0, 0.0
        else:
            self.streak += is_new_view
            if not is_motion_known:
                self._follow(before[0].T_map_base.inverse() @ self.places[0].T_map_base)
        return self.places

    def are_told(self, noise: FloatArray) -> bool:
        """Whether wheels with a noise (3, 3) tell of a motion, or there are none."""
        config = self.config
        sigma_m, sigma_rad = math.sqrt(max(noise[0, 0], noise[1, 1])), math.sqrt(noise[2, 2])
        return sigma_m < config.drift_m and sigma_rad < config.drift_rad

    def _follow(self, motion: SE2) -> None:
        """The same views from where the robot is after a motion that `move` was not told of."""
        places, self.places = self.places, ()
        self.move(motion)
        self.places = places

    @property
    def margin(self) -> float:
        """By how much the best place is more likely than any other; inf where there is none.

        Below 0 where another is, but nearly as likely and a worse fit.
        """
        most = max((place.log_likelihood for place in self.places[1:]), default=-math.inf)
        return self.places[0].log_likelihood - most if self.places else math.inf

    @property
    def unexplained(self) -> float:
        """What the best place leaves unexplained: of log-likelihood, per view and beam."""
        if not self.places:
            return 0.0
        used = max(self.places[0].evidence.used, 1.0)
        return -self.places[0].log_likelihood / (max(self.views, 1) * used)

    @property
    def violation_ratio(self) -> float:
        """Share of the beams that went through walls at the best place, over the views."""
        return self.places[0].violations / max(self.views, 1) if self.places else 0.0

    def doubts(self, limits: VerdictLimits) -> tuple[str, ...]:
        """Why the best place is not to be believed yet, in words; none of it, if it is."""
        doubts = []
        if self.margin < self.margin_needed:
            doubts.append(
                f"another place fits nearly as well: log-likelihood margin {self.margin:.1f}"
                f" of {self.margin_needed:.1f} needed, after {self.views} views"
            )
        doubts += self.misfits(limits)
        views_needed = self.views_needed(limits)
        if self.streak < views_needed:
            doubts.append(f"the best place through {self.streak} of {views_needed} views needed")
        elif not self.is_enough(limits):
            doubts.append("the best place explains little, and only through a small turn yet")
        return tuple(doubts)

    def misfits(self, limits: VerdictLimits) -> tuple[str, ...]:
        """Why the best place may be none at all, in words: the scans may be of another building."""
        config, said = self.config, []
        if self.unexplained > config.max_unexplained:
            said.append("the best place on the map explains too little of the scans")
        is_little = self.unexplained > limits.usual_unexplained
        are_walls_missing = self.violation_ratio > limits.usual_violation_ratio
        if config.strange_views and is_little and are_walls_missing:
            said.append("the best place on the map explains little, and walls are missing there")
        return tuple(said)

    def is_enough(self, limits: VerdictLimits) -> bool:
        """Whether the best place was that through enough views, far enough from each other."""
        config = self.config
        is_around = self._went_m >= config.around_m or self._turned_rad >= config.around_rad
        return self.streak >= self.views_needed(limits) and (
            is_around or not self._is_strange(limits)
        )

    def views_needed(self, limits: VerdictLimits) -> int:
        """Through how many views the best place has to be the best."""
        return max(self.config.min_views, self._is_strange(limits) * self.config.strange_views)

    def _is_strange(self, limits: VerdictLimits) -> bool:
        if not self.config.strange_views:
            return False
        most_through = limits.usual_violation_ratio + self.config.slack
        return self.unexplained > limits.usual_unexplained or self.violation_ratio > most_through

    def lead_over(self, T_map_base: SE2) -> float:
        """By how much the best place is more likely than a pose; 0 where that is the best place.

        inf where none of the places is near the pose, which is then far less likely.
        """
        near = self.config.drift_m, self.config.drift_rad
        if not self.places or self.places[0].T_map_base.is_near(T_map_base, *near):
            return 0.0
        here = [
            one.log_likelihood for one in self.places if one.T_map_base.is_near(T_map_base, *near)
        ]
        return self.places[0].log_likelihood - max(here, default=-math.inf)

    @property
    def margin_needed(self) -> float:
        """The margin from which on the best place is sure."""
        most = self.places[0].log_likelihood if self.places else 0.0
        return self._margin_needed(most, self.views)

    @property
    def rivals(self) -> tuple[Hypothesis, ...]:
        """The best place and those that are not yet so much less likely that it is sure."""
        most = max((place.log_likelihood for place in self.places), default=0.0)
        return _behind(self.places, self._margin_needed(most, self.views))

    def has_other(self, T_map_base: SE2) -> bool:
        """Whether a place elsewhere than a pose is nearly as likely as any."""
        apart = self.config.drift_m, self.config.drift_rad
        return any(not rival.T_map_base.is_near(T_map_base, *apart) for rival in self.rivals)

    def beats(self, T_map_base: SE2, beams: Beams) -> bool:
        """Whether the most likely place surely is more so than a pose, by this scan alone."""
        best = max(self.places, key=lambda place: place.log_likelihood)
        other = self._within_drift(beams, T_map_base)
        margin = self._relocalizer.at(beams, best.T_map_base).log_likelihood - other.log_likelihood
        needed = self._margin_needed(best.evidence.log_likelihood, views=1)
        return margin > self.config.beats * needed

    def _margin_needed(self, log_likelihood: float, views: int) -> float:
        """For a place of a log-likelihood summed over views."""
        config = self.config
        least = config.min_margin + config.min_margin_per_view * max(views - 1, 0)
        return least + config.min_share * max(-log_likelihood, 0.0)

    def _ranked(self, places: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
        """Places, the most likely first; of those that differ by chance, by how well they fit too."""
        alike = _behind(places, self.config.min_margin)
        first = sorted(alike, key=lambda place: -(place.log_likelihood + place.surface_fit))
        return (*first, *places[len(alike) :])

    @property
    def has_view_from_here(self) -> bool:
        """Whether a scan has been taken up from here, or so near by that it is the same view."""
        return any(self._is_same(view) for view in self._views)

    def _see(self, beams: Beams) -> bool:
        """Takes up a scan; whether from where none was taken before."""
        others = [view for view in self._views if not self._is_same(view)]
        self._witnesses = others[max(len(others) - self.config.max_views + 1, 0) :]
        # measured from where a view was first taken: replaced scan by scan, it would come along
        # with a robot that turns slowly, and never be joined by another
        is_new = len(others) == len(self._views)
        if is_new:
            self._views.append(_View(beams, SE2.identity()))
            del self._views[: -self.config.max_views]
        return is_new

    def _is_same(self, view: _View) -> bool:
        return view.T_now_then.is_near(SE2.identity(), self.config.view_m, self.config.view_rad)

    def _joined(self, place: Hypothesis, beams: Beams) -> Hypothesis:
        """With what the other views say for the place."""
        total, T_then, T_now_then = place.evidence.log_likelihood, place.T_map_base, SE2.identity()
        violations = place.evidence.violation_ratio
        fit = self._relocalizer.surface_fit(beams, place)
        # back from view to view, so that the wheels are trusted from one to the next alone
        for view in reversed(self._witnesses):
            T_then = T_then @ (T_now_then.inverse() @ view.T_now_then)
            T_now_then = view.T_now_then
            refined = self._within_drift(view.beams, T_then)
            T_then = refined.T_map_base
            total += refined.log_likelihood
            fit += self._relocalizer.surface_fit(view.beams, refined)
            violations += refined.violations
        return replace(place, log_likelihood=total, surface_fit=fit, violations=violations)

    def _within_drift(self, beams: Beams, T_map_base: SE2) -> Hypothesis:
        """The hypothesis near a pose, no farther than the wheels may be wrong; else the pose."""
        refined = self._relocalizer.refined(beams, T_map_base)
        if refined.T_map_base.is_near(T_map_base, self.config.drift_m, self.config.drift_rad):
            return refined
        return self._relocalizer.at(beams, T_map_base)


def _behind(places: Sequence[Hypothesis], margin: float) -> tuple[Hypothesis, ...]:
    """Those less likely than the most likely by no more than a margin."""
    most = max((place.log_likelihood for place in places), default=0.0)
    return tuple(place for place in places if place.log_likelihood >= most - margin)

"""What the last views together say of where a robot believes that it is."""

from __future__ import annotations

from slam.beams import Beams
from slam.hypotheses import Hypotheses, HypothesesConfig
from slam.relocalization import Hypothesis, Relocalizer
from slam.se2 import SE2
from slam.verdict_limits import VerdictLimits


class LastViews:
    """The places that the scans of a robot which tracks suggest, summed over views.

    One scan may fit a lookalike, a map that lacks things or another building well enough; the views
    of a way tell.
    """

    def __init__(self, relocalizer: Relocalizer, config: HypothesesConfig | None) -> None:
        self.hypotheses = Hypotheses(relocalizer, config)
        self._is_exact = relocalizer.segment_map.is_exact
        self._T_last: SE2 | None = None

    def is_new_from(self, T_map_base: SE2) -> bool:
        """Carries all along to where a match says that the robot is; whether no view is from there.

        As the scans saw it, not the wheels, which may have slipped.
        """
        if self._T_last is not None:
            self.hypotheses.move(self._T_last.inverse() @ T_map_base)
        self._T_last = T_map_base
        return not self.hypotheses.has_view_from_here

    def is_elsewhere(
        self, beams: Beams, suggested: tuple[Hypothesis, ...] | None, limits: VerdictLimits
    ) -> bool:
        """With one view more, whether all together surely are of another place than believed."""
        assert self._T_last is not None
        hypotheses, config = self.hypotheses, self.hypotheses.config
        places = hypotheses.look(beams, suggested)
        near = config.drift_m, config.drift_rad
        if not places or places[0].T_map_base.is_near(self._T_last, *near):
            return False
        is_sure = hypotheses.margin >= config.beats * hypotheses.margin_needed
        return is_sure and not hypotheses.doubts(limits)

    def misfits(self, limits: VerdictLimits) -> tuple[str, ...]:
        """Why an exact map may be of another building, in words; a map of scans never shows all."""
        return self.hypotheses.misfits(limits) if self._is_exact else ()

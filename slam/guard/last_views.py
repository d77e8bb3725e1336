"""What the last views together say of where a robot believes that it is."""

from __future__ import annotations

from slam.beams import Beams
from slam.guard.hypotheses import Hypotheses
from slam.guard.verdict_limits import VerdictLimits
from slam.relocalization import Hypothesis
from slam.se2 import SE2

_BEATEN = "the last views together fit another place better, though not surely"

_DOUBT = 0.5
"""Chosen: of the margin that makes another place sure: from there on the one believed is doubted."""


class LastViews:
    """The places that the scans of a robot which tracks suggest, summed over views.

    One scan may fit a lookalike, a map that lacks things or another building well enough; the views
    of a way tell.
    """

    def __init__(self, hypotheses: Hypotheses, T_map_base: SE2 | None = None) -> None:
        """hypotheses: the views so far, taken from a pose; None: there are none yet."""
        self.hypotheses = hypotheses
        self._T_last = T_map_base
        self._is_beaten = False

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
        hypotheses = self.hypotheses
        hypotheses.look(beams, suggested, self._T_last)
        lead, needed = hypotheses.lead_over(self._T_last), hypotheses.margin_needed
        doubt = max(_DOUBT * needed, hypotheses.config.min_margin)
        if lead >= doubt:
            self._is_beaten = True
        elif lead <= 0.0 and hypotheses.margin >= doubt:
            # not when what spoke against it is out of view: it has to be refuted
            self._is_beaten = False
        is_sure = lead >= needed
        return is_sure and not hypotheses.doubts(limits)

    def doubts(self, limits: VerdictLimits) -> tuple[str, ...]:
        """Why the place believed may be the wrong one, in words, as of the last new view.

        Another fits better, though not surely, or has since it last fitted so much worse; an exact map
        fits nowhere, and may be of another building. One of scans never shows all.
        """
        beaten = (_BEATEN,) if self._is_beaten else ()
        return beaten + (self.hypotheses.misfits(limits) if self.hypotheses.is_map_exact else ())

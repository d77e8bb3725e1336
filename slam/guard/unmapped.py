"""Something before the walls that the map lacks: where the robot is without what is seen of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from slam.arrays import BoolArray
from slam.beams import Beams
from slam.evidence import Evidence
from slam.guard.look import Fit, Look, Step
from slam.guard.verdict_limits import VerdictLimits
from slam.kernels.beam_search import reach_of
from slam.relocalization import Relocalizer
from slam.scan_match import ScanMatch
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap

_HOPELESS = 0.15
"""Chosen: of beams through walls a few centimetres from where the robot is, which no obstacle makes."""


@dataclass(frozen=True)
class UnmappedConfig:
    """When what a scan shows may be an unmapped obstacle.

    before_m: what ends farther before a wall is not the wall. aside_m, aside_rad: by as much as
    either the match without such beams is another. away_m, away_rad: farther than either an obstacle
    draws none. min_share: of the beams that have to meet their walls all the same, if more do at no
    wrong place; min_explained: of those that do not end before them. slack: of the share that goes
    through walls, more than usual. Chosen, all of these.
    """

    before_m: float = 0.06
    aside_m: float = 0.05
    aside_rad: float = math.radians(2.0)
    away_m: float = 1.0
    away_rad: float = math.radians(10.0)
    min_share: float = 0.4
    min_explained: float = 0.85
    slack: float = 0.02

    @staticmethod
    def fit_for(segment_map: SegmentMap) -> UnmappedConfig:
        """As it is for a map that is exactly known; wider for one that was made of scans."""
        if segment_map.is_exact:
            return UnmappedConfig()
        return UnmappedConfig(before_m=0.15, aside_m=0.2, aside_rad=math.radians(6.0))


class UnmappedObstacle:
    """A row of furniture, put before a wall since the map was made, is taken for the wall by a match.

    A scan alone does not tell that from a robot carried by as much; but then beams would go through
    walls where the wheels lead.
    """

    def __init__(self, relocalizer: Relocalizer, config: UnmappedConfig | None = None) -> None:
        self.config = config or UnmappedConfig.fit_for(relocalizer.segment_map)
        self._relocalizer = relocalizer
        self._is_beside = False

    def clear(self) -> None:
        """Forgets what the robot was beside."""
        self._is_beside = False

    def match_beside(
        self,
        look: Look,
        fit: Fit,
        step: Step,
        limits: VerdictLimits,
        jump: Callable[[ScanMatch, Step], str | None],
    ) -> ScanMatch | None:
        """The match without what ends before the walls where the wheels lead; None where no obstacle
        spoils the one of all beams, or that cannot be told from a robot carried away.

        fit: of all beams. jump: why a match is no wheels' doing, None where it may be.
        """
        was_beside, self._is_beside = self._is_beside, False
        # along it the obstacle may fit a wall as well as is usual, on a map of scans from the first;
        # where all is known a carried robot fits at once
        is_odd = fit.jump is not None and not self._relocalizer.segment_map.is_exact
        if not (fit.misfits or was_beside or is_odd):
            return None
        config, T_predicted = self.config, step.T_predicted
        if not fit.T_map_base.is_near(T_predicted, config.away_m, config.away_rad):
            return None
        there = self._relocalizer.at(look.beams, T_predicted).evidence
        if there.violation_ratio > _HOPELESS or there.inlier_ratio < 0.5 * config.min_share:
            return None  # a tenth of the time of a match
        match = look.matched_without(self._ends_before_walls(look.beams, T_predicted), T_predicted)
        if not match.is_matched or jump(match, step) is not None:
            return None
        is_aside = not match.T_map_base.is_near(fit.T_map_base, config.aside_m, config.aside_rad)
        if not (is_aside or (was_beside and fit.misfits)):
            return None
        evidence = self._relocalizer.at(look.beams, match.T_map_base).evidence
        self._is_beside = self._is_possible(evidence, limits)
        return match if self._is_beside else None

    def _is_possible(self, evidence: Evidence, limits: VerdictLimits) -> bool:
        config, share = self.config, evidence.inlier_ratio
        least = max(config.min_share, limits.wrong_inlier_ratio)
        is_explained = share >= config.min_explained * (1.0 - evidence.short_ratio)
        most_through = limits.usual_violation_ratio + config.slack
        return share >= least and is_explained and evidence.violation_ratio <= most_through

    def _ends_before_walls(self, beams: Beams, T_map_base: SE2) -> BoolArray:
        reach_m = float(reach_of(self._relocalizer.laser.limits_m))
        walls_m, _ = self._relocalizer.segment_map.ranges(beams, T_map_base, reach_m)
        return beams.is_hit & (beams.ranges_m < walls_m - self.config.before_m)

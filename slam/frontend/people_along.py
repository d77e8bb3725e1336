"""Whether what a scan sees across its open way walked along with the robot."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.frontend.prediction import Prediction
from slam.frontend.seen_before import LastSeen
from slam.surface.surface_match import SurfaceMatch

MOST_FACING, _DRAWN = 0.15, (1.0, 6.0)
"""Share of a scan across a direction that people may make up, and normalised error squared of the wheels, as noisy
as they show, by which they draw a scan aside: with them, and alone. Chosen: of people ahead, who leave a scan
each 0.05 to 0.1 m where it was, and of five real logs 155 scans of 8157 were asked, one was of people."""
CLEAN = 0.08
"""Cost of a scan alone, beyond which, over a short way, little is said by beams that seem to look through what
others met. Chosen: in a mine, between rough walls, of which half the beams come back, a scan alone costs 0.09 to
0.31; where people draw it along, 0.03 to 0.07."""
_SHORT_M = 0.3
"""Of the wheels since the last scan; after more, people are asked of where a scan is farther off than wheels are.
Chosen: with a scan each metre, wheels off by a third of that were believed rather than right scans."""


class PeopleAlong:
    """Scans that people draw aside of where the wheels lead, who walk along with the robot."""

    def __init__(self, last: LastSeen) -> None:
        self._last, self._surfaces, self._config = last, last.surfaces, last.config

    def may_be(self, told: Prediction, match: SurfaceMatch) -> bool:
        """Whether it is worth to ask `have_drawn`: wheels that had spun when scans denied them lead on from
        there, and do not deny the next ones."""
        if match.least_facing > MOST_FACING:
            return False
        is_asked = told.way_m <= _SHORT_M or told.squared(match) > self._config.trust
        return is_asked and told.is_denying(match, _DRAWN[0])

    def have_drawn(
        self,
        points: FloatArray,
        beams: Beams,
        told: Prediction,
        since: Prediction,
        match: SurfaceMatch,
    ) -> bool:
        """Whether people who walked along drew a match of faced points (N, 3) aside of where the wheels led
        since the last keyframe, and since the last scan: told."""
        if not (self.may_be(told, match) and since.is_denying(match, _DRAWN[0])):
            return False
        alone = self._surfaces.match_alone(points, match.T_map_base)
        off = alone.T_map_base.between(since.T_map_base)
        is_turned = math.hypot(off.x, off.y) < abs(off.theta)  # walls tell the heading
        is_clean = alone.cost < CLEAN or told.way_m > _SHORT_M
        if is_turned or not is_clean or not since.is_denying(alone, _DRAWN[1]):
            return False
        return self._last.before(points, beams).are_people(alone, since.T_map_base)

    def held_along(
        self, points: FloatArray, since: Prediction, match: SurfaceMatch
    ) -> SurfaceMatch:
        """As `Candidates.held`, but only along the way that people drew a match aside: walls tell the rest."""
        T, share = since.T_map_base, self._config.surfaces.share
        off = T.between(self._surfaces.match_alone(points, match.T_map_base).T_map_base)
        way = np.array([off.x, off.y, 0.0]) / math.hypot(off.x, off.y)
        along = np.outer(way, way) / float(way @ since.covariance @ way)
        return self._surfaces.match(points, T, T, along, pull=share)

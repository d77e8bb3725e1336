"""Wheels that spun or slipped: a scan looks as one did before, or fits in one place between."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.frontend.open_matches import LITTLE
from slam.frontend.people_along import CLEAN, MOST_FACING
from slam.frontend.prediction import Prediction
from slam.frontend.seen_before import LastSeen
from slam.frontend.still_scans import StillScans
from slam.surface.surface_match import SurfaceMatch

_SPUN, _STILL = (0.15, 0.05), (0.05, 0.02)
"""[m], [rad] by which wheels must lead off where the robot stood, and within which a scan says that it stands.
Chosen."""
_KNOWN_FROM = 4
"""Keyframes in a row that a place is known from. Chosen: by two, pillars where the wheels led fitted worse than
those alike where the robot had been."""
_STILL_FITS, _STILL_BETTER = 0.95, 0.05
"""Share of a scan on surfaces where the robot stood, and cost by which it must fit better there. Chosen: in a
corridor with doors, wheels that spun by 0.25 to 0.5 m between two scans made it 0.07 to 0.23."""
_SLIPPED, _SLIP_BETTER = (0.1, 0.1), 0.03
"""[m], [rad] off where the wheels hold a scan, and cost by which it must fit better, for them to have slipped.
Chosen: between doors, wheels that told of twice or half of a metre's way made it 0.03 to 0.12 for one scan of three at
least."""
_NO_WAY_M = 0.02
"""Wheels that tell of less all at once, of a robot that drives on, did not slip: they tell of it at the next scan.
Chosen: of drives by odometry told at each second scan 15 of 24 were right and good, and nine without this; asked of all
wheels that stand, those that tell late of a start were worse."""
_FACING, _THING_M = 0.7, 0.75
"""Cosine to the way of what faces it, and how far about its middle a thing reaches, as a cart or two people. Chosen."""


class SlippedWheels:
    """Matches against wheels that spun or slipped, with the surfaces that the last keyframes saw."""

    def __init__(self, last: LastSeen) -> None:
        self._last, self._surfaces = last, last.surfaces
        self._keyframes, self._config = last.keyframes, last.config
        self.still = StillScans()
        self._has_way = False

    def against(
        self, points: FloatArray, beams: Beams, told: Prediction, led: SurfaceMatch
    ) -> SurfaceMatch | None:
        """The match of faced points (N, 3) against wheels that spun or slipped since the last scan, which
        pull a little. None where they did not, or nobody can tell. led: the match where they lead."""
        had_way, self._has_way = self._has_way, told.way_m >= _NO_WAY_M
        if led.cost < _STILL_BETTER or not self._is_known(told):
            return None
        alone = self._stood(points, beams, told, led)
        if alone is None and (self._has_way or not had_way):
            alone = self._slipped(points, told, led)
        if alone is None:
            return None
        if self._last.before(points, beams).are_people(alone, told.T_map_base):
            return None
        T_start, loose = alone.T_map_base, LITTLE * told.odometry
        return self._surfaces.match(points, T_start, told.T_map_base, loose)

    def _stood(
        self, points: FloatArray, beams: Beams, told: Prediction, led: SurfaceMatch
    ) -> SurfaceMatch | None:
        """The match without the wheels where the robot was when a scan looked the same, if they spun since:
        it fits there, and far worse where these lead."""
        T_still = self.still.place(beams, told.T_last, told.way_m)
        if T_still is None or led.T_map_base.is_near(T_still, *_SPUN):
            return None
        alone = self._surfaces.match_alone(points, T_still)
        is_there = _fits(alone) and alone.T_map_base.is_near(T_still, *_STILL)
        return alone if is_there and alone.cost < led.cost - _STILL_BETTER else None

    def _slipped(
        self, points: FloatArray, told: Prediction, led: SurfaceMatch
    ) -> SurfaceMatch | None:
        """The match without the wheels if they slipped on part of the way: found from where these lead as
        from where the robot was, and fitting far better than where the wheels hold the scan."""
        if led.least_facing > MOST_FACING:
            return None
        alone = self._surfaces.match_alone(points, told.T_map_base)
        is_clean = _fits(alone) and alone.cost < CLEAN
        if not is_clean or alone.cost > led.cost - _SLIP_BETTER:
            return None
        is_off = not led.T_map_base.is_near(alone.T_map_base, *_SLIPPED)
        is_told = alone.least_facing >= self._config.least_facing
        if not (is_off and is_told and told.is_denying(alone, self._config.surely_wrong)):
            return None
        other = self._surfaces.match_alone(points, told.T_last)
        is_one = other.T_map_base.is_near(alone.T_map_base, *_STILL)
        return alone if is_one and self._is_told_by_more(points, alone, led) else None

    def _is_told_by_more(self, points: FloatArray, alone: SurfaceMatch, led: SurfaceMatch) -> bool:
        """Whether a scan lies there as well without the one thing that most of what faces the way is of: that
        may have stood until now."""
        off = alone.T_map_base.between(led.T_map_base)
        facing = np.cos(points[:, 2] - math.atan2(off.y, off.x))
        across = self._surfaces.thinned(points[np.abs(facing) > _FACING, :2])
        if len(across) == 0:
            return False
        apart_m = np.hypot(*(across[:, None] - across).T)
        thing = across[np.argmax((apart_m < _THING_M).sum(axis=0))]
        rest = points[np.hypot(*(points[:, :2] - thing).T) > _THING_M]
        again = self._surfaces.match_alone(rest, led.T_map_base)
        is_told = again.least_facing >= self._config.least_facing
        return is_told and again.T_map_base.is_near(alone.T_map_base, *_STILL)

    def _is_known(self, told: Prediction) -> bool:
        """Whether the last keyframes know the place, and the wheels something of the way."""
        last = self._keyframes[-_KNOWN_FROM:]
        is_known = len(last) == _KNOWN_FROM and not any(one.is_break for one in last)
        return is_known and not told.is_guess


def _fits(alone: SurfaceMatch) -> bool:
    """Whether next to all of a scan lies on surfaces."""
    return min(alone.inlier_ratio, alone.seen_ratio) > _STILL_FITS

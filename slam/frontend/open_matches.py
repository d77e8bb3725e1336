"""Scans that leave a direction open, or seem to: surfaces across it are few, and count as outliers as
soon as the wheels are off; and few tell the place as well as many, if there is but one where they fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.strays import apart_m
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMap
from slam.surface.surface_match import SurfaceMatch

LITTLE = 0.01
"""Of the odometry's information, where wheels may be far off."""
_NEAR = 0.3, 0.15
"""[m], [rad]: what lies farther from where wheels lead is looked for with more care. Chosen."""
_SLID_M = 0.15, 0.3, 0.45
"""To either side: wheels off by 15 cm after a metre, a scan each metre. Chosen."""
_MOST_SLID = 0.6, 0.15
"""[m], [rad]: what lies farther off is something else. Chosen."""
_SLID_BETTER = 0.01
"""Cost by which surfaces across the open direction must make a slid match the better one: they are a
few points of a scan. Chosen."""
_FEW = 6
"""Points more on surfaces, by which a slid match is told that all but faces nothing along the way. Chosen:
where wheels that show to be off by 12 % of each metre bear it, seven of eight were nearer for it; of 15 with 4
and more, the three with 4 and 5 were not. Where good wheels deny it, five of six were people."""

_REACH_M, _APART_M = (0.6, 3.0), 0.2
"""How far a scan is slid to either side, at least and at most, and from one try to the next. Chosen: after a
longer way, as far as that, since recesses each 1 to 1.5 m made maps wrong and good."""
_BACK = 0.05, 0.1
"""[m], [rad] within which matches from all these end in one place. Chosen: in corridors with recesses of
a hand's breadth each of 2000 did, between bare walls one of a hundred by noise. That others cost more
before they come back was asked as well, and left corridors with recesses untold."""
_ALIKE = 0.06
"""Share of a scan by which it may fit worse in a place that looks the same. Chosen: at the next of recesses
and pillars alike, a metre and more off, it was 0.04 at most, and 0.08 at least where nothing is alike."""
_HELD = 0.1, 0.1
"""[m], [rad] by which what is told beside the scan may hold it aside of that. Chosen: people who walk
along draw a scan farther between bare walls, of which one map was 4 m off."""


def is_one_place(
    surfaces: SurfaceMap, points: FloatArray, match: SurfaceMatch, way_m: float
) -> bool:
    """Whether faced points (N, 3) fit in one place alone along the direction that their match leaves
    open: slid along it to either side they come back by nothing but what they see, or, slid so far that
    they do not find back, they fit by far worse there. way_m: since a scan that told its place; as
    far off they may be at the next of recesses that look alike.

    Information says how surfaces face, and takes a scan's errors to go together; the sides of shallow
    recesses are few, and yet each of them tells.
    """
    slide = match.open_way
    if slide is None:
        return False
    alone = surfaces.match_alone(points, match.T_map_base)
    if not alone.T_map_base.is_near(match.T_map_base, *_HELD):
        return False
    for slid_m in np.arange(_APART_M, np.clip(way_m, *_REACH_M) + _APART_M / 2.0, _APART_M):
        for sign in (1.0, -1.0):
            start = alone.T_map_base @ SE2.exp(sign * slid_m * slide)
            other = surfaces.match_alone(points, start)
            if other.T_map_base.is_near(alone.T_map_base, *_BACK):
                continue
            is_near = slid_m < _REACH_M[0] + _APART_M / 2.0
            if is_near or other.inlier_ratio > alone.inlier_ratio - _ALIKE:
                return False
    return True


def closed_match(
    surfaces: SurfaceMap,
    points: FloatArray,
    T_predicted: SE2,
    odometry: FloatArray,
    match: SurfaceMatch,
    config: FrontEndConfig,
    noise: float,
    are_people: Callable[[SurfaceMatch], bool] = lambda _: False,
) -> SurfaceMatch:
    """A match of faced points (N, 3) that leaves a direction open, or a better one that does not.

    odometry: (3, 3) information of T_predicted. First where wheels that say little lead: of odometry
    that stands still while the robot drives, wheels hold the scan where what is ahead counts as an
    outlier. Then farther along the open direction: noisy wheels lead past the few surfaces that tell, be
    they so few that they hardly count, if more of the scan lies on surfaces in that one place, and wheels
    with such a noise do not deny it: see `WheelScale`. are_people: whether what a better match sees across
    the open direction walked along.
    """
    free = surfaces.match(points, T_predicted, T_predicted, LITTLE * odometry)
    is_better = (
        free.cost < match.cost - config.better
        and free.least_facing >= config.least_facing
        and free.T_map_base.is_near(T_predicted, *_NEAR)
        and not are_people(free)
    )
    if is_better:
        return free
    slide = match.open_way
    if slide is None:
        return match
    closed = few = match
    for slid_m in (sign * way_m for way_m in _SLID_M for sign in (1.0, -1.0)):
        start = match.T_map_base @ SE2.exp(slid_m * slide)
        other = surfaces.match(points, start, T_predicted, LITTLE * odometry)
        if not other.T_map_base.is_near(match.T_map_base, *_MOST_SLID):
            continue
        most = match.cost - _SLID_BETTER
        is_closed = other.least_facing >= config.least_facing
        if is_closed and other.cost < min(closed.cost, most) and not are_people(other):
            closed = other
        gained = (other.inlier_ratio - match.inlier_ratio) * len(points)
        if gained >= _FEW and other.cost < min(few.cost, most):
            off = T_predicted.between(other.T_map_base).log()
            few = other if off @ odometry @ off < config.trust * noise else few
    if closed is match and few is not match:
        off_m = apart_m(few.T_map_base, match.T_map_base)
        if is_one_place(surfaces, points, few, off_m + _APART_M):
            return replace(few, is_told_by_few=True)
    return closed

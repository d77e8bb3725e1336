"""Scans that leave a direction open where the wheels hold them: surfaces across that direction are few,
and count as outliers as soon as the wheels are off."""

from __future__ import annotations

import numpy as np

from slam.arrays import FloatArray
from slam.front_end_config import FrontEndConfig
from slam.se2 import SE2
from slam.surface_map import SurfaceMap, SurfaceMatch

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


def closed_match(
    surfaces: SurfaceMap,
    points: FloatArray,
    T_predicted: SE2,
    odometry: FloatArray,
    match: SurfaceMatch,
    config: FrontEndConfig,
) -> SurfaceMatch:
    """A match of faced points (N, 3) that leaves a direction open, or a better one that does not.

    odometry: (3, 3) information of T_predicted. First where wheels that say little lead: of odometry
    that stands still while the robot drives, wheels hold the scan where what is ahead counts as an
    outlier. Then farther along the open direction: noisy wheels lead past the few surfaces that tell.
    """
    free = surfaces.match(points, T_predicted, T_predicted, LITTLE * odometry)
    is_better = (
        free.cost < match.cost - config.better
        and free.least_facing >= config.least_facing
        and free.T_map_base.is_near(T_predicted, *_NEAR)
    )
    if is_better:
        return free
    known = match.information
    if not known[2, 2] > 0.0:
        return match
    weakest = np.linalg.eigh(match.place_information)[1][:, 0]
    # slid so, and turned with it, the scan fits all but as well
    slide = np.array([*weakest, -known[:2, 2] @ weakest / known[2, 2]])
    best = match
    for slid_m in (sign * way_m for way_m in _SLID_M for sign in (1.0, -1.0)):
        start = match.T_map_base @ SE2.exp(slid_m * slide)
        other = surfaces.match(points, start, T_predicted, LITTLE * odometry)
        is_closed = other.least_facing >= config.least_facing
        is_slid = other.T_map_base.is_near(match.T_map_base, *_MOST_SLID)
        if is_closed and is_slid and other.cost < min(best.cost, match.cost - _SLID_BETTER):
            best = other
    return best

"""How sharp a map is: whether walls that were seen again lie where they were seen before."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from slam.arrays import FloatArray

_RADIUS_M = 0.5
_LEAST = 5
"""Points of each view; fewer make no line."""
_STRAIGHT = 0.1
"""Of the variance along a line, most across it."""
_ASKED = 3000
"""Points asked, evenly among all. Chosen, all of these."""


def wall_spread_m(clouds: Sequence[FloatArray], apart: tuple[int, float]) -> float | None:
    """RMS distance [m] of points from the line that other scans saw there; None where hardly one did.

    clouds: (N, 2) each [m], map frame, in the order of the drive. Of each point asked: the line
    through those within 0.5 m of its own and neighbouring scans, and how far from it those are that
    lie more scans apart than the first of apart, and no more than the second.
    The mean plane variance of Razlaw et al. (ECMR 2015), between views instead of all in one.
    """
    if not clouds:
        return None
    points = np.concatenate(clouds)
    scans = np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds])
    tree, squared = cKDTree(points), []
    for k in range(0, len(points), max(1, -(-len(points) // _ASKED))):
        near = np.array(tree.query_ball_point(points[k], _RADIUS_M))
        off = np.abs(scans[near] - scans[k])
        own, others = (
            points[near[off <= apart[0]]],
            points[near[(off > apart[0]) & (off <= apart[1])]],
        )
        if min(len(own), len(others)) < _LEAST:
            continue
        variances, axes = np.linalg.eigh(np.cov(own.T))
        if variances[0] < _STRAIGHT * variances[1]:
            squared.append(float(np.mean(((others - own.mean(axis=0)) @ axes[:, 0]) ** 2)))
    return math.sqrt(np.mean(squared)) if len(squared) >= _LEAST else None

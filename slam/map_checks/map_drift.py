"""How far a map may have drifted, by what its own pose graph knows."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray, IntArray
from slam.odometry import place_sigma_m
from slam.pose_graph import PoseGraph, PoseGraphSolution

_ASKED = 24
"""Chosen: keyframes enough to see the bend of a building, few enough for a tenth of a second."""
_MOST_DRIFT_M = 0.6
"""Chosen: whole logs of four buildings say 0.07 to 0.21 m of themselves, with a third of the scans
lost up to 0.26 m; pieces of them that are 0.15 to 0.3 m off and closed by few loops 0.6 to 1.1 m."""
_MOST_DRIFT = 0.01
"""Of the distance between the corners of what was driven, where that makes more: simulated loops of
half a kilometre say 0.7 to 1.2 m of themselves and are off by a tenth of that, one of eight by a third."""


def drift_m(graph: PoseGraph, keyframes: IntArray) -> float:
    """By how much keyframes (K,) of a graph may be off as seen from one of them [m], as root mean
    square over all and by the graph's own covariances; from the one from which it is least.

    It is what is left after the map is laid on the truth as well as can be, and no promise in
    either direction: steps are said to be less certain than they are, so that right maps are off by
    two to eight tenths of it. inf where the graph leaves a direction open.
    """
    if len(keyframes) < 2:
        return 0.0
    rows = np.linspace(0, len(keyframes) - 1, min(len(keyframes), _ASKED)).round().astype(np.int64)
    asked = keyframes[rows]
    pairs = np.array([(i, j) for i in asked for j in asked if i != j])
    try:
        covariances = graph.solve().relative_covariances(pairs)
    except ValueError:  # all that the solver says of a direction without bounds
        return math.inf
    variances_m2 = (covariances[:, 0, 0] + covariances[:, 1, 1]).reshape(len(asked), -1)
    return math.sqrt(float(variances_m2.mean(axis=1).min()))


def between_m(graph: PoseGraph, one: int, other: int) -> float:
    """How sure a graph is of where one keyframe lies as seen from another: standard deviation [m] in
    the direction in which it is least; inf where that has no bounds."""
    if one == other:
        return 0.0
    return sigmas_m(graph.solve(), np.array([(one, other)]))[0]


def sigmas_m(solution: PoseGraphSolution, pairs: IntArray) -> list[float]:
    """Standard deviations [m] of the one of each pair (P, 2) of keyframes as seen from the other, as in
    `between_m`."""
    try:
        covariances = solution.relative_covariances(pairs)
    except ValueError:  # all that the solver says of a direction without bounds
        return [math.inf] * len(pairs)
    return [place_sigma_m(one) for one in covariances]


def too_far_adrift(drift_m: float, poses: FloatArray, share: float = 1.0) -> list[str]:
    """In words, that a map of keyframes at poses (K, 3) is held by too few loops to be right for
    sure; none where it is not. share: of what is let pass."""
    if len(poses) == 0:
        return []
    large_m = float(np.hypot(*np.ptp(poses[:, :2], axis=0)))
    if drift_m <= share * max(_MOST_DRIFT_M, _MOST_DRIFT * large_m):
        return []
    return [
        "too few loops hold it together: by its own account its poses are off by"
        f" {drift_m:.1f} m (RMS), which no scan contradicts"
    ]

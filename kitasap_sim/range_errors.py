"""What a laser makes of a true range, compiled by Numba once on each machine."""

import math

import numpy as np

from kitasap_sim.compiled import compiled

_NOWHERE_M = 1e12
"""Farther than any surface."""


@compiled
def mix_pixels(
    ranges: np.ndarray, chosen: np.ndarray, share: np.ndarray, rate: float, jump: float
) -> None:
    """Gives beams whose spot straddles an edge a range between the two surfaces, in place.

    ranges, chosen, share: (N,), the last two uniform from 0 to 1. An edge is where ranges jump by more
    than jump; so many of them, rate, are mixed. It may be nearer to the beam before it or to the one
    behind: were it always the same, every edge would seem to be turned to one side.
    """
    # a beam that hits nothing has no surface to share with: one far beyond all of them stands for it
    hits = np.minimum(ranges, _NOWHERE_M)
    # backwards: of two edges that share a beam the one before it tells
    for edge in range(len(ranges) - 2, -1, -1):
        step = hits[edge + 1] - hits[edge]
        if jump < abs(step) < _NOWHERE_M / 2 and chosen[edge] < rate:
            beam = edge + 1 if chosen[edge] >= rate / 2 else edge
            ranges[beam] = hits[edge] + share[edge] * step


@compiled
def disturb(
    ranges: np.ndarray,
    normal: np.ndarray,
    dropped: np.ndarray,
    sigmas: np.ndarray,
    bias: float,
    resolution: float,
    nearest: float,
    farthest: float,
    dropout_rate: float,
) -> None:
    """Bias, noise, quantisation, limits and dropouts, in place; inf stays infinite.

    ranges, normal, dropped: (N,), the latter standard normal and uniform from 0 to 1. sigmas: (2, K)
    increasing ranges and standard deviations there, with straight lines between; none without noise.
    """
    last = sigmas.shape[1] - 1
    for i in range(len(ranges)):
        at = ranges[i]
        sigma = 0.0
        if last >= 0:
            k = 0
            while k <= last and sigmas[0, k] <= at:
                k += 1
            if k == 0 or k > last:
                sigma = sigmas[1, min(k, last)]
            else:
                rise = sigmas[1, k] - sigmas[1, k - 1]
                sigma = rise / (sigmas[0, k] - sigmas[0, k - 1]) * (at - sigmas[0, k - 1])
                sigma += sigmas[1, k - 1]
        at += normal[i] * sigma + bias
        if resolution > 0.0:
            at = np.rint(at / resolution) * resolution
        if dropped[i] < dropout_rate:
            at = math.nan
        elif at > farthest:
            at = math.inf
        elif at < nearest:
            at = -math.inf
        ranges[i] = at

"""How far a pose may be from the Gaussian that edges were joined to: second answers and long tails."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray
from slam.kernels import compiled
from slam.kernels.normal_equations import inverted, lower_root_into

_LEAST_VARIANCE = 1e-30
_SPREAD = 2.0
"""Chosen: of the points about the Gaussian found, in its standard deviations."""
_WIDE = 0.875
"""Chosen: of the points that moments are taken from."""
_NOTHING = 20.0
"""In log weight: a point that much less likely than another counts for nothing."""


@compiled
def moments_about(
    smooth_information: FloatArray,
    axes: FloatArray,
    shifts: FloatArray,
    likelihoods: FloatArray,
    points: FloatArray,
    mean: FloatArray,
    information: FloatArray,
    moments: FloatArray,
) -> None:
    """Second moments (3, 3) about a mean (3,) of what smooth beams and edges say together.

    By importance sampling: expectation propagation puts one Gaussian where two answers or long tails
    may be. The first of the points (P, 3), standard normal, are spread as the Gaussian found (3, 3)
    says, twice as wide; the others, _WIDE of all, as the smooth beams alone say: a second answer may
    lie anywhere there. Weights by the mixture of both. smooth_information: (3, 3) about zero. axes,
    shifts, likelihoods: of `propagate`.
    """
    wide, narrow = np.empty((3, 3)), np.empty((3, 3))
    log_wide = _scaled_root_into(inverted(smooth_information), 1.0, wide)
    log_narrow = _scaled_root_into(inverted(information), _SPREAD, narrow)
    logs, count = np.log(likelihoods), points.shape[0]
    last, narrow_count = shifts.shape[1] - 1, count - int(_WIDE * count)
    for e in range(axes.shape[0]):
        most_likely = logs[e, 0]
        for node in range(1, last + 1):
            most_likely = max(most_likely, logs[e, node])
        for node in range(last + 1):
            logs[e, node] -= most_likely
    share_wide = math.log((count - narrow_count) / count) - log_wide
    share_narrow = math.log(narrow_count / count) - log_narrow
    x, off, weights = np.empty((count, 3)), np.empty(3), np.empty(count)
    best = -np.inf
    for p in range(count):
        for j in range(3):
            x[p, j] = mean[j] if p < narrow_count else 0.0
            for k in range(j + 1):
                x[p, j] += (narrow[j, k] if p < narrow_count else wide[j, k]) * points[p, k]
            off[j] = x[p, j] - mean[j]
        squared = points[p, 0] ** 2 + points[p, 1] ** 2 + points[p, 2] ** 2
        other = 0.0
        if p < narrow_count:
            for j in range(3):
                for k in range(3):
                    other += x[p, j] * smooth_information[j, k] * x[p, k]
            from_wide = other
            first, second = -0.5 * other + share_wide, -0.5 * squared + share_narrow
        else:
            for j in range(3):
                for k in range(3):
                    other += off[j] * information[j, k] * off[k]
            from_wide = squared
            first = -0.5 * squared + share_wide
            second = -0.5 * other / (_SPREAD * _SPREAD) + share_narrow
        apart = abs(first - second)
        weight = -0.5 * from_wide - max(first, second)
        if apart < _NOTHING:
            weight -= math.log(1.0 + math.exp(-apart))
        for e in range(axes.shape[0]):
            # from here on it only gets less: most of the wide ones are out after a few edges
            if weight < best - _NOTHING:
                break
            shift = axes[e, 0] * x[p, 0] + axes[e, 1] * x[p, 1] + axes[e, 2] * x[p, 2]
            at = (shift - shifts[e, 0]) / (shifts[e, 1] - shifts[e, 0])
            at = min(max(at, 0.0), last - 1e-9)
            node = int(at)
            weight += logs[e, node] + (at - node) * (logs[e, node + 1] - logs[e, node])
        weights[p] = weight
        best = max(best, weight)
    moments[:] = 0.0
    mass = 0.0
    for p in range(count):
        if weights[p] < best - _NOTHING:
            continue
        weight = math.exp(weights[p] - best)
        mass += weight
        for j in range(3):
            for k in range(3):
                moments[j, k] += weight * (x[p, j] - mean[j]) * (x[p, k] - mean[k])
    moments /= mass


@compiled
def _scaled_root_into(covariance: FloatArray, scale: float, root: FloatArray) -> float:
    """Cholesky's lower root (3, 3) of a covariance, times a scale; the log of its determinant."""
    lower_root_into(covariance, _LEAST_VARIANCE, root)
    total = 0.0
    for j in range(3):
        for k in range(j + 1):
            root[j, k] *= scale
        total += math.log(root[j, j])
    return total

"""A linear correction by a match, of several explanations each, joined to one Gaussian."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray
from slam.kernels import compiled

_NEARLY_NOTHING = 1e-18
"""Square metres, or radians: keeps a variance of nothing above it."""


@compiled
def gaussian_sum(
    P: FloatArray,
    pull: FloatArray,
    information: FloatArray,
    least: FloatArray,
    widenings: FloatArray,
    widening_odds: FloatArray,
    factors: FloatArray,
    factor_odds: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
    of_widenings: FloatArray,
) -> None:
    """Mean (N,) and covariance (N, N) of an error of covariance P, given a match of its first three.

    pull: (3,) information times innovation, information (3, 3): of the match. least: (3,) diagonal of
    an information that is none. widenings: (W, 3, 3) that may have been added to P, with their odds
    (W,); factors: (F,) that the match's covariance may be wider by, with theirs (F,). of_widenings:
    (W,) result, how likely each was.
    """
    count, wide_count, factor_count = P.shape[0], widenings.shape[0], factors.shape[0]
    weights = np.empty((wide_count, factor_count))
    means = np.empty((wide_count, factor_count, count))
    shares = np.empty((wide_count, factor_count, 3))
    levers = np.empty((wide_count, count, 3))
    offs, tolds = np.empty((wide_count, 3)), np.empty((wide_count, 3))
    for i in range(wide_count):
        # where prediction and match are both diagonal, the prediction's variance is one
        wide = P[:3, :3] + widenings[i]
        root = np.linalg.cholesky(wide + _NEARLY_NOTHING * np.eye(3))
        told, axes = np.linalg.eigh(root.T @ ((information + np.diag(least)) @ root))
        none = least @ (root @ axes) ** 2
        drawn = axes.T @ (root.T @ pull)
        back = np.linalg.solve(root.T, axes)
        beside = P[:, :3].copy()
        beside[:3] += widenings[i]
        levers[i] = beside @ back
        size = math.log(root[0, 0] * root[1, 1] * root[2, 2])
        for k in range(3):
            tolds[i, k] = told[k] if told[k] > 2.0 * none[k] else 0.0
            offs[i, k] = drawn[k] / told[k] if tolds[i, k] > 0.0 else 0.0
        for j in range(factor_count):
            likely = math.log(max(widening_odds[i] * factor_odds[j], 1e-300)) - size
            for k in range(3):
                if tolds[i, k] > 0.0:
                    share = told[k] / (told[k] + factors[j])
                    off = offs[i, k]
                    likely -= 0.5 * (math.log1p(factors[j] / told[k]) + off * off * share)
                else:  # how wide it is along what it does not tell says nothing
                    share = 0.0
                    likely -= 0.5 * math.log1p(1.0 / told[k]) if told[k] > 0.0 else 0.0
                shares[i, j, k] = share
            weights[i, j] = likely
            for n in range(count):
                means[i, j, n] = 0.0
                for k in range(3):
                    means[i, j, n] += levers[i, n, k] * shares[i, j, k] * offs[i, k]
    weights = np.exp(weights - weights.max())
    weights /= weights.sum()
    mean[:] = 0.0
    covariance[:] = P
    for i in range(wide_count):
        of_widenings[i] = weights[i].sum()
        covariance[:3, :3] += of_widenings[i] * widenings[i]
        for j in range(factor_count):
            mean += weights[i, j] * means[i, j]
    for i in range(wide_count):
        for j in range(factor_count):
            for n in range(count):
                for m in range(count):
                    kept = (means[i, j, n] - mean[n]) * (means[i, j, m] - mean[m])
                    for k in range(3):
                        kept -= levers[i, n, k] * shares[i, j, k] * levers[i, m, k]
                    covariance[n, m] += weights[i, j] * kept

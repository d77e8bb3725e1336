"""The step between two keyframes as two factors of a pose graph: what the wheels told, and what the scans add."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from slam.arrays import BoolArray, FloatArray
from slam.frontend.keyframes import Keyframe
from slam.kernels import pose_graph as kernels
from slam.se2 import SE2

_DENIED, _APART = 4.0, 5.0
"""Squared standard deviations of a step along each of its axes: wheels that it denies by more are as unsure as that;
and standard deviations up to which scans may lead elsewhere than both together. Chosen."""
_CURVED = 0.1
"""Standard deviations of a step, by which two factors that are far apart may have it lead elsewhere where errors are
told as (x, y, theta), as g2o does, rather than as a logarithm. Chosen."""
_SOUND = 1e-9
"""Least eigenvalue of a covariance, as a share of the largest: another is too uneven to be computed with. Chosen."""
_LEAST_SHARE = 1e-6
"""Of the information of a step; chosen: less tells nothing, and would be computed of rounding alone."""
_Factor = tuple[SE2, FloatArray]
"""A way, and the information of it."""


def step_factors(
    keyframes: Sequence[Keyframe], spread: FloatArray
) -> Iterator[tuple[_Factor, ...]]:
    """Of each step to a keyframe: the way from the one before and the information (3, 3) of that, by the
    wheels and by the scans; one alone where the other told nothing. spread (3, 3): covariance of each step
    beside its own.

    Together they lead where the step does, and are as sure. The step is a Kalman filter's, which took the wheels'
    way for its prediction: its information less theirs is what scans told. Where it is less sure than the wheels,
    since something showed them to be wrong, they are no surer; and where it denies them, less.
    """
    two = iter(_by_wheels_and_scans([one for one in keyframes if not one.told.is_guess], spread))
    for keyframe in keyframes:
        factors = () if keyframe.told.is_guess else next(two)
        if factors:
            yield factors
        else:
            yield ((keyframe.T_before, _inverse(keyframe.covariance + spread)),)


def _by_wheels_and_scans(
    keyframes: Sequence[Keyframe], spread: FloatArray
) -> Iterator[tuple[_Factor, ...]]:
    """Of each step to keyframes (S), of which wheels told: by them, and by the scans unless these told nothing; none
    where the two cannot be told apart, or are too far apart to be added up."""
    if not keyframes:
        return
    off = np.array([one.T_before.between(one.told.motion).log() for one in keyframes])
    covariances = np.array([one.covariance for one in keyframes]) + spread
    told = np.array([one.told.covariance for one in keyframes]) + spread
    is_sound = _is_sound(covariances) & _is_sound(told)
    covariances[~is_sound] = told[~is_sound] = np.eye(3)
    slopes = _slopes(-off)
    # in the axes of the roots the step's information is the identity, the wheels' diagonal
    roots = np.asarray(np.linalg.cholesky(_inverse(covariances)))
    turned = _inverse(roots).transpose(0, 2, 1)
    shares, axes = np.linalg.eigh(_seen_by(slopes @ turned, _inverse(told)))
    roots = roots @ axes
    along = np.einsum("nji,nj->ni", roots, off)
    shares = np.minimum(np.minimum(shares, 1.0), _DENIED / (_DENIED + along**2))
    shares = np.minimum(shares, _APART / (_APART + np.abs(along)))
    rest = np.maximum(1.0 - shares, _LEAST_SHARE)
    # back to the step's own axes: there covariance @ roots is the inverse of the roots' transpose
    elsewhere = np.einsum("nij,njk,nk->ni", covariances, roots, -shares / rest * along)
    by_wheels, by_scans = (
        _seen_by(_inverse(of), roots * share[:, None, :] @ roots.transpose(0, 2, 1))
        for of, share in ((slopes, shares), (_slopes(-elsewhere), rest))
    )
    pull = np.einsum("nij,nj->ni", by_wheels, _bent(-off))
    pull += np.einsum("nij,nj->ni", by_scans, _bent(-elsewhere))
    is_sound &= np.einsum("ni,nij,nj->n", pull, covariances, pull) < _CURVED**2
    for k, one in enumerate(keyframes):
        if not is_sound[k]:
            yield ()
        elif rest[k].max() <= _LEAST_SHARE:
            yield ((one.told.motion, by_wheels[k]),)
        else:
            T_scans = one.T_before @ SE2.exp(elsewhere[k])
            yield (one.told.motion, by_wheels[k]), (T_scans, by_scans[k])


def _slopes(residuals: FloatArray) -> FloatArray:
    """(S, 3, 3) of an edge's residuals (S, 3), by the twist of its end."""
    slopes, way, of_start = np.empty((len(residuals), 3, 3)), np.zeros(3), np.empty((3, 3))
    for residual, of_end in zip(residuals, slopes, strict=True):
        kernels.slopes(way, residual, of_start, of_end)
    return slopes


def _bent(residuals: FloatArray) -> FloatArray:
    """(S, 3) how far the pose of each twist (S, 3) is from that by its numbers."""
    return np.array([SE2.exp(one).as_array() for one in residuals]) - residuals


def _seen_by(slopes: FloatArray, information: FloatArray) -> FloatArray:
    """(S, 3, 3) of what moves by a slope (S, 3, 3) for each unit of something, the information on that."""
    return np.asarray(slopes.transpose(0, 2, 1) @ information @ slopes)


def _inverse(matrices: FloatArray) -> FloatArray:
    """(..., 3, 3) inverses."""
    return np.asarray(np.linalg.inv(matrices))


def _is_sound(covariances: FloatArray) -> BoolArray:
    """(S,) of covariances (S, 3, 3), whether they can be computed with."""
    least, _, most = np.linalg.eigvalsh(covariances).T
    return np.asarray(least > _SOUND * most)

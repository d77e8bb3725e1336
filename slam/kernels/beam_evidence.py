"""What a scan says for a pose: the log-likelihood of its ranges, and what they contradict."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray, IntArray
from slam.kernels import compiled
from slam.kernels.beam_likelihood import mixing_density, sigma_at

# What `sums` holds: log-likelihood, 0 where all fits; beams that could tell; those that fit;
# those that passed a wall; those that ended short of it, or saw a wall where there is none; those
# without a return where a wall should give one.
LOG_LIKELIHOOD, USED, FITS, PASSED, SHORT, MISSED = 0, 1, 2, 3, 4, 5
EVIDENCE_COUNT = 6

_FIT_SIGMAS = 4.0
_LIMIT_SIGMAS = 3.0
_MIN_COSINE = 0.05
"""Chosen: 3 degrees; the range to a wall seen flatter hangs on its last millimetres."""


@compiled
def weigh(
    map_normals: FloatArray,
    wall_sigmas: FloatArray,
    directions: FloatArray,
    measured: FloatArray,
    noise: FloatArray,
    limits: FloatArray,
    odds: FloatArray,
    mixed: float,
    blur: float,
    turn_blur: float,
    thickness: float,
    heading: float,
    first: FloatArray,
    first_walls: IntArray,
    nearest: FloatArray,
    nearest_walls: IntArray,
    weight: float,
    sums: FloatArray,
) -> None:
    """One look at all beams of a scan, into sums (EVIDENCE_COUNT,).

    measured: (N,) ranges; +inf no return, nan tells nothing. first, first_walls: (N,) range of the
    first wall on each beam, and which; nearest, nearest_walls: of that wall on it which is nearest
    to what was measured; inf and -1 where there is none. limits: (2,) ranges that the laser
    measures. odds: (4,) of a beam that does not end at a wall; that went through one and ends at
    another; that went through one and ends at none; that has no return though a wall is in reach.
    mixed: odds of a mixed pixel. blur [m], turn_blur [rad]: how far off the pose may be. thickness:
    beams that end less behind a wall have not gone through it [m]. weight: what each beam counts.

    A beam counts by how far from its wall it ends, across that wall (as in a likelihood field:
    Thrun, Burgard and Fox 2005, Section 6.4), 0 on it, and by what it passed.
    """
    sums[:] = 0.0
    c, s = math.cos(heading), math.sin(heading)
    span = limits[1] - limits[0]
    elsewhere, through, behind, silent = odds[0], odds[1], odds[2], odds[3]
    for i in range(measured.shape[0]):
        z = measured[i]
        if math.isnan(z) or z == -np.inf:
            continue
        h_first, wall = first[i], first_walls[i]
        if z == np.inf or z > limits[1]:
            sigma = sigma_at(noise, min(h_first, limits[1]))
            if limits[0] < h_first < limits[1] - _LIMIT_SIGMAS * sigma:
                sums[USED] += weight
                sums[MISSED] += weight
                sums[LOG_LIKELIHOOD] += weight * math.log(silent)
            continue
        sums[USED] += weight
        sigma = sigma_at(noise, z)
        passed = False
        if wall >= 0 and z > h_first:
            cosine = _cosine(map_normals, wall, c, s, directions, i)
            beyond = (z - h_first) * cosine
            deviation = _across(sigma, wall_sigmas[wall], blur, turn_blur * h_first, cosine)
            passed = beyond > thickness + _FIT_SIGMAS * deviation
        wall, fit, fits = nearest_walls[i], 0.0, False
        if wall >= 0:
            cosine = _cosine(map_normals, wall, c, s, directions, i)
            deviation = _across(sigma, wall_sigmas[wall], blur, turn_blur * nearest[i], cosine)
            residual = (z - nearest[i]) * cosine / deviation
            fits = abs(residual) <= _FIT_SIGMAS
            fit = math.exp(-0.5 * residual * residual)
        other = behind if passed and not fits else elsewhere
        if not fits and mixed > 0.0:
            margin = _FIT_SIGMAS * (sigma + blur)
            other += mixed * span * elsewhere * mixing_density(first, i, z, margin)
        if passed:
            fit *= through
            sums[PASSED] += weight
        elif fits:
            sums[FITS] += weight
        else:
            sums[SHORT] += weight
        sums[LOG_LIKELIHOOD] += weight * min(math.log((fit + other) / (1.0 + elsewhere)), 0.0)


@compiled
def _cosine(
    normals: FloatArray, wall: int, c: float, s: float, directions: FloatArray, i: int
) -> float:
    """Of the angle between a beam and the normal of a wall, at a heading of cosine c and sine s."""
    nx = c * normals[wall, 0] + s * normals[wall, 1]
    ny = c * normals[wall, 1] - s * normals[wall, 0]
    result: float = max(abs(nx * directions[i, 0] + ny * directions[i, 1]), _MIN_COSINE)
    return result


@compiled
def _across(sigma: float, wall_sigma: float, blur: float, aside: float, cosine: float) -> float:
    """Standard deviation, across a wall [m], of where a beam ends."""
    along = sigma * cosine
    turned = aside * aside * (1.0 - cosine * cosine)
    return math.sqrt(along * along + wall_sigma * wall_sigma + blur * blur + turned)

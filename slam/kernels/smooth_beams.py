"""Beams whose ranges are straight functions of the pose: which they are, and what they tell."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.kernels import compiled
from slam.kernels.beam_likelihood import (
    LEAST_JUMP_M,
    LIMIT_SIGMAS,
    MIN_COSINE,
    offset_into,
    sigma_at,
)
from slam.kernels.mixed_pixels import slope_and_bend
from slam.kernels.normal_equations import symmetric_into
from slam.kernels.ray_casting import cast_beside

_MOST_OWN = 0.2
"""Chosen: of what is known of a beam's range, what it may say itself. All shares add up to 3; of
hundreds of beams, a few that graze a wall have more."""
_LEAST_LEFT = 0.2
"""Chosen: no shift grows to more than twice and a half, however much the beam says itself."""
_MOST_SIGMAS = 4.0
"""A beam farther off is none of this wall's."""


@compiled
def keep_smooth(
    vertices: FloatArray,
    walls: IntArray,
    origins: FloatArray,
    directions: FloatArray,
    angles: FloatArray,
    middle: FloatArray,
    spread: float,
    reach: float,
    noise: FloatArray,
    covariance: FloatArray,
    sigmas: float,
    bend: float,
    blur: float,
    bearings: FloatArray,
    predicted: FloatArray,
    hit_walls: IntArray,
    is_kept: BoolArray,
) -> None:
    """Drops the beams whose range is not a straight function of the pose over its uncertainty.

    Each beam is shifted sideways by `sigmas` standard deviations of where it passes its hit, given
    the covariance (3, 3) of the pose (base frame), to either side: where its range then leaves the
    tangent by more than `bend` sigmas of its noise, the beam passes an edge or touches something
    round, and its gradient says nothing. What the beam itself says of that place does not count: a
    mixed pixel that a flat wall happens to explain would vouch for itself; beside a jump, a beam
    that says much of it is not kept at all. blur: with which the covariance was found [m].
    is_kept: (N,) result.
    """
    count = angles.shape[0]
    lefts, rights = np.empty(count), np.empty(count)
    farther, limits = np.empty(count), np.empty(count)
    shifts, aside, slope = np.zeros(count), np.empty(3), np.empty(3)
    widest = 0.0
    for i in range(count):
        is_kept[i] = hit_walls[i] >= 0
        if not is_kept[i]:
            continue
        ux, uy, h = directions[i, 0], directions[i, 1], predicted[i]
        at = h + (origins[i, 0] * ux + origins[i, 1] * uy)
        aside[0], aside[1], aside[2] = -uy, ux, at
        turn = origins[i, 0] * uy - origins[i, 1] * ux
        tangent = _tangent(vertices, walls, hit_walls[i], ux, uy)
        slope[0], slope[1], slope[2] = -ux - tangent * uy, -uy + tangent * ux, -turn + tangent * at
        sigma = sigma_at(noise, h)
        told = sigma * sigma + blur * blur * (1.0 + tangent * tangent)
        variance, own = _without_own(covariance, aside, slope, told)
        is_kept[i] = own < _MOST_OWN or not _is_beside_jump(predicted, i)
        if is_kept[i]:
            shifts[i] = sigmas * math.sqrt(variance)
            farther[i], limits[i] = shifts[i] * tangent, bend * sigma
            widest = max(widest, shifts[i])
    cast_beside(
        vertices, walls, origins, directions, angles, middle, spread + widest, reach, shifts,
        bearings, lefts, rights,
    )  # fmt: skip
    for i in range(count):
        if is_kept[i]:
            off_left = lefts[i] - predicted[i] - farther[i]
            off_right = rights[i] - predicted[i] + farther[i]
            is_kept[i] = abs(off_left) <= limits[i] and abs(off_right) <= limits[i]


@compiled
def _tangent(vertices: FloatArray, walls: IntArray, wall: int, ux: float, uy: float) -> float:
    """How much longer a beam becomes along a wall's line by a step to its left of 1."""
    a, b = walls[wall, 0], walls[wall, 1]
    ex, ey = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1]
    across = ux * ey - uy * ex
    return (ex * ux + ey * uy) / across if across != 0.0 else np.inf


@compiled
def _without_own(
    covariance: FloatArray, aside: FloatArray, slope: FloatArray, told: float
) -> tuple[float, float]:
    """Variance of a shift aside, had the beam not told its range; its share of what is known.

    aside, slope: (3,) gradients of the shift and of the range. told: variance of the range.
    """
    variance = known = shared = 0.0
    # written out: a product of such small matrices takes longer to call than to do
    for j in range(3):
        x, y, t = covariance[j, 0], covariance[j, 1], covariance[j, 2]
        carried = x * slope[0] + y * slope[1] + t * slope[2]
        known += slope[j] * carried
        shared += aside[j] * carried
        variance += aside[j] * (x * aside[0] + y * aside[1] + t * aside[2])
    variance = max(variance, 0.0)
    if not known < told:
        return variance, 1.0
    left = max(told - known, _LEAST_LEFT * told)
    return variance + shared * shared / left, known / told


@compiled
def _is_beside_jump(predicted: FloatArray, i: int) -> bool:
    for j in (i - 1, i + 1):
        if 0 <= j < predicted.shape[0]:
            jump = abs(predicted[j] - predicted[i])
            if jump > LEAST_JUMP_M and math.isfinite(jump):
                return True
    return False


@compiled
def look_smooth(
    map_normals: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    measured: FloatArray,
    noise: FloatArray,
    limits: FloatArray,
    outliers: FloatArray,
    shares: FloatArray,
    heading: float,
    predicted: FloatArray,
    hit_walls: IntArray,
    is_kept: BoolArray,
    information: FloatArray,
    curved: FloatArray,
    pull: FloatArray,
    sums: FloatArray,
) -> None:
    """One look at the beams is_kept (N,), light that an edge splits told apart.

    As `look` on exact walls without blur, with the densities of `slope_and_bend`. shares: (2,) of
    `mixing_shares`. curved: (3, 3) result, the negative second derivative of the log likelihood: a
    beam that may or may not be mixed tells less than its weight, of which information is the sum.
    It may be negative, which that of Gauss-Newton never is. Of sums those of the offset.
    """
    sums[:] = 0.0
    c, s = math.cos(heading), math.sin(heading)
    count = measured.shape[0]
    xx = xy = xt = yy = yt = tt = 0.0
    cxx = cxy = cxt = cyy = cyt = ctt = 0.0
    px = py = pt = ox = oy = ot = offset_weight = offset_pull = 0.0
    for i in range(count):
        z, wall, h = measured[i], hit_walls[i], predicted[i]
        if not math.isfinite(z) or not is_kept[i] or wall < 0:
            continue
        sigma = sigma_at(noise, h)
        if not limits[0] + LIMIT_SIGMAS * sigma <= h <= limits[1] - LIMIT_SIGMAS * sigma:
            continue
        nx = c * map_normals[wall, 0] + s * map_normals[wall, 1]
        ny = c * map_normals[wall, 1] - s * map_normals[wall, 0]
        ux, uy = directions[i, 0], directions[i, 1]
        cosine = nx * ux + ny * uy
        if abs(cosine) < MIN_COSINE or abs(z - h) > _MOST_SIGMAS * sigma:
            continue
        gx, gy = -nx / cosine, -ny / cosine
        gt = -(ny * (origins[i, 0] + h * ux) - nx * (origins[i, 1] + h * uy)) / cosine
        left = predicted[i + 1] if i + 1 < count else np.inf
        right = predicted[i - 1] if i > 0 else np.inf
        slope, bend, weight = slope_and_bend(z, h, left, right, sigma, shares, outliers[0])
        weight /= sigma * sigma
        offset_weight += weight
        offset_pull += slope
        ox += weight * gx
        oy += weight * gy
        ot += weight * gt
        px += slope * gx
        py += slope * gy
        pt += slope * gt
        xx += weight * gx * gx
        xy += weight * gx * gy
        xt += weight * gx * gt
        yy += weight * gy * gy
        yt += weight * gy * gt
        tt += weight * gt * gt
        cxx += bend * gx * gx
        cxy += bend * gx * gy
        cxt += bend * gx * gt
        cyy += bend * gy * gy
        cyt += bend * gy * gt
        ctt += bend * gt * gt
    pull[0], pull[1], pull[2] = px, py, pt
    offset_into(sums, offset_weight, offset_pull, ox, oy, ot)
    symmetric_into(xx, xy, xt, yy, yt, tt, information)
    symmetric_into(cxx, cxy, cxt, cyy, cyt, ctt, curved)

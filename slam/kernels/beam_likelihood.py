"""A scan against a map of walls: residuals of ranges, their sums, and Gauss-Newton over them."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.kernels import compiled
from slam.kernels.normal_equations import covariance_into, moved, symmetric_into

# What `sums` holds: beams that tell; those that fit; those that ended behind the wall, or short of
# it; squared residuals in sigmas, each counted as an inlier's largest at most; and what a range
# offset common to all beams would do: its information, its pull, its product with the pose (3).
USED, INLIERS, BEHIND, SHORT, COST = 0, 1, 2, 3, 4
OFFSET_INFORMATION, OFFSET_PULL, OFFSET_CROSS = 5, 6, 7
SUM_COUNT = 10

_INLIER = 16.0
"""Squared: a beam more than four sigmas off is no inlier; noise alone does it once in 16 000."""
LIMIT_SIGMAS = 3.0
MIN_COSINE = 0.02
"""Chosen: a degree; flatter beams give no return on real walls."""
_ROOT_TWO_PI = 2.5066282746310002
_NO_OFFSET = 1e-3
_FAR_OFF = 10.0
"""Standard deviations: a Gaussian is e-22 there, and working out how much less takes its time."""
LEAST_JUMP_M = 0.02
"""A smaller jump than this mixes nothing that noise would not hide."""


@compiled
def sigma_at(noise: FloatArray, range_m: float) -> float:
    """Standard deviation at a range: points noise (K, 2), straight lines between."""
    last = noise.shape[0] - 1
    if range_m <= noise[0, 0]:
        return float(noise[0, 1])
    for k in range(1, last + 1):
        if range_m <= noise[k, 0]:
            share = (range_m - noise[k - 1, 0]) / (noise[k, 0] - noise[k - 1, 0])
            return float(noise[k - 1, 1] + share * (noise[k, 1] - noise[k - 1, 1]))
    return float(noise[last, 1])


@compiled
def bell(sigmas: float) -> float:
    """A Gaussian so many standard deviations off, 1 in its middle; nothing beyond ten."""
    return math.exp(-0.5 * sigmas * sigmas) if abs(sigmas) < _FAR_OFF else 0.0


@compiled
def normals_into(vertices: FloatArray, walls: IntArray, normals: FloatArray) -> None:
    """(W, 2) unit normals of walls, on their left."""
    for w in range(walls.shape[0]):
        a, b = walls[w, 0], walls[w, 1]
        ex, ey = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1]
        length = math.hypot(ex, ey)
        normals[w, 0] = -ey / length
        normals[w, 1] = ex / length


@compiled
def mixing_density(predicted: FloatArray, i: int, z: float, margin: float) -> float:
    """Density [1/m] of a range z of beam i, were its light shared with a neighbour's wall; 0 if z
    does not lie between the two, give or take a margin."""
    h, density = predicted[i], 0.0
    for j in (i - 1, i + 1):
        if 0 <= j < predicted.shape[0] and math.isfinite(predicted[j]):
            jump = abs(predicted[j] - h)
            low, high = min(h, predicted[j]), max(h, predicted[j])
            if jump > LEAST_JUMP_M and low - margin < z < high + margin:
                density = max(density, 1.0 / jump)
    return density


@compiled
def offset_into(
    sums: FloatArray, weight: float, pull: float, cross_x: float, cross_y: float, cross_t: float
) -> None:
    """What a range offset common to all beams would do, into sums (SUM_COUNT,)."""
    sums[OFFSET_INFORMATION], sums[OFFSET_PULL] = weight, pull
    sums[OFFSET_CROSS], sums[OFFSET_CROSS + 1] = cross_x, cross_y
    sums[OFFSET_CROSS + 2] = cross_t


@compiled
def look(
    map_normals: FloatArray,
    wall_sigmas: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    measured: FloatArray,
    noise: FloatArray,
    limits: FloatArray,
    outliers: FloatArray,
    blur: float,
    heading: float,
    predicted: FloatArray,
    hit_walls: IntArray,
    is_kept: BoolArray,
    information: FloatArray,
    pull: FloatArray,
    sums: FloatArray,
) -> None:
    """One look at all beams, their predicted ranges known: what Gauss-Newton and a verdict need.

    Residual z - h of each beam, h its range on the map; gradient of h by a motion (x, y, theta) of
    the base in its own frame. A beam's weight is the probability that it is no outlier: Gaussian
    about h against evenly spread (Thrun, Burgard and Fox 2005, Section 6.3, "beam model").

    wall_sigmas: (W,) how far each wall may be out of place. limits: (2,) ranges that the laser
    measures. outliers: (2,) odds of an outlier against a good beam, per metre of range; and of a
    mixed pixel, anywhere between its wall and that of a neighbour.
    blur: standard deviation [m] of the position, across its wall, added to every beam.
    information: (3, 3), pull: (3,), sums: (SUM_COUNT,) results.
    """
    c, s = math.cos(heading), math.sin(heading)
    xx = xy = xt = yy = yt = tt = 0.0
    px = py = pt = ox = oy = ot = offset_weight = offset_pull = 0.0
    used = inliers = behind = short = cost = 0.0
    for i in range(measured.shape[0]):
        z, wall = measured[i], hit_walls[i]
        if not math.isfinite(z) or not is_kept[i]:
            continue
        if wall < 0:  # it met something where the map has nothing as far as the laser reaches
            used += 1.0
            short += 1.0
            cost += _INLIER
            continue
        h = predicted[i]
        sigma = sigma_at(noise, h)
        # chosen by the prediction: chosen by what was measured, noise would pull walls at the limit
        if h > limits[1] - LIMIT_SIGMAS * sigma or h < limits[0] + LIMIT_SIGMAS * sigma:
            continue
        nx = c * map_normals[wall, 0] + s * map_normals[wall, 1]
        ny = c * map_normals[wall, 1] - s * map_normals[wall, 0]
        ux, uy = directions[i, 0], directions[i, 1]
        cosine = nx * ux + ny * uy
        if abs(cosine) < MIN_COSINE:
            continue
        wall_sigma = wall_sigmas[wall]
        across = wall_sigma * wall_sigma + blur * blur
        variance = sigma * sigma + across / (cosine * cosine)
        residual = z - h
        squared = residual * residual / variance
        used += 1.0
        if squared < _INLIER:
            inliers += 1.0
            cost += squared
        else:
            cost += _INLIER
            if residual > 0.0:
                behind += 1.0
            else:
                short += 1.0
            if squared > _FAR_OFF * _FAR_OFF:
                continue
        deviation = math.sqrt(variance)
        density = outliers[0] + outliers[1] * mixing_density(predicted, i, z, 2.0 * deviation)
        bell = math.exp(-0.5 * squared)
        weight = bell / (bell + _ROOT_TWO_PI * density * deviation)
        gx, gy = -nx / cosine, -ny / cosine
        gt = -(ny * (origins[i, 0] + h * ux) - nx * (origins[i, 1] + h * uy)) / cosine
        weight /= variance
        offset_weight += weight
        offset_pull += weight * residual
        ox += weight * gx
        oy += weight * gy
        ot += weight * gt
        px += weight * residual * gx
        py += weight * residual * gy
        pt += weight * residual * gt
        xx += weight * gx * gx
        xy += weight * gx * gy
        xt += weight * gx * gt
        yy += weight * gy * gy
        yt += weight * gy * gt
        tt += weight * gt * gt
    pull[0], pull[1], pull[2] = px, py, pt
    sums[USED], sums[INLIERS], sums[BEHIND] = used, inliers, behind
    sums[SHORT], sums[COST] = short, cost
    offset_into(sums, offset_weight, offset_pull, ox, oy, ot)
    symmetric_into(xx, xy, xt, yy, yt, tt, information)


@compiled
def residual_scale(
    noise: FloatArray, measured: FloatArray, predicted: FloatArray, is_kept: BoolArray
) -> float:
    """How many times wider the residuals of a scan scatter than its noise: 1 where all is right.

    From the median of their magnitudes, which a third of outliers moves little; 1 without beams.
    """
    magnitudes, count = np.empty(measured.shape[0]), 0
    for i in range(measured.shape[0]):
        if is_kept[i] and math.isfinite(measured[i]) and math.isfinite(predicted[i]):
            magnitudes[count] = abs(measured[i] - predicted[i]) / sigma_at(noise, predicted[i])
            count += 1
    if count == 0:
        return 1.0
    return float(np.median(magnitudes[:count])) / 0.6744897501960817


@compiled
def free_offset(
    information: FloatArray, sums: FloatArray, prior: FloatArray, pose: FloatArray
) -> tuple[float, float]:
    """The range offset common to all beams and its deviation [m]; pose and information freed of it.

    The fourth unknown of the same least squares, eliminated by its Schur complement. prior: (2,)
    probability that a laser has an offset at all, and its standard deviation then [m]. Pose (3,)
    and information (3, 3) become, in place, those of both cases by their posterior probabilities.
    """
    covariance, response = np.empty((3, 3)), np.zeros(3)
    if not covariance_into(information, covariance):
        return 0.0, np.inf
    left = sums[OFFSET_INFORMATION]
    for j in range(3):
        for k in range(3):
            response[j] += covariance[j, k] * sums[OFFSET_CROSS + k]
        left -= sums[OFFSET_CROSS + j] * response[j]
    if not left > 0.0:
        return 0.0, np.inf
    offset, deviation = sums[OFFSET_PULL] / left, 1.0 / math.sqrt(left)
    wide = deviation * deviation + prior[1] * prior[1]
    squared = (offset / deviation) ** 2
    evidence = -0.5 * squared * (1.0 - deviation * deviation / wide)
    odds_none = (1.0 - prior[0]) / prior[0] * math.sqrt(wide) / deviation * math.exp(evidence)
    probability = 1.0 / (1.0 + odds_none)
    if probability < _NO_OFFSET:
        return offset, deviation
    shrunk = offset * prior[1] * prior[1] / wide
    left_over = deviation * deviation * prior[1] * prior[1] / wide
    variance = probability * left_over + probability * (1.0 - probability) * shrunk * shrunk
    moved(pose, -probability * shrunk * response)
    for j in range(3):
        for k in range(3):
            covariance[j, k] += response[j] * response[k] * variance
    covariance_into(covariance.copy(), information)  # the inverse of the inverse
    return offset, deviation

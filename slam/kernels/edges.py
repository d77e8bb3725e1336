"""What beams that pass an edge tell: their ranges jump with the pose, so no gradient describes them.

Each such beam is a likelihood over one number, how far the robot stands to the side of the beam.
Expectation propagation (Minka, 2001) joins these with the Gaussian of all other beams.
"""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.kernels import compiled, copy_into
from slam.kernels.beam_likelihood import bell, sigma_at
from slam.kernels.mixed_pixels import density_beside
from slam.kernels.normal_equations import covariance_into, inverted, variance_along

_ABSENT = 0.05
"""Chosen: one thing in twenty on the map has been moved since; then the beam sees what is behind."""
_ABSENT_THOUGH_MET = 0.02
"""Chosen: where a beam beside it ends on it. It may have been moved by less than noise shows."""
_BESIDE, _SAME_THING_M = 4, 0.15
_MIN_PRECISION = 1e-3
_LEAST_SHARE = 0.3
"""Chosen: of the information of edges, however they disagree."""
_MOST_TOLD = 2.0
"""Chosen, in log likelihood: of one beam. Light that an edge splits may look like light of either wall,
so that a beam tells up to six, and is wrong as seldom; but then by ten standard deviations, which no
Gaussian foretells: of a thousand poses at rest the largest NEES was 82 to 106. With 2 it is 20 to 40,
at 3 to 6 % more error."""
_ROOT_TWO_PI = 2.5066282746310002
_DAMPING = 0.8
"""Chosen: full steps of expectation propagation may swing between two edges that disagree."""


@compiled
def ranges_beside(
    vertices: FloatArray,
    walls: IntArray,
    beams: IntArray,
    origins: FloatArray,
    directions: FloatArray,
    shifts: FloatArray,
    is_due: BoolArray,
    reach: float,
    ranges: FloatArray,
) -> None:
    """Range of each chosen beam from origins shifted to its left; inf where nothing is hit.

    beams: (E,) which of the (N, 2) origins and directions. shifts: (E, K) [m], increasing. is_due:
    (E,) of which the ranges (E, K) are to be written.
    """
    node_count = shifts.shape[1]
    for e in range(beams.shape[0]):
        if not is_due[e]:
            continue
        i = beams[e]
        ranges[e] = np.inf
        ux, uy = directions[i, 0], directions[i, 1]
        low, high = shifts[e, 0], shifts[e, node_count - 1]
        step = (high - low) / (node_count - 1)
        for w in range(walls.shape[0]):
            a, b = walls[w, 0], walls[w, 1]
            ax, ay = vertices[a, 0] - origins[i, 0], vertices[a, 1] - origins[i, 1]
            left_a = ax * -uy + ay * ux
            bx, by = vertices[b, 0] - origins[i, 0], vertices[b, 1] - origins[i, 1]
            left_b = bx * -uy + by * ux
            # from its left, a wall runs from right to left
            if left_b <= left_a or left_b < low or left_a > high:
                continue
            ahead_a, ahead_b = ax * ux + ay * uy, bx * ux + by * uy
            if max(ahead_a, ahead_b) <= 0.0 or min(ahead_a, ahead_b) > reach:
                continue
            slope = (ahead_b - ahead_a) / (left_b - left_a)
            first = max(0, math.ceil((left_a - low) / step))
            last = min(node_count - 1, math.floor((left_b - low) / step))
            for k in range(first, last + 1):
                ahead = ahead_a + slope * (low + k * step - left_a)
                if 0.0 < ahead < ranges[e, k]:
                    ranges[e, k] = ahead


@compiled
def propagate(
    information: FloatArray,
    axes: FloatArray,
    shifts: FloatArray,
    likelihoods: FloatArray,
    sweeps: int,
    mean: FloatArray,
    covariance: FloatArray,
) -> None:
    """Mean (3,) of a pose, given a Gaussian at zero and what edges tell; its information grows.

    information: (3, 3) of the Gaussian, in place, may be singular. covariance: (3, 3) result. axes: (E, 3): sideways shift of each beam by a motion of
    the base. shifts, likelihoods: (E, K), a beam's likelihood where it is shifted by so much.
    """
    count = axes.shape[0]
    precisions, pulls = np.zeros(count), np.zeros(count)
    doubts = np.zeros(count)
    total_pull, carried = np.zeros(3), np.zeros(3)
    mean[:] = 0.0
    if not covariance_into(information, covariance):
        copy_into(inverted(information), covariance)
    for _ in range(sweeps):
        for e in range(count):
            a0, a1, a2 = axes[e, 0], axes[e, 1], axes[e, 2]
            for j in range(3):
                carried[j] = covariance[j, 0] * a0 + covariance[j, 1] * a1 + covariance[j, 2] * a2
            variance = a0 * carried[0] + a1 * carried[1] + a2 * carried[2]
            centre = a0 * mean[0] + a1 * mean[1] + a2 * mean[2]
            # the cavity: what all others say of this beam's shift
            cavity_precision = 1.0 / variance - precisions[e]
            if not cavity_precision > 0.0:
                continue
            cavity = 1.0 / cavity_precision
            cavity_mean = cavity * (centre / variance - pulls[e])
            mass = first = second = 0.0
            for k in range(shifts.shape[1]):
                off = shifts[e, k] - cavity_mean
                share = math.exp(-0.5 * off * off * cavity_precision) * likelihoods[e, k]
                mass += share
                first += share * off
                second += share * off * off
            if not mass > 1e-300:
                continue
            tilted_mean = cavity_mean + first / mass
            tilted = second / mass - (first / mass) ** 2
            # no narrower than the nodes can tell
            step = shifts[e, 1] - shifts[e, 0]
            tilted = max(tilted, step * step / 3.0)
            told = 1.0 / tilted - cavity_precision
            precision = max(told, _MIN_PRECISION * cavity_precision)
            doubts[e] = precision - told
            pull = tilted_mean * (precision + cavity_precision) - cavity_mean * cavity_precision
            precision_step = _DAMPING * (precision - precisions[e])
            pull_step = _DAMPING * (pull - pulls[e])
            precisions[e] += precision_step
            pulls[e] += pull_step
            # the rank-one change of the covariance (Sherman and Morrison, 1950)
            shrunk = precision_step / (1.0 + precision_step * variance)
            for j in range(3):
                total_pull[j] += pull_step * axes[e, j]
                for m in range(3):
                    covariance[j, m] -= shrunk * carried[j] * carried[m]
            for j in range(3):
                mean[j] = (
                    covariance[j, 0] * total_pull[0]
                    + covariance[j, 1] * total_pull[1]
                    + covariance[j, 2] * total_pull[2]
                )
    # edges that disagree with all others leave the pose less sure: by one number for all of them, since
    # with single precisions below zero the rest of the information may be left with none
    told = agreed = 0.0
    for e in range(count):
        variance = variance_along(axes[e], covariance)
        agreed += precisions[e] * variance
        told += (precisions[e] - doubts[e]) * variance
    if agreed > 0.0:
        precisions *= min(max(told / agreed, _LEAST_SHARE), 1.0)
    for e in range(count):
        for j in range(3):
            for m in range(3):
                information[j, m] += precisions[e] * axes[e, j] * axes[e, m]
    covariance_into(information, covariance)


@compiled
def edge_likelihoods(
    ranges: FloatArray,
    beams: IntArray,
    measured: FloatArray,
    noise: FloatArray,
    limits: FloatArray,
    outliers: FloatArray,
    shares: FloatArray,
    absent: FloatArray,
    predicted: FloatArray,
    likelihoods: FloatArray,
) -> None:
    """(E, K) likelihood of each chosen beam's measured range, were it to look at these (E, K).

    The density of the beam model, times the square root of 2 pi; a beam of which nothing can be
    said has the same everywhere. Light that an edge splits gives anything between its two walls,
    that which the beam sees and that of a neighbour (N,) predicted. shares: (2,) of `mixing_shares`.
    absent: (E,) of `share_absent`; of what is not there at all nothing can be said.
    """
    for e in range(beams.shape[0]):
        i = beams[e]
        z = measured[i]
        far = 0.0
        for k in range(ranges.shape[1]):
            if math.isfinite(ranges[e, k]):
                far = max(far, ranges[e, k])
        behind = outliers[0] * _ROOT_TWO_PI
        if far > 0.0:
            behind += absent[e] * density(z, far, noise, limits)
        left = predicted[i + 1] if i + 1 < predicted.shape[0] else np.inf
        right = predicted[i - 1] if i > 0 else np.inf
        for k in range(ranges.shape[1]):
            h = ranges[e, k]
            likelihoods[e, k] = behind
            if math.isfinite(h):
                clean = density(z, h, noise, limits)
                told = density_beside(z, h, clean, left, right, noise, shares)
                likelihoods[e, k] += (1.0 - absent[e]) * told


@compiled
def density(z: float, h: float, noise: FloatArray, limits: FloatArray) -> float:
    """Gaussian density of a range z about h, times the square root of 2 pi; 0 out of the limits."""
    sigma = sigma_at(noise, h)
    if not limits[0] + 3.0 * sigma <= h <= limits[1] - 3.0 * sigma:
        return 0.0
    result: float = bell((z - h) / sigma) / sigma
    return result


@compiled
def share_absent(
    i: int,
    near: float,
    predicted: FloatArray,
    measured: FloatArray,
    noise: FloatArray,
    is_kept: BoolArray,
) -> float:
    """Probability that the thing whose edge beam i passes is not there, by its neighbours on it.

    1 where they see past it; that of anything on the map where none of them tells.
    """
    on_it = past_it = met = 0
    for j in range(max(i - _BESIDE, 0), min(i + _BESIDE + 1, predicted.shape[0])):
        if not is_kept[j] or not math.isfinite(measured[j]):
            continue
        if abs(predicted[j] - near) < _SAME_THING_M:
            off = (measured[j] - predicted[j]) / sigma_at(noise, predicted[j])
            on_it += 1
            past_it += off > 4.0
            met += abs(off) < 3.0
    if past_it > 0 and 2 * past_it >= on_it:
        return 1.0
    return _ABSENT if met == 0 else _ABSENT_THOUGH_MET


@compiled
def doubt(likelihoods: FloatArray) -> None:
    """Likelihoods (E, K), in place: no beam makes a shift less likely than e^-_MOST_TOLD of its best."""
    for e in range(likelihoods.shape[0]):
        least = math.exp(-_MOST_TOLD) * likelihoods[e].max()
        for k in range(likelihoods.shape[1]):
            likelihoods[e, k] = max(likelihoods[e, k], least)


@compiled
def smoothed(likelihoods: FloatArray, times: int) -> None:
    """Likelihoods (E, K) averaged with their neighbours 1 : 2 : 1, in place, so many times over.

    An edge is never known better than its nodes lie apart.
    """
    last = likelihoods.shape[1] - 1
    for e in range(likelihoods.shape[0]):
        for _ in range(times):
            before = likelihoods[e, 0]
            for k in range(last + 1):
                here, after = likelihoods[e, k], likelihoods[e, min(k + 1, last)]
                likelihoods[e, k] = 0.25 * before + 0.5 * here + 0.25 * after
                before = here

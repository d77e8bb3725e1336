"""Gauss-Newton of a scan on a grid that stores, in each cell, the surface nearest to it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray
from slam.kernels import compiled_fast
from slam.kernels.beam_likelihood import moved, sigma_at, solved

_FLATTEST = 0.3**2
"""Floor of a point's squared incidence in its weight: what grazes a wall is often another wall's."""
_KERNEL = 6.0
"""Of the noise's variance: so far off a point counts a quarter."""
_NOISE_SCALE_M = 0.03


@compiled_fast
def weigh(points: FloatArray, origin: FloatArray, noise: FloatArray, out: FloatArray) -> None:
    """Into out (N, 5): x, y, direction of the beam from the origin (2,), variance of its range.

    points: (N, 2) base frame. noise: (K, 2) range and standard deviation, straight between.
    """
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - origin[0], points[i, 1] - origin[1]
        range_m = math.sqrt(dx * dx + dy * dy)
        per_m = 1.0 / max(range_m, 1e-9)
        sigma = sigma_at(noise, range_m)
        out[i, 0], out[i, 1] = points[i, 0], points[i, 1]
        out[i, 2], out[i, 3] = dx * per_m, dy * per_m
        out[i, 4] = sigma * sigma


@compiled_fast
def add_up(
    surfels: NDArray[np.float32],
    columns: int,
    origin_x: float,
    origin_y: float,
    per_m: float,
    is_one_sided: bool,
    points: FloatArray,
    stride: int,
    pose: FloatArray,
    scale: float,
    information: FloatArray,
    pull: FloatArray,
) -> float:
    """Sums over every stride-th point; the summed robust cost, 1 for a point with no surface near.

    surfels: (C, 4) unit normal, offset along it, standard deviation (0: no surface near) of each
    cell, rows of `columns` cells of side 1 / per_m from the origin. points: (N, 5) of `weigh`.
    scale: residual [m], beside the noise, at which a point counts a quarter (Geman, McClure 1987).
    """
    rows = surfels.shape[0] // columns
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x0, y0 = (pose[0] - origin_x) * per_m, (pose[1] - origin_y) * per_m
    cc, ss = c * per_m, s * per_m
    # the plane's offset, counted from the pose: residuals are small differences of small numbers
    px0, py0 = pose[0], pose[1]
    xx = xy = xt = yy = yt = tt = px = py = pt = 0.0
    cost = 0.0
    for i in range(0, points.shape[0], stride):
        bx, by = points[i, 0], points[i, 1]
        column_at = x0 + cc * bx - ss * by
        row_at = y0 + ss * bx + cc * by
        if not (0.0 <= column_at < columns and 0.0 <= row_at < rows):
            cost += 1.0
            continue
        cell = np.uint64(row_at) * np.uint64(columns) + np.uint64(column_at)
        sigma = surfels[cell, 3]
        if sigma == 0.0:
            cost += 1.0
            continue
        nx, ny = surfels[cell, 0], surfels[cell, 1]
        mx, my = c * nx + s * ny, c * ny - s * nx  # the normal seen from the base
        residual = mx * bx + my * by + (nx * px0 + ny * py0 - surfels[cell, 2])
        cosine = mx * points[i, 2] + my * points[i, 3]
        if is_one_sided and cosine > 0.0:
            cost += 1.0  # the nearest surface shows its back: it is another one that was seen
            continue
        variance = points[i, 4] * max(cosine * cosine, _FLATTEST) + sigma * sigma
        limit = scale + _KERNEL * variance
        squared = residual * residual
        per_both = 1.0 / ((limit + squared) * variance)
        share = limit * variance * per_both
        cost += 1.0 - share
        weight = share * limit * per_both
        mt = bx * my - by * mx
        wx, wy, wt = weight * mx, weight * my, weight * mt
        xx += wx * mx
        xy += wx * my
        xt += wx * mt
        yy += wy * my
        yt += wy * mt
        tt += wt * mt
        px -= wx * residual
        py -= wy * residual
        pt -= wt * residual
    information[0, 0], information[1, 1], information[2, 2] = xx, yy, tt
    information[0, 1] = information[1, 0] = xy
    information[0, 2] = information[2, 0] = xt
    information[1, 2] = information[2, 1] = yt
    pull[0], pull[1], pull[2] = px, py, pt
    return cost


@compiled_fast
def descend(
    surfels: NDArray[np.float32],
    columns: int,
    origin_x: float,
    origin_y: float,
    per_m: float,
    is_one_sided: bool,
    points: FloatArray,
    origin: FloatArray,
    noise: FloatArray,
    scales: FloatArray,
    strides: NDArray[np.int64],
    max_steps: int,
    tolerance: float,
    pose: FloatArray,
    information: FloatArray,
) -> tuple[int, bool, float]:
    """The pose (3,), in place, settled at each scale in turn; steps, whether settled, and the cost."""
    pull, step = np.empty(3), np.empty(3)
    weighed = np.empty((points.shape[0], 5))
    weigh(points, origin, noise, weighed)
    steps, settled, cost = 0, False, 0.0
    last = scales.shape[0] - 1
    for stage in range(last + 1):
        settled = False
        # a coarse stage need only come within reach of the next one's scale
        enough = tolerance if stage == last else 0.1 * max(scales[stage + 1], _NOISE_SCALE_M)
        for _ in range(max_steps):
            cost = add_up(
                surfels, columns, origin_x, origin_y, per_m, is_one_sided, weighed, strides[stage],
                pose, scales[stage] ** 2, information, pull,
            )  # fmt: skip
            solved(information, pull, step)
            moved(pose, step)
            steps += 1
            if math.hypot(step[0], step[1]) <= enough and abs(step[2]) <= enough:
                settled = True
                break
    return steps, settled, cost

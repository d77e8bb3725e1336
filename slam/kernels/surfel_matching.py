"""Gauss-Newton of a scan on a grid that stores, in each cell, the surface nearest to it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray
from slam.kernels import compiled, compiled_vectorised
from slam.kernels.beam_likelihood import sigma_at
from slam.kernels.normal_equations import moved, solved, symmetric_into

_FLATTEST = 0.3**2
"""Floor of a point's squared incidence in its weight: what grazes a wall is often another wall's."""
_SAME_CELLS, _SAME_CELLS_RAD = 0.05, 0.001
"""Chosen: share of a cell, and turn, by which a pose may move before surfaces are looked up again (with a
tenth, points at the end of a corridor kept a surface that was no longer theirs, and held it); after
one step without they are in any case."""
_KERNEL = 6.0
"""Of the noise's variance: so far off a point counts a quarter."""
_NOISE_SCALE_M = 0.03
_STEPS_BACK = 3
"""Standard deviations of the range by which a point is moved towards the laser, one by one."""
_MAX_CHANGE = 0.2
"""Of a beam's variance, from where it ended to where the surface is; three sigmas at 3 % of range."""


@compiled
def weigh(points: FloatArray, origin: FloatArray, noise: FloatArray, out: FloatArray) -> None:
    """Into out (6, N): x, y, direction of the beam from the origin (2,), variance of its range, and
    the change of that per metre of range.

    points: (N, 2) base frame. noise: (K, 2) range and standard deviation, straight between.
    """
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - origin[0], points[i, 1] - origin[1]
        range_m = math.sqrt(dx * dx + dy * dy)
        per_m = 1.0 / max(range_m, 1e-9)
        sigma = sigma_at(noise, range_m)
        out[0, i], out[1, i] = points[i, 0], points[i, 1]
        out[2, i], out[3, i] = dx * per_m, dy * per_m
        out[4, i] = sigma * sigma
        out[5, i] = 2.0 * sigma * (sigma_at(noise, range_m + sigma) - sigma) / max(sigma, 1e-12)


@compiled
def look_up(
    surfels: NDArray[np.float32],
    columns: int,
    origin_x: float,
    origin_y: float,
    per_m: float,
    is_one_sided: bool,
    points: FloatArray,
    stride: int,
    pose: FloatArray,
    found: FloatArray,
) -> int:
    """Into found (4, N): normal, offset seen from the pose, and variance of the surface nearest to
    every stride-th point, packed to the front; variance below 0 where none is near. How many.

    A point that noise put behind a thin thing is nearest to its back: the front is looked for on the
    way to the laser. Else the points before thin things would count, those behind them not.
    surfels: (C, 4) unit normal, offset along it, standard deviation (0: no surface near) of each
    cell, rows of `columns` cells of side 1 / per_m from the origin. points: (6, N) of `weigh`.
    """
    rows = surfels.shape[0] // columns
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x0, y0 = (pose[0] - origin_x) * per_m, (pose[1] - origin_y) * per_m
    cc, ss = c * per_m, s * per_m
    k = 0
    for i in range(0, points.shape[1], stride):
        bx, by = points[0, i], points[1, i]
        column_at = x0 + cc * bx - ss * by
        row_at = y0 + ss * bx + cc * by
        sigma = nx = ny = offset = 0.0
        if 0.0 <= column_at < columns and 0.0 <= row_at < rows:
            cell = np.uint64(row_at) * np.uint64(columns) + np.uint64(column_at)
            sigma = surfels[cell, 3]
            nx, ny, offset = surfels[cell, 0], surfels[cell, 1], surfels[cell, 2]
            if is_one_sided:
                ux = cc * points[2, i] - ss * points[3, i]
                uy = ss * points[2, i] + cc * points[3, i]
                if nx * ux + ny * uy > 0.0:
                    front = _front_before(
                        surfels, columns, rows, column_at, row_at, ux, uy, math.sqrt(points[4, i])
                    )
                    if front >= 0:
                        nx, ny, offset = surfels[front, 0], surfels[front, 1], surfels[front, 2]
                        sigma = surfels[front, 3]
        found[0, k] = nx
        found[1, k] = ny
        # residuals are small differences of small numbers, wherever the map's origin lies
        found[2, k] = nx * pose[0] + ny * pose[1] - offset
        found[3, k] = sigma * sigma if sigma > 0.0 else -1.0
        k += 1
    return k


@compiled
def _front_before(
    surfels: NDArray[np.float32],
    columns: int,
    rows: int,
    column_at: float,
    row_at: float,
    ux: float,
    uy: float,
    sigma: float,
) -> int:
    """The first cell, in steps of sigma [m] towards the laser, whose surface looks at it; or -1.

    ux, uy: direction of the beam, in cells per metre.
    """
    for step in range(1, _STEPS_BACK + 1):
        column, row = column_at - step * sigma * ux, row_at - step * sigma * uy
        if 0.0 <= column < columns and 0.0 <= row < rows:
            cell = int(row) * columns + int(column)
            if surfels[cell, 3] > 0.0 and surfels[cell, 0] * ux + surfels[cell, 1] * uy <= 0.0:
                return cell
    return -1


@compiled_vectorised
def follow(found: FloatArray, count: int, x: float, y: float) -> None:
    """The same surfaces as `look_up` found, seen from a pose moved by x, y [m]."""
    for k in range(count):
        found[2, k] += found[0, k] * x + found[1, k] * y


@compiled_vectorised
def add_up(
    found: FloatArray,
    count: int,
    is_one_sided: bool,
    points: FloatArray,
    stride: int,
    heading: float,
    scale: float,
    information: FloatArray,
    pull: FloatArray,
) -> float:
    """Sums over the points looked up; the summed robust cost, 1 for a point with no surface near.

    found, count: of `look_up`. scale: squared residual [m2], beside the noise, at which a point
    counts a quarter (Geman and McClure, 1987). information: (3, 3), pull: (3,) results.
    """
    c, s = math.cos(heading), math.sin(heading)
    xx = xy = xt = yy = yt = tt = px = py = pt = 0.0
    kept = 0.0
    for k in range(count):
        i = k * stride
        nx, ny, surface = found[0, k], found[1, k], found[3, k]
        bx, by = points[0, i], points[1, i]
        mx, my = c * nx + s * ny, c * ny - s * nx  # the normal seen from the base
        residual = mx * bx + my * by + found[2, k]
        cosine = mx * points[2, i] + my * points[3, i]
        # a surface that shows its back is not the one that was seen
        counts = surface >= 0.0 and not (is_one_sided and cosine > 0.0)
        # of the noise where the surface is, not where the beam ended: ranges that noise made short
        # would weigh more than those it made long, and draw the pose by half a sigma to one side
        across = points[4, i] * max(cosine * cosine, _FLATTEST)
        shift = -points[5, i] * residual * cosine
        variance = across + min(max(shift, -_MAX_CHANGE * across), _MAX_CHANGE * across)
        variance += abs(surface)
        limit = scale + _KERNEL * variance
        per_both = 1.0 / ((limit + residual * residual) * variance)
        share = limit * variance * per_both if counts else 0.0
        kept += share
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
    symmetric_into(xx, xy, xt, yy, yt, tt, information)
    pull[0], pull[1], pull[2] = px, py, pt
    return count - kept


@compiled
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
    weighed, found = np.empty((6, points.shape[0])), np.empty((4, points.shape[0]))
    weigh(points, origin, noise, weighed)
    steps, settled, cost = 0, False, 0.0
    count, x, y = 0, pose[0], pose[1]
    cell_m = 1.0 / per_m
    last = scales.shape[0] - 1
    for stage in range(last + 1):
        settled = is_near = False
        stride = strides[stage]
        # a coarse stage need only come within reach of the next one's scale
        enough = tolerance if stage == last else 0.1 * max(scales[stage + 1], _NOISE_SCALE_M)
        for _ in range(max_steps):
            if is_near:
                follow(found, count, pose[0] - x, pose[1] - y)
            else:
                count = look_up(
                    surfels, columns, origin_x, origin_y, per_m, is_one_sided, weighed, stride,
                    pose, found,
                )  # fmt: skip
            x, y = pose[0], pose[1]
            cost = add_up(
                found, count, is_one_sided, weighed, stride, pose[2], scales[stage] ** 2,
                information, pull,
            )  # fmt: skip
            solved(information, pull, step)
            moved(pose, step)
            steps += 1
            length, turn = math.hypot(step[0], step[1]), abs(step[2])
            if length <= enough and turn <= enough:
                settled = True
                break
            is_near = not is_near and length <= _SAME_CELLS * cell_m and turn <= _SAME_CELLS_RAD
    return steps, settled, cost

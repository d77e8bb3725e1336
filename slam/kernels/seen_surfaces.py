"""What the points of a scan see of a map's surfaces, see `slam.kernels.surface_map`, and tell of a pose by it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray, IntArray
from slam.kernels import compiled, compiled_vectorised
from slam.kernels.surface_map import (
    DIRECTION_VARIANCE,
    FIELDS,
    LEVER,
    MADE,
    MIDDLE,
    NONE,
    NORMAL_X,
    NORMAL_Y,
    OFFSET,
    SIDES,
    STATE,
    VARIANCE,
    entry_of,
    make_surfel,
    sides_of,
)

_KERNEL = 6.0
"""Of a point's variance: so far off it counts a quarter."""
_FITS = 9.0
"""Squared residual, in variances, of a point that fits: three sigmas."""

# rows of what points see, behind the surfel's: whether they see one, and where they are, map frame and base
_SEES, _X, _Y, _X_BASE, _Y_BASE = FIELDS, FIELDS + 1, FIELDS + 2, FIELDS + 3, FIELDS + 4
ROWS = FIELDS + 5
# what points tell: information (xx, xy, xt, yy, yt, tt), pull (3,), what noise makes of the information (as that), and
# how many points see a surface, fit it, and what they cost
PULL, NOISE, SEEN, FITTING, COST, TOLD = 6, 9, 15, 16, 17, 18


@compiled
def begin(points: FloatArray, places: IntArray, seen: FloatArray) -> None:
    """Of points (N, 3): none has been looked up, none sees a surface. See `look_up`."""
    for i in range(points.shape[0]):
        places[i, 2] = -1
        for k in range(ROWS):
            seen[k, i] = 0.0
        seen[LEVER, i] = seen[VARIANCE, i] = 1.0  # what is divided by is no zero
        if not math.isnan(points[i, 2]):
            seen[_X_BASE, i], seen[_Y_BASE, i] = points[i, 0], points[i, 1]


@compiled
def look_up(
    index: NDArray[np.int32],
    heads: NDArray[np.int32],
    sums: NDArray[np.float32],
    surfels: FloatArray,
    cells_m: FloatArray,
    points: FloatArray,
    finest: int,
    pose: FloatArray,
    places: IntArray,
    seen: FloatArray,
) -> None:
    """Into seen (ROWS, N): the surfels that points (N, 3) see from a pose (3,), in the finest level that
    has one. places: (N, 3) column and row in the level `finest` and sides of each point when it was looked up
    last; as long as these stay, so does its surfel: between two steps few points leave their cells."""
    fine_m, c, s = cells_m[finest], math.cos(pose[2]), math.sin(pose[2])
    for i in range(points.shape[0]):
        if math.isnan(points[i, 2]):
            continue
        px, py = points[i, 0], points[i, 1]
        x, y = pose[0] + c * px - s * py, pose[1] + s * px + c * py
        seen[_X, i], seen[_Y, i] = x, y
        near, far = sides_of(points[i, 2] + pose[2])
        column, row = math.floor(x / fine_m), math.floor(y / fine_m)
        sides = near * SIDES + far
        if places[i, 2] == sides and places[i, 0] == column and places[i, 1] == row:
            continue
        places[i, 0], places[i, 1], places[i, 2] = column, row, sides
        seen[_SEES, i] = 0.0
        level = finest
        while level >= 0:
            cell_m = cells_m[level]
            column, row = math.floor(x / cell_m), math.floor(y / cell_m)
            entry = entry_of(index, heads, level, column, row)
            if entry != NONE:
                side = near
                # of one call, in a loop: two would not be inlined
                for _ in range(2):
                    if heads[entry, STATE] >> side & 1:
                        heads[entry, STATE] &= ~(1 << side | 1 << side + MADE)
                        if make_surfel(
                            index, heads, sums, level, column, row, side, cell_m,
                            surfels[entry, side],
                        ):  # fmt: skip
                            heads[entry, STATE] |= 1 << side + MADE
                    if heads[entry, STATE] >> side + MADE & 1:
                        seen[_SEES, i] = 1.0
                        for k in range(FIELDS):
                            seen[k, i] = surfels[entry, side, k]
                        break
                    side = far
                if seen[_SEES, i] > 0.0:
                    break
            level -= 1


@compiled_vectorised
def tell(
    seen: FloatArray, c: float, s: float, variance: float, scale: float, told: FloatArray
) -> None:
    """Into told (TOLD,): what points tell at a pose of a heading's cosine and sine; seen (ROWS, N) as of
    `look_up` there. variance and scale [m2]: as in `align`, the latter squared."""
    xx = xy = xt = yy = yt = tt = pull_x = pull_y = pull_t = 0.0
    noise_xx = noise_xy = noise_xt = noise_yy = noise_yt = noise_tt = 0.0
    count = fitting = cost = 0.0
    for i in range(seen.shape[1]):
        px, py, x, y = seen[_X_BASE, i], seen[_Y_BASE, i], seen[_X, i], seen[_Y, i]
        normal_x, normal_y, sees = seen[NORMAL_X, i], seen[NORMAL_Y, i], seen[_SEES, i]
        direction_variance = seen[DIRECTION_VARIANCE, i]
        residual = normal_x * x + normal_y * y - seen[OFFSET, i]
        wide = variance + seen[VARIANCE, i]
        limit = scale + _KERNEL * wide
        share = limit / (limit + residual * residual)
        # so few points may lie on a line by chance: where they are weighed, the usual noise is
        # added to theirs; what they pull is mended by their own alone, which is unbiased
        turned = direction_variance + variance / seen[LEVER, i]
        beyond_m = normal_y * x - normal_x * y - seen[MIDDLE, i]
        weight = sees * share * share / (wide + turned * beyond_m * beyond_m)
        count += sees
        fitting += sees if residual * residual < _FITS * (wide + variance) else 0.0
        cost += sees * (1.0 - share)
        nx = c * normal_x + s * normal_y
        ny = c * normal_y - s * normal_x
        nt = px * ny - py * nx
        xx += weight * nx * nx
        xy += weight * nx * ny
        xt += weight * nx * nt
        yy += weight * ny * ny
        yt += weight * ny * nt
        tt += weight * nt * nt
        # noise turns surfaces; it pulls as if along them, back to where their points are
        outward = weight * direction_variance * beyond_m
        nd = -px * nx - py * ny
        pull_x += outward * ny - weight * nx * residual
        pull_y -= outward * nx + weight * ny * residual
        pull_t += outward * nd - weight * nt * residual
        noise = weight * turned
        noise_xx += noise * ny * ny
        noise_xy -= noise * ny * nx
        noise_xt += noise * ny * nd
        noise_yy += noise * nx * nx
        noise_yt -= noise * nx * nd
        noise_tt += noise * nd * nd
    told[0], told[1], told[2], told[3], told[4], told[5] = xx, xy, xt, yy, yt, tt
    told[6], told[7], told[8] = pull_x, pull_y, pull_t
    told[9], told[10], told[11] = noise_xx, noise_xy, noise_xt
    told[12], told[13], told[14] = noise_yy, noise_yt, noise_tt
    told[SEEN], told[FITTING], told[COST] = count, fitting, cost

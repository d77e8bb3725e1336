"""Surfaces learnt from points, in cells of several sizes on a torus; a scan matched with them.

A point says from which side its surface was seen: the two sides of a wall are two surfaces.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.arrays import BoolArray, FloatArray
from slam.kernels import compiled

SIDE = 1024
"""Cells along each side of the torus; what lies farther apart than that shares a cell, by turns."""
_MASK = SIDE - 1
SIDES = 8
"""Directions that surfaces face, an eighth of a turn apart: each point counts for the two nearest,
so that the two sides of a wall, and the two walls of a corner, share none. With four, a door post
that was seen from two sides made one slanting surface: 0.1 m at each door."""
_LEAST_POINTS = 4.0
"""Chosen: fewer points make no surface; three lie on a line by chance."""
_LEAST_LENGTH = 0.15
"""Of a cell's side: shorter than that along its longer axis, a cluster has no direction."""
_KERNEL = 6.0
"""Of a point's variance: so far off it counts a quarter."""
_FITS = 9.0
"""Squared residual, in variances, of a point that fits: three sigmas."""

# what `surfels` (E, SIDES, 5) holds: unit normal, offset along it [m], variance across [m2], count
# of the points
NORMAL_X, NORMAL_Y, OFFSET, VARIANCE, COUNT = 0, 1, 2, 3, 4
# what `stats` holds of a match
SEEN, FITTING, COST, STEPS, ODOMETRY_WEIGHT = 0, 1, 2, 3, 4


@compiled
def _sides(facing: float) -> tuple[int, int]:
    """The two of the SIDES that are nearest to a direction [rad], the nearest first."""
    eighths = facing * (SIDES / (2.0 * math.pi))
    low = math.floor(eighths)
    if eighths - low < 0.5:
        return low & (SIDES - 1), (low + 1) & (SIDES - 1)
    return (low + 1) & (SIDES - 1), low & (SIDES - 1)


@compiled
def _entry(
    index: NDArray[np.int32], cells: NDArray[np.int32], level: int, column: int, row: int
) -> int:
    """Where a cell of a level is kept, -1 where no point is in it or beside it."""
    entry = index[level, column & _MASK, row & _MASK]
    if entry >= 0 and cells[entry, 0] == column and cells[entry, 1] == row:
        return int(entry)
    return -1


@compiled
def put(
    index: NDArray[np.int32],
    cells: NDArray[np.int32],
    uses: NDArray[np.int32],
    free: NDArray[np.int32],
    sums: NDArray[np.float32],
    is_due: BoolArray,
    points: FloatArray,
    first: int,
    sign: int,
    cell_m: float,
) -> int:
    """Adds points (N, 3) [m, m, rad], map frame, from the first on, to the cells that they lie in;
    sign -1 takes them out. The number of the point at which entries ran out, N when all are done.

    index: (SIDE, SIDE) entries of cells with a point in them or beside them, -1 of others. cells:
    (E, 2) of the plane that entries stand for; uses: (E,) by points; free: (E + 1,) entries that
    nothing uses, their count at the end. sums: (E, SIDES, 6) count, x, y, xx, xy, yy from the cell's
    middle. is_due: (E, SIDES) whose surfel has to be made anew.
    """
    for i in range(first, points.shape[0]):
        if math.isnan(points[i, 2]):
            continue
        if sign > 0 and free[-1] < 9:
            return i
        column, row = math.floor(points[i, 0] / cell_m), math.floor(points[i, 1] / cell_m)
        near, far = _sides(points[i, 2])
        for u in range(-1, 2):
            for v in range(-1, 2):
                a, b = (column + u) & _MASK, (row + v) & _MASK
                entry = index[a, b]
                if entry < 0 or cells[entry, 0] != column + u or cells[entry, 1] != row + v:
                    if sign < 0:
                        continue  # another cell of the plane has taken the place since
                    if entry < 0:
                        free[-1] -= 1
                        entry = free[free[-1]]
                        index[a, b] = entry
                    cells[entry, 0], cells[entry, 1] = column + u, row + v
                    uses[entry], sums[entry], is_due[entry] = 0, 0.0, True
                uses[entry] += sign
                is_due[entry, near] = is_due[entry, far] = True
                if u == 0 and v == 0:
                    x = points[i, 0] - (column + 0.5) * cell_m
                    y = points[i, 1] - (row + 0.5) * cell_m
                    for side in (near, far):
                        sums[entry, side, 0] += sign
                        sums[entry, side, 1] += sign * x
                        sums[entry, side, 2] += sign * y
                        sums[entry, side, 3] += sign * x * x
                        sums[entry, side, 4] += sign * x * y
                        sums[entry, side, 5] += sign * y * y
                if uses[entry] <= 0:
                    index[a, b] = -1
                    free[free[-1]] = entry
                    free[-1] += 1
    return points.shape[0]


@compiled
def _make(
    index: NDArray[np.int32],
    cells: NDArray[np.int32],
    sums: NDArray[np.float32],
    level: int,
    column: int,
    row: int,
    side: int,
    cell_m: float,
    surfel: FloatArray,
) -> None:
    """The line through a cell's and its neighbours' points of a side; COUNT 0 where they make none."""
    surfel[COUNT] = 0.0
    n = sx = sy = sxx = sxy = syy = 0.0
    for u in range(-1, 2):
        for v in range(-1, 2):
            entry = _entry(index, cells, level, column + u, row + v)
            if entry < 0:
                continue
            held = sums[entry, side]
            if held[0] < 0.5:
                continue
            m, x, y = held[0], u * cell_m, v * cell_m
            n += m
            sx += held[1] + m * x
            sy += held[2] + m * y
            sxx += held[3] + 2.0 * x * held[1] + m * x * x
            sxy += held[4] + x * held[2] + y * held[1] + m * x * y
            syy += held[5] + 2.0 * y * held[2] + m * y * y
    if n < _LEAST_POINTS:
        return
    mean_x, mean_y = sx / n, sy / n
    cxx, cxy, cyy = sxx / n - mean_x**2, sxy / n - mean_x * mean_y, syy / n - mean_y**2
    half = 0.5 * (cxx + cyy)
    apart = math.sqrt(0.25 * (cxx - cyy) ** 2 + cxy * cxy)
    if half + apart < (_LEAST_LENGTH * cell_m) ** 2:
        return
    along = 0.5 * math.atan2(2.0 * cxy, cxx - cyy)
    surfel[NORMAL_X], surfel[NORMAL_Y] = -math.sin(along), math.cos(along)
    x, y = mean_x + (column + 0.5) * cell_m, mean_y + (row + 0.5) * cell_m
    surfel[OFFSET] = surfel[NORMAL_X] * x + surfel[NORMAL_Y] * y
    surfel[VARIANCE] = max(half - apart, 0.0)
    surfel[COUNT] = n


@compiled
def align(
    index: NDArray[np.int32],
    cells: NDArray[np.int32],
    sums: NDArray[np.float32],
    is_due: BoolArray,
    surfels: FloatArray,
    cells_m: FloatArray,
    points: FloatArray,
    variance: float,
    share_counted: float,
    finest: NDArray[np.int64],
    scales_m: FloatArray,
    predicted: FloatArray,
    odometry: FloatArray,
    trust: float,
    max_steps: int,
    pose: FloatArray,
    information: FloatArray,
    stats: FloatArray,
) -> None:
    """Gauss-Newton of points (N, 3), base frame, on the surfaces, with the odometry beside them.

    index: (L, SIDE, SIDE) of cells of cells_m (L,), coarse to fine; the others as in `put`.
    variance: of a point across its surface [m2]; share_counted: of what points tell. finest: (S,)
    the finest level that stage looks at; a point takes the finest that has a surface. scales_m:
    (S,) residual, beside the noise, at which a point counts a quarter (Geman and McClure, 1987).
    predicted: (3,), odometry: (3, 3) information
    of the pose there; trust: its normalised innovation squared at which it counts a quarter.
    pose: (3,) start and result. information: (3, 3) of the scan alone. stats: (5,) results.
    """
    pull, both, step = np.empty(3), np.empty((3, 3)), np.empty(3)
    error, steps = np.empty(3), 0
    for stage in range(scales_m.shape[0]):
        scale = scales_m[stage] ** 2
        for _ in range(max_steps):
            c, s = math.cos(pose[2]), math.sin(pose[2])
            information[:], pull[:] = 0.0, 0.0
            seen = fitting = cost = 0.0
            for i in range(points.shape[0]):
                if math.isnan(points[i, 2]):
                    continue
                px, py = points[i, 0], points[i, 1]
                x, y = pose[0] + c * px - s * py, pose[1] + s * px + c * py
                level = finest[stage]
                near, far = _sides(points[i, 2] + pose[2])
                entry = side = -1
                while level >= 0:
                    cell_m = cells_m[level]
                    column, row = math.floor(x / cell_m), math.floor(y / cell_m)
                    entry = _entry(index, cells, level, column, row)
                    if entry >= 0:
                        side = near
                        # of one call each, in a loop: several would not be inlined
                        for _ in range(2):
                            if is_due[entry, side]:
                                _make(
                                    index, cells, sums, level, column, row, side, cell_m,
                                    surfels[entry, side],
                                )  # fmt: skip
                                is_due[entry, side] = False
                            if surfels[entry, side, COUNT] > 0.0 or side == far:
                                break
                            side = far
                        if surfels[entry, side, COUNT] > 0.0:
                            break
                    level -= 1
                if level < 0:
                    continue
                surfel = surfels[entry, side]
                seen += 1.0
                residual = surfel[NORMAL_X] * x + surfel[NORMAL_Y] * y - surfel[OFFSET]
                wide = variance + surfel[VARIANCE]
                limit = scale + _KERNEL * wide
                share = limit / (limit + residual * residual)
                weight = share * share / wide
                fitting += residual * residual < _FITS * (wide + variance)
                cost += 1.0 - share
                nx = c * surfel[NORMAL_X] + s * surfel[NORMAL_Y]
                ny = c * surfel[NORMAL_Y] - s * surfel[NORMAL_X]
                nt = px * ny - py * nx
                information[0, 0] += weight * nx * nx
                information[0, 1] += weight * nx * ny
                information[0, 2] += weight * nx * nt
                information[1, 1] += weight * ny * ny
                information[1, 2] += weight * ny * nt
                information[2, 2] += weight * nt * nt
                pull[0] -= weight * nx * residual
                pull[1] -= weight * ny * residual
                pull[2] -= weight * nt * residual
            information[1, 0], information[2, 0] = information[0, 1], information[0, 2]
            information[2, 1] = information[1, 2]
            east, north = predicted[0] - pose[0], predicted[1] - pose[1]
            error[0], error[1] = c * east + s * north, c * north - s * east
            turn = predicted[2] - pose[2]
            error[2] = turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
            squared = error @ (odometry @ error)
            # wheels slip, and odometry that stood still catches up at once
            trusted = trust / (trust + squared)
            trusted *= trusted
            both[:] = share_counted * information + trusted * odometry
            pull[:] = share_counted * pull + trusted * (odometry @ error)
            step[:] = np.linalg.solve(both, pull)
            pose[0] += c * step[0] - s * step[1]
            pose[1] += s * step[0] + c * step[1]
            pose[2] += step[2]
            steps += 1
            if abs(step[0]) + abs(step[1]) < 1e-3 and abs(step[2]) < 5e-4:
                break
    stats[SEEN], stats[FITTING], stats[COST] = seen, fitting, cost
    stats[STEPS], stats[ODOMETRY_WEIGHT] = steps, trusted


@compiled
def count_on_walls(
    index: NDArray[np.int32],
    cells: NDArray[np.int32],
    sums: NDArray[np.float32],
    level: int,
    cell_m: float,
    points: FloatArray,
    x: FloatArray,
    y: FloatArray,
    headings: FloatArray,
    counts: NDArray[np.int32],
) -> None:
    """Into counts (H, X, Y): how many points (N, 3), base frame, fall into cells that have some.

    x: (X,), y: (Y,) [m], headings: (H,) [rad] of the poses looked at.
    """
    reach_m = 0.0
    for i in range(points.shape[0]):
        reach_m = max(reach_m, math.hypot(points[i, 0], points[i, 1]))
    first_column = math.floor((x[0] - reach_m) / cell_m) - 1
    first_row = math.floor((y[0] - reach_m) / cell_m) - 1
    columns = math.floor((x[-1] + reach_m) / cell_m) + 2 - first_column
    rows = math.floor((y[-1] + reach_m) / cell_m) + 2 - first_row
    # a bit for each side that has points: looked up many times
    held = np.zeros((columns, rows), np.uint8)
    for a in range(columns):
        for b in range(rows):
            entry = _entry(index, cells, level, first_column + a, first_row + b)
            if entry >= 0:
                for side in range(SIDES):
                    if sums[entry, side, 0] > 0.5:
                        held[a, b] |= np.uint8(1 << side)
    turned, asked = np.empty((points.shape[0], 2)), np.empty(points.shape[0], np.uint8)
    for k in range(headings.shape[0]):
        c, s = math.cos(headings[k]), math.sin(headings[k])
        told = 0
        for i in range(points.shape[0]):
            if math.isnan(points[i, 2]):
                continue
            px, py = points[i, 0], points[i, 1]
            turned[told, 0], turned[told, 1] = c * px - s * py, s * px + c * py
            near, far = _sides(points[i, 2] + headings[k])
            asked[told] = np.uint8((1 << near) | (1 << far))
            told += 1
        for u in range(x.shape[0]):
            for v in range(y.shape[0]):
                count = 0
                for i in range(told):
                    column = math.floor((x[u] + turned[i, 0]) / cell_m) - first_column
                    row = math.floor((y[v] + turned[i, 1]) / cell_m) - first_row
                    count += (held[column, row] & asked[i]) != 0
                counts[k, u, v] = count

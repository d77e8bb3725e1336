"""Surfaces learnt from points, in cells of several sizes on a torus.

A point says from which side its surface was seen: the two sides of a wall are two surfaces.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray, IntArray
from slam.kernels import compiled

SIDE = 1024
"""Cells along each side of the torus; what lies farther apart than that shares a cell, by turns."""
_MASK = SIDE - 1
_TILE, _BLOCK = 32, 4
"""Cells along a side of a tile, which fills a page of memory, and of a block of it, which fills a line of the
cache. Row by row, a wall across the rows has a page for each cell: matching took a tenth longer."""
SIDES = 8
"""Directions that surfaces face, an eighth of a turn apart: each point counts for the two nearest,
so that the two sides of a wall, and the two walls of a corner, share none. With four, a door post
that was seen from two sides made one slanting surface: 0.1 m at each door."""
NONE = 0
"""In the place of an entry: no cell is kept there. Memory that nobody wrote to is all zeros, and costs
nothing until somebody does: of the index, most never is."""
_ALL_SIDES = 2**SIDES - 1
_LEAST_POINTS = 4.0
"""Chosen: fewer points make no surface; three lie on a line by chance."""
_LEAST_LENGTH = 0.15
"""Of a cell's side: shorter than that along its longer axis, a cluster has no direction."""

# what `heads` (E, HEAD) hold: the cell of the plane that an entry stands for, by how many points it is used,
# and its STATE: a bit for each of the SIDES whose surfel has to be made anew, from MADE on for each that has one,
# from HELD on for each that points were put into since the cell was taken up, and from LEVEL on its level. All in
# one line of the cache: a point asks for no other before its surfel
COLUMN, ROW, USES, STATE = 0, 1, 2, 3
HEAD = 4
MADE, HELD, LEVEL = SIDES, 2 * SIDES, 3 * SIDES
# what `surfels` (E, SIDES, SURFEL) holds: unit normal, offset along it [m], variance across [m2], middle of its
# points along the surface [m], the sum [m2] of their squared distances from there, and the variance [rad2] that
# the direction has by how they scatter: so many FIELDS; one more fills a line
NORMAL_X, NORMAL_Y, OFFSET, VARIANCE = 0, 1, 2, 3
MIDDLE, LEVER, DIRECTION_VARIANCE = 4, 5, 6
FIELDS, SURFEL = 7, 8


@compiled
def sides_of(facing: float) -> tuple[int, int]:
    """The two of the SIDES that are nearest to a direction [rad], the nearest first."""
    eighths = facing * (SIDES / (2.0 * math.pi))
    low = math.floor(eighths)
    if eighths - low < 0.5:
        return low & (SIDES - 1), (low + 1) & (SIDES - 1)
    return (low + 1) & (SIDES - 1), low & (SIDES - 1)


@compiled
def place_of(column: int, row: int) -> int:
    """Where a cell stands in the index of a level: cells side by side, either way, are near each other."""
    place: int = _column_place(column) + _row_place(row)
    return place


@compiled
def _column_place(column: int) -> int:
    """What the column adds to the place of a cell."""
    u = column & _MASK
    tile, block, cell = u // _TILE, u % _TILE // _BLOCK, u % _BLOCK
    return tile * SIDE * _TILE + block * _TILE * _BLOCK + cell * _BLOCK


@compiled
def _row_place(row: int) -> int:
    """The same of the row."""
    v = row & _MASK
    tile, block, cell = v // _TILE, v % _TILE // _BLOCK, v % _BLOCK
    return tile * _TILE**2 + block * _BLOCK**2 + cell


@compiled
def entry_of(
    index: NDArray[np.int32], heads: NDArray[np.int32], level: int, column: int, row: int
) -> int:
    """Where a cell of a level is kept, NONE where no point is in it or beside it."""
    entry = index[level, place_of(column, row)]
    if entry != NONE and heads[entry, COLUMN] == column and heads[entry, ROW] == row:
        return int(entry)
    return NONE


@compiled
def put(
    index: NDArray[np.int32],
    heads: NDArray[np.int32],
    free: NDArray[np.int32],
    sums: NDArray[np.float32],
    points: FloatArray,
    done: IntArray,
    sign: int,
    cells_m: FloatArray,
) -> bool:
    """Adds points (N, 3) [m, m, rad], map frame, to the cells of each level that they lie in; sign -1 takes
    them out. Whether all are done; False where entries ran out: call it again once there are more.

    index: (L, SIDE * SIDE) entries of cells with a point in them or beside them, NONE of others, see `place_of`.
    heads: (E, HEAD) of entries; free: (E + 1,) those that nothing uses, their count at the end. sums: (E, SIDES, 6)
    count, x, y, xx, xy, yy from the cell's middle. done: (L,) how many points are in the cells of each level, in
    place. cells_m: (L,).
    """
    sides = np.empty((points.shape[0], 2), np.int64)
    for i in range(points.shape[0]):
        sides[i, 0] = sides[i, 1] = -1
        if not math.isnan(points[i, 2]):
            sides[i, 0], sides[i, 1] = sides_of(points[i, 2])
    for level in range(cells_m.shape[0]):
        done[level] = _put_level(
            index[level], heads, free, sums, points, sides, done[level], sign, level,
            cells_m[level],
        )  # fmt: skip
        if done[level] < points.shape[0]:
            return False
    return True


@compiled
def _put_level(
    index: NDArray[np.int32],
    heads: NDArray[np.int32],
    free: NDArray[np.int32],
    sums: NDArray[np.float32],
    points: FloatArray,
    sides: IntArray,
    first: int,
    sign: int,
    level: int,
    cell_m: float,
) -> int:
    """As `put`, of one level and from the first point on: the number of the point at which entries ran out, N
    when all are done. sides: (N, 2) of each point, the nearest first; -1 where it has none, and counts for nothing."""
    i = first
    while i < points.shape[0] and sides[i, 0] < 0:
        i += 1
    next_column = next_row = 0
    if i < points.shape[0]:
        next_column = math.floor(points[i, 0] / cell_m)
        next_row = math.floor(points[i, 1] / cell_m)
    while i < points.shape[0]:
        if sign > 0 and free[-1] < 9:
            return i
        column, row = next_column, next_row
        # neighbours in a scan share a cell, most of the time: what is done for cells is done once
        count, asked, end = 0, 0, i
        while end < points.shape[0]:
            if sides[end, 0] >= 0:
                if end > i:
                    next_column = math.floor(points[end, 0] / cell_m)
                    next_row = math.floor(points[end, 1] / cell_m)
                    if next_column != column or next_row != row:
                        break
                asked |= 1 << sides[end, 0] | 1 << sides[end, 1]
                count += 1
            end += 1
        middle = NONE
        for u in range(-1, 2):
            beside = column + u
            along = _column_place(beside)
            for v in range(-1, 2):
                above = row + v
                place = along + _row_place(above)
                entry = index[place]
                if entry == NONE or heads[entry, COLUMN] != beside or heads[entry, ROW] != above:
                    if sign < 0:
                        continue  # another cell of the plane has taken the place since
                    if entry == NONE:
                        free[-1] -= 1
                        entry = free[free[-1]]
                        index[place] = entry
                    heads[entry, COLUMN], heads[entry, ROW] = beside, above
                    heads[entry, USES], heads[entry, STATE] = 0, level << LEVEL | _ALL_SIDES
                heads[entry, USES] += sign * count
                heads[entry, STATE] |= asked
                if heads[entry, USES] <= 0:
                    index[place] = NONE
                    free[free[-1]] = entry
                    free[-1] += 1
                elif u == 0 and v == 0:
                    middle = entry
        if middle != NONE:
            middle_x, middle_y = (column + 0.5) * cell_m, (row + 0.5) * cell_m
            new = asked & ~(heads[middle, STATE] >> HELD)
            if new:  # what was left there is of another cell
                for side in range(SIDES):
                    if new >> side & 1:
                        for j in range(6):
                            sums[middle, side, j] = 0.0
                heads[middle, STATE] |= new << HELD
            for k in range(i, end):
                if sides[k, 0] < 0:
                    continue
                x, y = points[k, 0] - middle_x, points[k, 1] - middle_y
                for j in range(2):
                    side = sides[k, j]
                    sums[middle, side, 0] += sign
                    sums[middle, side, 1] += sign * x
                    sums[middle, side, 2] += sign * y
                    sums[middle, side, 3] += sign * x * x
                    sums[middle, side, 4] += sign * x * y
                    sums[middle, side, 5] += sign * y * y
        i = end
    return i


@compiled
def clear(index: NDArray[np.int32], heads: NDArray[np.int32], free: NDArray[np.int32]) -> None:
    """Takes out all points of all levels: index (L, SIDE * SIDE)."""
    count = heads.shape[0]
    for entry in range(1, count):
        if heads[entry, USES] > 0:
            place = place_of(heads[entry, COLUMN], heads[entry, ROW])
            index[heads[entry, STATE] >> LEVEL, place] = NONE
            heads[entry, USES] = 0
        free[count - 1 - entry] = entry
    free[count] = count - 1


@compiled
def make_surfel(
    index: NDArray[np.int32],
    heads: NDArray[np.int32],
    sums: NDArray[np.float32],
    level: int,
    column: int,
    row: int,
    side: int,
    cell_m: float,
    surfel: FloatArray,
) -> bool:
    """Whether a cell's and its neighbours' points of a side make a line: that, then."""
    n = sx = sy = sxx = sxy = syy = 0.0
    for u in range(-1, 2):
        along = _column_place(column + u)
        for v in range(-1, 2):
            entry = index[level, along + _row_place(row + v)]
            if (
                heads[entry, STATE] >> HELD + side & 1 == 0
                or heads[entry, COLUMN] != column + u
                or heads[entry, ROW] != row + v
            ):
                continue
            m, x, y = sums[entry, side, 0], u * cell_m, v * cell_m
            if m < 0.5:  # all of them were taken out
                continue
            held_x, held_y = sums[entry, side, 1], sums[entry, side, 2]
            n += m
            sx += held_x + m * x
            sy += held_y + m * y
            sxx += sums[entry, side, 3] + 2.0 * x * held_x + m * x * x
            sxy += sums[entry, side, 4] + x * held_y + y * held_x + m * x * y
            syy += sums[entry, side, 5] + 2.0 * y * held_y + m * y * y
    if n < _LEAST_POINTS:
        return False
    mean_x, mean_y = sx / n, sy / n
    cxx, cxy, cyy = sxx / n - mean_x**2, sxy / n - mean_x * mean_y, syy / n - mean_y**2
    half = 0.5 * (cxx + cyy)
    apart = math.sqrt(0.25 * (cxx - cyy) ** 2 + cxy * cxy)
    if half + apart < (_LEAST_LENGTH * cell_m) ** 2:
        return False
    surfel[NORMAL_X], surfel[NORMAL_Y] = line_normal(0.5 * (cxx - cyy), cxy, apart)
    x, y = mean_x + (column + 0.5) * cell_m, mean_y + (row + 0.5) * cell_m
    surfel[OFFSET] = surfel[NORMAL_X] * x + surfel[NORMAL_Y] * y
    surfel[VARIANCE] = max(half - apart, 0.0)
    surfel[MIDDLE] = surfel[NORMAL_Y] * x - surfel[NORMAL_X] * y
    surfel[LEVER] = n * (half + apart)
    surfel[DIRECTION_VARIANCE] = n / (n - 2.0) * surfel[VARIANCE] / surfel[LEVER]
    return True


@compiled
def line_normal(over: float, cxy: float, apart: float) -> tuple[float, float]:
    """The unit normal of a line whose angle, doubled, has cosine over / apart and sine cxy / apart; of no
    angle at all, that of one along x. By roots alone: sines take a third of the time of a surfel."""
    if apart == 0.0:
        return 0.0, 1.0
    larger = math.sqrt(0.5 * (1.0 + abs(over) / apart))
    smaller = 0.5 * cxy / (apart * larger)
    if over >= 0.0:
        return -smaller, larger
    return (-larger, smaller) if cxy >= 0.0 else (larger, -smaller)

"""The point nearest to each cell of a grid, for cells near points alone, and in parts.

A building has millions of cells, most of them far from any wall: all at once their distances would
take gigabytes, and to be told that nothing is within reach most of the time.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree

from slam.arrays import BoolArray, FloatArray, IntArray

_CELLS_AT_ONCE = 1 << 20
_SQUARES = 4
"""Chosen: as many squares, one after the other, are as long as the reach; more leave out little more."""
_ABOVE_ROUNDING = 1.001


def row_blocks(rows: int, columns: int) -> Iterator[slice]:
    """The rows of a grid in parts of about a million cells."""
    at_once = max(1, _CELLS_AT_ONCE // max(columns, 1))
    for first in range(0, rows, at_once):
        yield slice(first, min(first + at_once, rows))


def nearest_points(
    points: FloatArray, x: FloatArray, y: FloatArray, reach_m: float
) -> Iterator[tuple[IntArray, FloatArray, IntArray]]:
    """Of the cells whose middles have a point within reach, in parts: (C,) the cells, (C,) distances
    to the nearest point [m], (C,) which point it is.

    points: (K, 2), at least one. x, y: middles of the columns and rows [m], increasing; cell
    row * len(x) + column.
    """
    tree = cKDTree(points)
    side_m = _ABOVE_ROUNDING * reach_m / _SQUARES
    columns, rows = _squares(x, x, side_m), _squares(y, y, side_m)
    may_be_near = _near_squares(points, x, y, side_m)
    for part in row_blocks(len(y), len(x)):
        is_maybe = may_be_near[rows[part], :][:, columns].ravel()
        cells = np.flatnonzero(is_maybe) + part.start * len(x)
        if not len(cells):
            continue
        middles = np.column_stack([x[cells % len(x)], y[cells // len(x)]])
        distances_m, nearest = map(np.asarray, tree.query(middles, distance_upper_bound=reach_m))
        is_near = np.isfinite(distances_m)
        yield cells[is_near], distances_m[is_near], nearest[is_near]


def _near_squares(points: FloatArray, x: FloatArray, y: FloatArray, side_m: float) -> BoolArray:
    """(rows, columns) whether a square over the grid may have a point within reach of its cells."""
    # a point may lie beyond the grid, and reach into it from there
    shape = _squares(y, y[-1:], side_m)[0] + 1, _squares(x, x[-1:], side_m)[0] + 1
    margin = _SQUARES + 1
    has_point = np.zeros((shape[0] + 2 * margin, shape[1] + 2 * margin), dtype=np.uint8)
    row = np.clip(_squares(y, points[:, 1], side_m) + margin, 0, has_point.shape[0] - 1)
    column = np.clip(_squares(x, points[:, 0], side_m) + margin, 0, has_point.shape[1] - 1)
    has_point[row, column] = 1
    near = maximum_filter(has_point, size=2 * _SQUARES + 1, mode="constant")
    return np.asarray(near[margin:-margin, margin:-margin] > 0)


def _squares(middles_m: FloatArray, at_m: FloatArray, side_m: float) -> IntArray:
    """(K,) in which square along an axis each place lies; the first cell is in square 0."""
    result: IntArray = np.floor((at_m - middles_m[0]) / side_m).astype(np.int64)
    return result

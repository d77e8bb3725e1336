"""Which cells of a grid the beams of many scans pass, and in which they end."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.kernels import compiled

CountArray = NDArray[np.int32]


@compiled
def count_passes(
    starts: FloatArray,
    ends: FloatArray,
    row: int,
    is_hit: bool,
    scan: int,
    misses: CountArray,
    last_scans: CountArray,
) -> None:
    """A miss for each cell that one beam passes, but for those that its scan has counted already.

    starts, ends: (B, 2) x and y in cells from the grid's corner; the beam is that of `row`. Where
    it has no hit, the cell of its end is one more that it passes. misses, last_scans: (rows,
    columns), changed.
    """
    x, y = starts[row, 0], starts[row, 1]
    dx, dy = ends[row, 0] - x, ends[row, 1] - y
    i, j = math.floor(x), math.floor(y)
    left_i = math.floor(ends[row, 0]) - i
    left_j = math.floor(ends[row, 1]) - j
    step_i, step_j = (1 if left_i > 0 else -1), (1 if left_j > 0 else -1)
    left_i, left_j = abs(left_i), abs(left_j)
    # share of the beam at which it next crosses a border, and between two such crossings
    every_x = 1.0 / abs(dx) if left_i > 0 else np.inf
    every_y = 1.0 / abs(dy) if left_j > 0 else np.inf
    next_x = (i + 1 - x if step_i > 0 else x - i) * every_x if left_i > 0 else np.inf
    next_y = (j + 1 - y if step_j > 0 else y - j) * every_y if left_j > 0 else np.inf
    # steps are counted, not compared with the end: no rounding can lead past it
    for _ in range(left_i + left_j):
        if last_scans[j, i] != scan:
            last_scans[j, i] = scan
            misses[j, i] += 1
        if left_j == 0 or (left_i > 0 and next_x < next_y):
            i += step_i
            left_i -= 1
            next_x += every_x
        else:
            j += step_j
            left_j -= 1
            next_y += every_y
    if not is_hit and last_scans[j, i] != scan:
        last_scans[j, i] = scan
        misses[j, i] += 1


@compiled
def count_cells(
    starts: FloatArray,
    ends: FloatArray,
    is_hit: BoolArray,
    firsts: IntArray,
    hits: CountArray,
    misses: CountArray,
) -> None:
    """In how many scans a beam ended in each cell, and in how many beams did no more than pass it.

    starts, ends: (B, 2) x and y in cells from the grid's corner, all within the grid. is_hit: (B,)
    whether something was at the end. firsts: (S + 1,) first beam of each scan, and their number.
    hits, misses: (rows, columns), raised: a scan adds one at most to each cell, the hit first.
    """
    last_scans = np.full(hits.shape, -1, np.int32)
    for scan in range(firsts.shape[0] - 1):
        for row in range(firsts[scan], firsts[scan + 1]):
            if is_hit[row]:
                i, j = math.floor(ends[row, 0]), math.floor(ends[row, 1])
                if last_scans[j, i] != scan:
                    last_scans[j, i] = scan
                    hits[j, i] += 1
        for row in range(firsts[scan], firsts[scan + 1]):
            count_passes(starts, ends, row, is_hit[row], scan, misses, last_scans)

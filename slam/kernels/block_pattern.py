"""Which blocks of 3 x 3 a pose graph's normal equations have, and where each lies in their CSC matrix.

Unknowns are the nodes that are not fixed, numbered as they are eliminated; -1 in an edge's ends (E, 2) is a
fixed node, and whatever has one of these for a row or a column is not there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam.arrays import BoolArray, IntArray
from slam.kernels import compiled


@compiled
def held_into(is_fixed: BoolArray, ends: IntArray, is_held: BoolArray) -> None:
    """Into is_held (N,): the nodes that a chain of edges (E, 2) joins to a fixed one."""
    count = is_fixed.shape[0]
    above = np.arange(count)  # towards the first node of each part
    for e in range(ends.shape[0]):
        a, b = _first_of(above, ends[e, 0]), _first_of(above, ends[e, 1])
        above[max(a, b)] = min(a, b)
    for node in range(count):
        is_held[node] = False
    for node in range(count):
        if is_fixed[node]:
            is_held[_first_of(above, node)] = True
    for node in range(count):
        is_held[node] = is_held[_first_of(above, node)]


@compiled
def _first_of(above: IntArray, node: int) -> int:
    """The first node of the part that a node is in; paths are halved on the way."""
    while above[node] != node:
        above[node] = above[above[node]]
        node = above[node]
    return node


@compiled
def pattern_of(ends: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Blocks between so many unknowns by columns: indptr, indices; both triangles, rows increasing."""
    starts = np.zeros(count + 1, np.int64)
    for e in range(ends.shape[0]):
        if ends[e, 0] >= 0 and ends[e, 1] >= 0:
            starts[ends[e, 0] + 1] += 1
            starts[ends[e, 1] + 1] += 1
    for column in range(count):
        starts[column + 1] += starts[column] + 1  # and the one on the diagonal
    rows, filled = np.empty(starts[count], np.int64), starts[:-1].copy()
    for column in range(count):
        rows[filled[column]] = column
        filled[column] += 1
    for e in range(ends.shape[0]):
        a, b = ends[e, 0], ends[e, 1]
        if a >= 0 and b >= 0:
            rows[filled[a]], rows[filled[b]] = b, a
            filled[a] += 1
            filled[b] += 1
    indptr, indices, kept = np.zeros(count + 1, np.int64), np.empty(starts[count], np.int64), 0
    for column in range(count):
        of_column = np.sort(rows[starts[column] : starts[column + 1]])
        for k in range(of_column.shape[0]):
            if k == 0 or of_column[k] != of_column[k - 1]:
                indices[kept] = of_column[k]
                kept += 1
        indptr[column + 1] = kept
    return indptr, indices[:kept].copy()


@compiled
def lay_out(
    ends: IntArray,
    indptr: IntArray,
    indices: IntArray,
    slots: IntArray,
    diagonal: IntArray,
    csc_indptr: NDArray[np.int32],
    csc_indices: NDArray[np.int32],
) -> None:
    """Where entries lie, of a pattern as of `pattern_of`: 9 for each of its B blocks, column by column.

    Into slots (E, 4): as in `normal_equations`; of a block that is not there, 0. Into diagonal (3 U,): the entries
    there. Into csc_indptr (3 U + 1,) and csc_indices (9 B,): of the matrix.
    """
    csc_indptr[0] = 0
    for column in range(indptr.shape[0] - 1):
        first, end = indptr[column], indptr[column + 1]
        height = 3 * (end - first)
        for k in range(3):
            start = 9 * first + k * height
            csc_indptr[3 * column + k + 1] = start + height
            for at in range(first, end):
                entry = start + 3 * (at - first)
                for row in range(3):
                    csc_indices[entry + row] = 3 * indices[at] + row
                if indices[at] == column:
                    diagonal[3 * column + k] = entry + k
    for e in range(ends.shape[0]):
        a, b = ends[e, 0], ends[e, 1]
        slots[e, 0] = _block(indptr, indices, a, a)
        slots[e, 1] = _block(indptr, indices, b, b)
        slots[e, 2] = _block(indptr, indices, a, b)
        slots[e, 3] = _block(indptr, indices, b, a)


@compiled
def _block(indptr: IntArray, indices: IntArray, row: int, column: int) -> int:
    """Where a block begins, 0 if it is not there."""
    if row < 0 or column < 0:
        return 0
    first, low, high = indptr[column], indptr[column], indptr[column + 1]
    while low < high:
        middle = (low + high) // 2
        if indices[middle] < row:
            low = middle + 1
        else:
            high = middle
    return int(9 * first + 3 * (low - first))

"""Branch and bound over poses: the best-matching leaf of each block of poses, exactly.

A leaf is a cell of positions and a heading; its score, the sum over the scan's points of what the
likelihood grid says where each falls. Level l of the grid holds the maximum over 2**l by 2**l cells,
so that a node of as many positions is never better than its own sum (Olson, ICRA 2015; Hess et al.,
"Real-time loop closure in 2D LIDAR SLAM", ICRA 2016).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam.arrays import BoolArray, IntArray
from slam.kernels import compiled, copy_into

_CHUNK = 8
_EVERY_HEADING = 4
"""The first look takes every fourth heading: what it finds lets the others be given up early."""


@compiled
def score_of(
    level: NDArray[np.uint8], offsets: NDArray[np.int32], at: int, least: int, most: int
) -> int:
    """Sum of a flat level at the points' offsets from a cell, or less than `least` if it is.

    most: what all points together can give.
    """
    count, total = offsets.shape[0], 0
    whole = count // _CHUNK
    room = most - least  # what may still be missed
    for chunk in range(whole):
        part = 0
        for j in range(_CHUNK):  # unsigned: a signed index is asked whether it counts from the end
            part += level[np.uintp(at + offsets[chunk * _CHUNK + j])]
        total += part
        room -= 255 * _CHUNK
        if total + room < 0:
            return -1
    for i in range(whole * _CHUNK, count):
        total += level[np.uintp(at + offsets[i])]
    return total


@compiled
def max_pooled(level: NDArray[np.uint8], reach: int) -> NDArray[np.uint8]:
    """(R, C) maximum of each cell and those `reach` up, to the right and both; 0 beyond the rim."""
    rows, columns = level.shape
    pooled = level.copy()
    for r in range(rows):
        for c in range(columns):
            most = level[r, c]
            if c + reach < columns:
                most = max(most, level[r, c + reach])
            if r + reach < rows:
                most = max(most, level[r + reach, c])
                if c + reach < columns:
                    most = max(most, level[r + reach, c + reach])
            pooled[r, c] = most
    return pooled


@compiled
def _keep_best(kept: IntArray, ids: IntArray, block: int, value: int) -> int:
    """Notes a block's value among the best of blocks; the least of those kept, 0 while some is free."""
    least, at = 0, -1
    for k in range(kept.shape[0]):
        if ids[k] == block:
            at = k
            break
    if at < 0:
        at = 0
        for k in range(kept.shape[0]):
            if kept[k] < kept[at]:
                at = k
        if value <= kept[at]:
            return int(kept[at])
    kept[at], ids[at] = value, block
    least = kept[0]
    for k in range(kept.shape[0]):
        least = min(least, kept[k])
    return int(least)


@compiled
def best_of_blocks(
    levels: NDArray[np.uint8],
    is_open: BoolArray,
    columns: int,
    pad: int,
    offsets: NDArray[np.int32],
    group: int,
    keep: float,
    max_blocks: int,
    best: IntArray,
    leaves: IntArray,
) -> int:
    """For each block of positions and headings its best leaf, where it may be among the best blocks.

    levels: (L, cells) flat, max-pooled grid with `columns`, padded by `pad` cells on each side.
    is_open: (L, R, C) whether any of the positions below a node may be searched, unpadded.
    offsets: (H, N) of each point from the position's cell, by heading. A block is one node of the
    top level and `group` headings. best, leaves: (rows, columns, groups) of blocks, results: score
    and (row * C + column) * H + heading; right for every block that is among the max_blocks best
    and reaches `keep` times the best of all. Returns how many nodes were looked at.
    """
    top = levels.shape[0] - 1
    rows_open, columns_open = is_open.shape[1], is_open.shape[2]
    side = 1 << top
    headings, count = offsets.shape
    most = 255 * count
    block_rows, block_columns = best.shape[0], best.shape[1]
    blocks = block_rows * block_columns
    groups = best.shape[2]
    best[:], leaves[:] = 0, -1
    kept, ids = np.zeros(max_blocks, np.int64), np.full(max_blocks, -1)
    stack = np.empty((4 * top + 8, 4), np.int64)
    bounds = np.empty(headings * blocks, np.int32)
    order = np.empty(headings * blocks, np.int64)
    starts = np.empty(most + 2, np.int64)
    best_of_all, least, looked = 1, 1, 0
    for first_look in range(2):
        # the bound of every top node at these headings
        starts[:] = 0
        for h in range(headings):
            if (h % _EVERY_HEADING == 0) != (first_look == 0):
                continue
            for b in range(blocks):
                r, c = (b // block_columns) * side, (b % block_columns) * side
                bound = -1
                if is_open[top, r, c]:
                    at = (r + pad) * columns + c + pad
                    bound = score_of(levels[top], offsets[h], at, least, most)
                    looked += 1
                bounds[h * blocks + b] = bound
                if bound >= least:
                    starts[most - bound + 1] += 1
        # sorted by bound, largest first: few distinct values, so they are counted
        for k in range(1, most + 2):
            starts[k] += starts[k - 1]
        total = starts[most + 1]
        for h in range(headings):
            if (h % _EVERY_HEADING == 0) != (first_look == 0):
                continue
            for b in range(blocks):
                node = h * blocks + b
                if bounds[node] >= least:
                    order[starts[most - bounds[node]]] = node
                    starts[most - bounds[node]] += 1
        for k in range(total):
            node = order[k]
            if bounds[node] < least:
                break
            h, b = node // blocks, node % blocks
            br, bc, g = b // block_columns, b % block_columns, h // group
            stack[0, 0], stack[0, 1], stack[0, 2] = br * side, bc * side, top
            stack[0, 3] = bounds[node]
            depth = 1
            while depth > 0:
                depth -= 1
                r, c, level, bound = (
                    stack[depth, 0], stack[depth, 1], stack[depth, 2], stack[depth, 3],
                )  # fmt: skip
                if bound < least or bound < best[br, bc, g]:
                    continue
                if level == 0:
                    leaf = (r * columns_open + c) * headings + h
                    if bound > best[br, bc, g]:
                        best[br, bc, g], leaves[br, bc, g] = bound, leaf
                        best_of_all = max(best_of_all, bound)
                        block = (br * block_columns + bc) * groups + g
                        worst_kept = _keep_best(kept, ids, block, bound)
                        least = max(least, worst_kept, int(np.ceil(keep * best_of_all)))
                    elif leaf < leaves[br, bc, g]:
                        leaves[br, bc, g] = leaf
                    continue
                half = 1 << (level - 1)
                floor = max(least, best[br, bc, g])
                first = depth
                for child in range(4):
                    cr, cc = r + half * (child // 2), c + half * (child % 2)
                    if cr >= rows_open or cc >= columns_open or not is_open[level - 1, cr, cc]:
                        continue
                    at = (cr + pad) * columns + cc + pad
                    value = score_of(levels[level - 1], offsets[h], at, floor, most)
                    looked += 1
                    if value < floor:
                        continue
                    # the best on top of the stack
                    slot = depth
                    while slot > first and stack[slot - 1, 3] > value:
                        copy_into(stack[slot - 1], stack[slot])
                        slot -= 1
                    stack[slot, 0], stack[slot, 1] = cr, cc
                    stack[slot, 2], stack[slot, 3] = level - 1, value
                    depth += 1
    return looked

"""Inner loops of the baselines, compiled: marking beams in a grid, distances, ways.

Grids are indexed [i, j] along x and y; cell (i, j) spans origin + cell_m * [i, i + 1] x [j, j + 1].
A window (i0, j0, i1, j1) is a part of a grid, its upper ends not within it.
"""

import numpy as np
from numpy.typing import NDArray

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.kernels import compiled

_HIT, _MISS, _MOST, _LEAST = 4, 1, 12, -4
"""Chosen: a cell that was hit once stays occupied for three beams through it, one hit often for
eleven: people's legs are forgotten within a second, and one stray beam opens no wall."""
_KEEP = 0.7
"""Of a cell's mean hit, when another comes: noise of 10 mm becomes 4 mm."""
_SHORT_CELLS = 1.5
"""Beams clear no cell nearer than this to their end: they graze the walls that they hit."""


@compiled
def mark_beams(
    evidence: NDArray[np.int8],
    hits_m: NDArray[np.float32],
    is_seen: BoolArray,
    origin_m: FloatArray,
    cell_m: float,
    starts_m: FloatArray,
    ends_m: FloatArray,
    kinds: IntArray,
) -> None:
    """Marks beams from starts (N, 2) to ends (N, 2) [m].

    evidence: above 0 is occupied. hits_m: (..., 2) mean hit of each occupied cell. kinds: (N,) 0 is
    left out, 1 ends on something, 2 met nothing: it has seen its way, and clears nothing.
    """
    columns, rows = evidence.shape
    for n in range(len(kinds)):
        if kinds[n] == 0:
            continue
        x, y = starts_m[n, 0] - origin_m[0], starts_m[n, 1] - origin_m[1]
        dx, dy = ends_m[n, 0] - starts_m[n, 0], ends_m[n, 1] - starts_m[n, 1]
        length = np.hypot(dx, dy) / cell_m
        steps = int(2.0 * length)
        last_i, last_j = -1, -1
        for k in range(steps):
            share = k / (2.0 * length)
            i, j = int((x + share * dx) // cell_m), int((y + share * dy) // cell_m)
            if i < 0 or j < 0 or i >= columns or j >= rows:
                break
            if i == last_i and j == last_j:
                continue
            last_i, last_j = i, j
            is_seen[i, j] = True
            if kinds[n] == 1 and 0.5 * k < length - _SHORT_CELLS:
                evidence[i, j] = max(evidence[i, j] - _MISS, _LEAST)
        if kinds[n] != 1:
            continue
        i, j = int((x + dx) // cell_m), int((y + dy) // cell_m)
        if 0 <= i < columns and 0 <= j < rows:
            keep = _KEEP if evidence[i, j] > 0 else 0.0
            evidence[i, j] = min(max(evidence[i, j], 0) + _HIT, _MOST)
            hits_m[i, j, 0] = keep * hits_m[i, j, 0] + (1.0 - keep) * ends_m[n, 0]
            hits_m[i, j, 1] = keep * hits_m[i, j, 1] + (1.0 - keep) * ends_m[n, 1]


@compiled
def clearances(
    evidence: NDArray[np.int8],
    hits_m: NDArray[np.float32],
    origin_m: FloatArray,
    cell_m: float,
    window: tuple[int, int, int, int],
    most_m: float,
) -> FloatArray:
    """Distance from the middle of each cell of a window to the nearest hit, at most most_m [m]."""
    i0, j0, i1, j1 = window
    squares = np.full((i1 - i0, j1 - j0), most_m * most_m)
    reach = int(np.ceil(most_m / cell_m))
    for i in range(max(i0 - reach, 0), min(i1 + reach, evidence.shape[0])):
        for j in range(max(j0 - reach, 0), min(j1 + reach, evidence.shape[1])):
            if evidence[i, j] <= 0:
                continue
            x, y = hits_m[i, j, 0] - origin_m[0], hits_m[i, j, 1] - origin_m[1]
            for a in range(max(i - reach, i0), min(i + reach + 1, i1)):
                dx = (a + 0.5) * cell_m - x
                for b in range(max(j - reach, j0), min(j + reach + 1, j1)):
                    dy = (b + 0.5) * cell_m - y
                    square = dx * dx + dy * dy
                    if square < squares[a - i0, b - j0]:
                        squares[a - i0, b - j0] = square
    result: FloatArray = np.sqrt(squares)
    return result


@compiled
def costs_to(
    price: FloatArray,
    seeds: IntArray,
) -> FloatArray:
    """Least cost from each cell to the nearest seed (K, 2), over 8 neighbours (Dijkstra, 1959).

    price: of each cell, per cell of way; inf cannot be entered. inf where no seed can be reached.
    """
    columns, rows = price.shape
    costs = np.full((columns, rows), np.inf)
    # heapq on a list of tuples would take 1.3 to 1.5 times as long
    heap_cost = np.empty(8 * columns * rows + len(seeds) + 1)
    heap_cell = np.empty(len(heap_cost), dtype=np.int64)
    size = 0
    for n in range(len(seeds)):
        costs[seeds[n, 0], seeds[n, 1]] = 0.0
        size = _push(heap_cost, heap_cell, size, 0.0, seeds[n, 0] * rows + seeds[n, 1])
    while size > 0:
        cost, cell = heap_cost[0], heap_cell[0]
        size = _pop(heap_cost, heap_cell, size)
        i, j = cell // rows, cell % rows
        if cost > costs[i, j]:
            continue
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if a < 0 or b < 0 or a >= columns or b >= rows:
                    continue
                way = 1.0 if di == 0 or dj == 0 else 1.4142135623730951
                further = cost + way * 0.5 * (price[i, j] + price[a, b])
                if further < costs[a, b]:
                    costs[a, b] = further
                    size = _push(heap_cost, heap_cell, size, further, a * rows + b)
    return costs


@compiled
def _push(
    heap_cost: FloatArray,
    heap_cell: IntArray,
    size: int,
    cost: float,
    cell: int,
) -> int:
    k = size
    while k > 0:
        parent = (k - 1) // 2
        if heap_cost[parent] <= cost:
            break
        heap_cost[k], heap_cell[k] = heap_cost[parent], heap_cell[parent]
        k = parent
    heap_cost[k], heap_cell[k] = cost, cell
    return size + 1


@compiled
def _pop(
    heap_cost: FloatArray,
    heap_cell: IntArray,
    size: int,
) -> int:
    size -= 1
    cost, cell = heap_cost[size], heap_cell[size]
    k = 0
    while True:
        child = 2 * k + 1
        if child >= size:
            break
        if child + 1 < size and heap_cost[child + 1] < heap_cost[child]:
            child += 1
        if heap_cost[child] >= cost:
            break
        heap_cost[k], heap_cell[k] = heap_cost[child], heap_cell[child]
        k = child
    heap_cost[k], heap_cell[k] = cost, cell
    return size


@compiled
def way_down(
    costs: FloatArray,
    cell: IntArray,
    most_steps: int,
) -> IntArray:
    """(W, 2) cells from a cell (2,) down to a seed of `costs_to`, or as many steps on the way."""
    way = np.empty((most_steps + 1, 2), dtype=np.int64)
    i, j = cell[0], cell[1]
    way[0, 0], way[0, 1] = i, j
    count = 1
    while count <= most_steps:
        best_i, best_j, best = i, j, costs[i, j]
        for a in range(max(i - 1, 0), min(i + 2, costs.shape[0])):
            for b in range(max(j - 1, 0), min(j + 2, costs.shape[1])):
                if costs[a, b] < best:
                    best_i, best_j, best = a, b, costs[a, b]
        if best_i == i and best_j == j:
            break
        i, j = best_i, best_j
        way[count, 0], way[count, 1] = i, j
        count += 1
    return way[:count]


@compiled
def hits_near(
    evidence: NDArray[np.int8],
    hits_m: NDArray[np.float32],
    origin_m: FloatArray,
    cell_m: float,
    pose: FloatArray,
    reach_m: float,
) -> FloatArray:
    """(K, 2) hits within a square around a pose (3,), in its frame [m]."""
    columns, rows = evidence.shape
    reach = int(np.ceil(reach_m / cell_m))
    i0, j0 = int((pose[0] - origin_m[0]) // cell_m), int((pose[1] - origin_m[1]) // cell_m)
    points_m = np.empty(((2 * reach + 1) ** 2, 2))
    count = 0
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for i in range(max(i0 - reach, 0), min(i0 + reach + 1, columns)):
        for j in range(max(j0 - reach, 0), min(j0 + reach + 1, rows)):
            if evidence[i, j] > 0:
                dx, dy = hits_m[i, j, 0] - pose[0], hits_m[i, j, 1] - pose[1]
                points_m[count, 0], points_m[count, 1] = c * dx + s * dy, c * dy - s * dx
                count += 1
    return points_m[:count]

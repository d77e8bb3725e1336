"""Wall segments joined and thinned: the same surfaces in as few straight pieces as they need."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray, IntArray

_SAME_LINE_M = 1e-6
"""Chosen: far above the rounding of coordinates in metres, far below any laser."""
_SAME_DIRECTION_RAD = 1e-5


def joined(segments: FloatArray) -> FloatArray:
    """(J, 2, 2) the segments (S, 2, 2) [m] with those on one line that touch or overlap made one.

    Only what runs in the same direction is joined: the open side stays on its side.
    Segments of less than a micrometre are dropped.
    """
    lengths_m = np.hypot(*(segments[:, 1] - segments[:, 0]).T)
    is_long = lengths_m > 2.0 * _SAME_LINE_M
    segments, lengths_m = segments[is_long], lengths_m[is_long]
    if len(segments) == 0:
        return segments.reshape(-1, 2, 2)
    # the longest has the best direction: it speaks for all on its line
    order = np.argsort(-lengths_m, kind="stable")
    segments = segments[order]
    directions = _directions(segments)
    pieces: list[tuple[int, list[FloatArray]]] = []
    for group in _maybe_on_a_line(segments, directions):
        left = group
        while len(left):
            start, along = segments[left[0], 0], directions[left[0]]
            normal = np.array([-along[1], along[0]])
            across_m = np.abs((segments[left] - start) @ normal).max(axis=1)
            is_parallel = np.abs(directions[left] @ normal) < _SAME_DIRECTION_RAD
            on_line = (across_m < _SAME_LINE_M) & is_parallel & (directions[left] @ along > 0.0)
            on_line[0] = True
            spans_m = np.sort((segments[left[on_line]] - start) @ along, axis=1)
            found = [start + np.outer(span, along) for span in _united(spans_m)]
            pieces.append((int(left[0]), found))
            left = left[~on_line]
    pieces.sort(key=lambda piece: piece[0])
    return np.array([one for _, found in pieces for one in found])


def _maybe_on_a_line(segments: FloatArray, directions: FloatArray) -> Iterator[IntArray]:
    """Segments (S, 2, 2) in groups, each in their order: what is not in one group is on no line.

    Each with each takes a building minutes.
    """
    middles = segments.mean(axis=1)
    middles = middles - middles.mean(axis=0)
    across_all_m = float(np.hypot(*np.ptp(middles, axis=0)))
    angles_rad = np.arctan2(directions[:, 1], directions[:, 0])
    # what points backwards is at either end
    angles_rad[angles_rad > np.pi - _SAME_DIRECTION_RAD] -= 2.0 * np.pi
    for alike in _runs(angles_rad, 4.0 * _SAME_DIRECTION_RAD):
        turned_rad = float(np.ptp(angles_rad[alike]))
        normal = np.array([-directions[alike[0], 1], directions[alike[0], 0]])
        reach_m = 4.0 * _SAME_LINE_M + turned_rad * across_all_m
        for group in _runs(middles[alike] @ normal, reach_m):
            yield np.sort(alike[group])


def _runs(values: FloatArray, gap: float) -> list[IntArray]:
    """Which values lie together, runs of them with no gap between neighbours wider than that."""
    order = np.argsort(values)
    return np.split(order, np.flatnonzero(np.diff(values[order]) > gap) + 1)


def simplified(segments: FloatArray, tolerance_m: float) -> FloatArray:
    """(T, 2, 2) chains of segments (S, 2, 2) with the corners left out that matter less than that.

    Round things come as a hundred facets; a laser cannot tell them from twenty.
    Ramer, 1972; Douglas and Peucker, 1973.
    """
    pieces = []
    for chain in _chains(segments):
        kept = _corners_that_matter(chain, tolerance_m)
        pieces += [chain[[first, last]] for first, last in itertools.pairwise(kept)]
    thinned = np.array(pieces).reshape(-1, 2, 2)
    return thinned[np.any(thinned[:, 0] != thinned[:, 1], axis=1)]


def _directions(segments: FloatArray) -> FloatArray:
    along = segments[:, 1] - segments[:, 0]
    return np.asarray(along / np.hypot(*along.T)[:, np.newaxis])


def _united(spans_m: FloatArray) -> list[FloatArray]:
    """The union of intervals (S, 2), as intervals that neither touch nor overlap."""
    united: list[FloatArray] = []
    for span in spans_m[np.argsort(spans_m[:, 0], kind="stable")]:
        if united and span[0] <= united[-1][1] + _SAME_LINE_M:
            united[-1][1] = max(united[-1][1], span[1])
        else:
            united.append(span.copy())
    return united


def _chains(segments: FloatArray) -> list[FloatArray]:
    """Polylines (C, 2) along the segments, cut where more or fewer than one comes in and goes on."""
    keys = np.round(segments.reshape(-1, 2) / _SAME_LINE_M).astype(np.int64)
    _, node_of_end = np.unique(keys, axis=0, return_inverse=True)
    ends: NDArray[np.intp] = node_of_end.reshape(-1, 2)
    points = np.empty((int(ends.max(initial=-1)) + 1, 2))
    points[ends.ravel()] = segments.reshape(-1, 2)
    outgoing = np.bincount(ends[:, 0], minlength=len(points))
    incoming = np.bincount(ends[:, 1], minlength=len(points))
    goes_on = (outgoing == 1) & (incoming == 1)
    onward = dict(zip(ends[:, 0].tolist(), ends[:, 1].tolist(), strict=True))
    starts = [(a, b) for a, b in ends.tolist() if not goes_on[a]]
    chains, visited = [], np.zeros(len(points), dtype=bool)
    closed = [(a, b) for a, b in onward.items() if goes_on[a]]
    for first, second in [*starts, *closed]:  # what no start leads to is closed
        if visited[first] and goes_on[first]:
            continue
        nodes = [first, second]
        visited[first] = True
        while goes_on[nodes[-1]] and not visited[nodes[-1]]:
            visited[nodes[-1]] = True
            nodes.append(onward[nodes[-1]])
        chains.append(points[nodes])
    return chains


def _corners_that_matter(chain: FloatArray, tolerance_m: float) -> list[int]:
    """Indices of the points of a polyline (C, 2) to keep: first and last are among them."""
    kept, pending = {0, len(chain) - 1}, [(0, len(chain) - 1)]
    if len(chain) > 2 and np.array_equal(chain[0], chain[-1]):
        # a closed chain has no chord: the point farthest off makes two of it
        far = int(np.argmax(np.hypot(*(chain - chain[0]).T)))
        kept.add(far)
        pending = [(0, far), (far, len(chain) - 1)]
    while pending:
        first, last = pending.pop()
        if last - first < 2:
            continue
        chord = chain[last] - chain[first]
        inner = chain[first + 1 : last] - chain[first]
        length_m = math.hypot(*chord)
        if length_m > 0.0:
            off_m = np.abs(inner @ np.array([-chord[1], chord[0]])) / length_m
        else:
            off_m = np.hypot(*inner.T)
        worst = int(np.argmax(off_m))
        if off_m[worst] > tolerance_m:
            middle = first + 1 + worst
            kept.add(middle)
            pending += [(first, middle), (middle, last)]
    return sorted(kept)

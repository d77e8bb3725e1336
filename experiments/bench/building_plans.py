"""Plans of buildings, drawn at random, and ways through them: for logs of places that nobody tuned by."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from slam.arrays import FloatArray, IntArray

_DOOR_M, _RECESS_M = 0.95, 0.15
_TRIES = 5000
_OUT = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
"""Out of a rectangle, side by side, counter-clockwise from the lower one."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Walls (S, 2, 2), seen from both sides, and corners (C, 2) of the way through them [m]."""

    walls: FloatArray
    way: FloatArray


def ring(
    rng: np.random.Generator,
    length_m: tuple[float, float],
    width_m: tuple[float, float],
    *,
    laps: int = 2,
    is_bare: bool = False,
) -> Plan:
    """Four corridors about a block, driven round and along the first two sides once more."""
    length, width = rng.uniform(*length_m), rng.uniform(*width_m)
    across = rng.uniform(1.8, 3.0)
    outer, inner = (
        rectangle(0.0, 0.0, length, width),
        rectangle(across, across, length - across, width - across),
    )
    walls = [_with_doors(rng, outer[k], outer[(k + 1) % 4], _OUT[k], is_bare) for k in range(4)]
    walls += [_with_doors(rng, inner[k], inner[(k + 1) % 4], -_OUT[k], is_bare) for k in range(4)]
    middle = 0.5 * (outer + inner)
    way = np.concatenate([*[middle] * laps, middle[:3]])
    return Plan(np.concatenate(walls), way)


def corridor(rng: np.random.Generator) -> Plan:
    """One corridor, driven there and, in two of three, back."""
    length, across = rng.uniform(30.0, 90.0), rng.uniform(1.8, 3.0)
    corners = rectangle(0.0, 0.0, length, across)
    walls = [
        _with_doors(rng, corners[k], corners[(k + 1) % 4], _OUT[k], is_bare=k % 2 == 1)
        for k in range(4)
    ]
    ends = np.array([[1.0, across / 2.0], [length - 1.0, across / 2.0]])
    way = np.concatenate([ends, ends[:1]]) if rng.random() < 2.0 / 3.0 else ends
    return Plan(np.concatenate(walls), way)


def offices(rng: np.random.Generator, length_m: tuple[float, float]) -> Plan:
    """Two corridors joined at their ends, rooms on both sides of each, some of them visited."""
    length, across, apart = rng.uniform(*length_m), 2.0, 14.0
    walls: list[FloatArray] = []
    way: list[tuple[float, float]] = []
    for low, is_back in ((0.0, False), (apart, True)):
        visits: list[tuple[float, float, float]] = []
        for wall_y, side in ((low, -1.0), (low + across, 1.0)):
            is_inner = (side > 0.0) != is_back
            first, last = (across, length - across) if is_inner else (0.0, length)
            depth = (apart - across) / 2.0 if is_inner else rng.uniform(4.0, 6.0)
            visits += _rooms(rng, walls, first, last, wall_y, side * depth)
        middle = low + across / 2.0
        ends = (length - 1.0, 1.0) if is_back else (1.0, length - 1.0)
        way.append((ends[0], middle))
        for door, _, inside in sorted(visits, reverse=is_back):
            if rng.random() < 0.6:
                way += [(door, middle), (door, inside), (door, middle)]
        way.append((ends[1], middle))
    top = apart + across
    walls += [np.array([[[x, 0.0], [x, top]]]) for x in (0.0, length)]
    walls += [np.array([[[x, across], [x, apart]]]) for x in (across, length - across)]
    return Plan(np.concatenate(walls), np.array([*way, *way[:1], (length - 1.0, across / 2.0)]))


def blocks(rng: np.random.Generator) -> Plan:
    """Corridors between blocks, as streets: driven round all of them, then each at least once, which
    closes loops within loops."""
    columns, rows = int(rng.integers(2, 5)), int(rng.integers(2, 4))
    across = rng.uniform(1.8, 3.0)
    lefts = np.cumsum([0.0, *(across + rng.uniform(15.0, 60.0, columns))])
    lows = np.cumsum([0.0, *(across + rng.uniform(12.0, 45.0, rows))])
    outer = rectangle(0.0, 0.0, lefts[-1] + across, lows[-1] + across)
    sides = [(outer[k], outer[(k + 1) % 4], _OUT[k]) for k in range(4)]
    for left, right in pairwise(lefts):
        for low, high in pairwise(lows):
            inner = rectangle(left + across, low + across, right, high)
            sides += [(inner[k], inner[(k + 1) % 4], -_OUT[k]) for k in range(4)]
    walls = [_with_doors(rng, *side, is_bare=rng.random() < 0.2) for side in sides]
    crossings = _round_blocks(rng, columns, rows)
    middle = np.column_stack([lefts[crossings[:, 0]], lows[crossings[:, 1]]]) + across / 2.0
    return Plan(np.concatenate(walls), middle)


def _round_blocks(rng: np.random.Generator, columns: int, rows: int) -> IntArray:
    """(C, 2) crossings, by column and row, of a way round all blocks and then by each street between
    two of them: at each crossing by the one least driven so far, and never straight back."""
    way = [(column, 0) for column in range(columns)] + [(columns, row) for row in range(rows)]
    way += [(columns - column, rows) for column in range(columns)]
    way += [(0, rows - row) for row in range(rows + 1)]
    driven = Counter(frozenset(street) for street in pairwise(way))
    streets = 2 * columns * rows + columns + rows
    while len(driven) < streets:
        column, row = way[-1]
        ways = [(column + x, row + y) for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1))]
        ways = [(x, y) for x, y in ways if 0 <= x <= columns and 0 <= y <= rows]
        ways = [ways[k] for k in rng.permutation(len(ways)) if ways[k] != way[-2]]
        way.append(min(ways, key=lambda to: driven[frozenset((way[-1], to))]))
        driven[frozenset(way[-2:])] += 1
    return np.array(way)


def hall(rng: np.random.Generator) -> Plan:
    """One large room with boxes in it, driven to and fro among them."""
    length, width = rng.uniform(20.0, 50.0), rng.uniform(15.0, 40.0)
    corners = rectangle(0.0, 0.0, length, width)
    walls = [
        _with_doors(rng, corners[k], corners[(k + 1) % 4], _OUT[k], is_bare=False) for k in range(4)
    ]
    obstacles = []
    for _ in range(int(length * width / 40.0)):
        x, y = rng.uniform(2.0, length - 2.0), rng.uniform(2.0, width - 2.0)
        w, h = rng.uniform(0.1, 0.75, 2)
        walls.append(closed(rectangle(x - w, y - h, x + w, y + h)))
        obstacles.append((x, y, max(w, h) * 2.0))
    low, high = np.array([1.0, 1.0]), np.array([length - 1.0, width - 1.0])
    return Plan(np.concatenate(walls), _wander(rng, low, high, np.array(obstacles), 25))


def park(rng: np.random.Generator) -> Plan:
    """Trees and a few houses, far apart, without an end."""
    half = rng.uniform(30.0, 75.0)
    walls, obstacles = [], []
    for _ in range(int(half * half / 15.0)):
        x, y = rng.uniform(-half, half, 2)
        if rng.random() < 0.15:
            w, h = rng.uniform(3.0, 10.0, 2)
            walls.append(closed(rectangle(x - w, y - h, x + w, y + h)))
            obstacles.append((x, y, math.hypot(w, h) + 1.0))
        else:
            radius, around = rng.uniform(0.1, 0.3), np.linspace(0.0, 2.0 * math.pi, 8, False)
            trunk = np.column_stack([np.cos(around), np.sin(around)])
            walls.append(closed(np.array([x, y]) + radius * trunk))
            obstacles.append((x, y, radius + 0.5))
    ends = np.full(2, half)
    return Plan(np.concatenate(walls), _wander(rng, -ends, ends, np.array(obstacles), 16))


PLANS: dict[str, Callable[[np.random.Generator], Plan]] = {
    "ring of corridors": lambda rng: ring(rng, (20.0, 50.0), (15.0, 40.0)),
    "large ring, once round": lambda rng: ring(rng, (80.0, 180.0), (50.0, 100.0), laps=1),
    "ring of bare corridors": lambda rng: ring(rng, (10.0, 25.0), (8.0, 20.0), is_bare=True),
    "corridor": corridor,
    "offices": lambda rng: offices(rng, (25.0, 40.0)),
    "large offices": lambda rng: offices(rng, (60.0, 100.0)),
    "hall with boxes": hall,
    "trees and houses": park,
    "blocks": blocks,
}


def rectangle(left: float, low: float, right: float, high: float) -> FloatArray:
    """(4, 2) its corners, counter-clockwise."""
    return np.array([[left, low], [right, low], [right, high], [left, high]])


def closed(corners: FloatArray) -> FloatArray:
    """(N, 2, 2) walls from each of the corners (N, 2) to the next, and to the first."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def _with_doors(
    rng: np.random.Generator, start: FloatArray, end: FloatArray, into: FloatArray, is_bare: bool
) -> FloatArray:
    """A wall with doors each 3 to 9 m, a hand's breadth into it, or standing out."""
    if is_bare:
        return np.array([[start, end]])
    length_m = float(np.hypot(*(end - start)))
    along = (end - start) / length_m
    corners, at_m = [start], 0.0
    while True:
        at_m += rng.uniform(3.0, 9.0)
        if at_m + _DOOR_M + 0.4 > length_m:
            break
        near, far = start + along * at_m, start + along * (at_m + _DOOR_M)
        deep = into * _RECESS_M * rng.choice([0.5, 1.0, 1.0, -1.2])
        corners += [near, near + deep, far + deep, far]
        at_m += _DOOR_M
    corners.append(end)
    return np.stack([corners[:-1], corners[1:]], axis=1)


def _rooms(
    rng: np.random.Generator,
    walls: list[FloatArray],
    first: float,
    last: float,
    wall_y: float,
    depth: float,
) -> list[tuple[float, float, float]]:
    """Adds the rooms along one side of a corridor, at wall_y and as deep; of those with a door, its
    x, wall_y, and the y of a place inside."""
    far, side = wall_y + depth, math.copysign(1.0, depth)
    doors, visits, left = [], [], first
    while left < last - 2.5:
        right = min(left + rng.uniform(3.0, 6.0), last)
        right = last if last - right < 2.5 else right
        walls.append(
            np.array(
                [[[left, wall_y], [left, far]], [[right, wall_y], [right, far]],
                 [[left, far], [right, far]]]
            )
        )  # fmt: skip
        if rng.random() < 0.6:
            doors.append(left + rng.uniform(0.7, right - left - 0.7))
            inside = wall_y + side * rng.uniform(1.2, abs(depth) - 1.5)
            visits.append((doors[-1], wall_y, inside))
        for _ in range(rng.integers(1, 4)):
            x, away = rng.uniform(left + 0.2, right - 1.0), rng.uniform(0.1, 0.8)
            low, high = sorted((far - side * away, far - side * (away + 0.5)))
            walls.append(closed(rectangle(x, low, x + rng.uniform(0.3, 0.9), high)))
        left = right
    ends = np.array([first, *(x for door in sorted(doors) for x in (door - 0.5, door + 0.5)), last])
    heights = np.full(len(ends), wall_y)
    walls.append(np.column_stack([ends, heights]).reshape(-1, 2, 2))
    return visits


def _wander(
    rng: np.random.Generator, low: FloatArray, high: FloatArray, obstacles: FloatArray, count: int
) -> FloatArray:
    """Corners of a way clear of obstacles (N, 3), x, y and radius, that comes back to some of them."""
    way: list[FloatArray] = []
    tries = 0
    while len(way) < count:
        tries += 1
        if tries % _TRIES == 0:
            way.clear()  # between boxes that nothing leads out of
        at = rng.uniform(low, high)
        if len(way) > 3 and rng.random() < 0.3:
            at = way[rng.integers(len(way) - 1)]
        start = way[-1] if way else at
        if way and np.hypot(*(at - start)) < 2.0:
            continue
        along = at - start
        share = (obstacles[:, :2] - start) @ along / max(float(along @ along), 1e-12)
        nearest = start + np.clip(share, 0.0, 1.0)[:, np.newaxis] * along
        if np.all(np.hypot(*(obstacles[:, :2] - nearest).T) > obstacles[:, 2] + 0.5):
            way.append(at)
    return np.array(way)

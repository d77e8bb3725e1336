"""Which parts of a plane can be reached without crossing a wall: grids, flood filling, outlines."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from kitasap_sim.geometry import points_on

_ASIDE_M = 1e-5
"""Far above rounding, far below the thinnest sheet."""
_SEGMENTS_AT_ONCE = 128
"""Chosen: no slower than 1024; at 17 000 points each, the most there are, 200 MB."""


class NoRoomError(ValueError):
    """No start is told, and nowhere within walls is there room for the robot."""


@dataclass(frozen=True)
class Grid:
    """Square cells over a rectangle: (i, j) spans origin + cell_m * [i, i + 1] x [j, j + 1]."""

    origin_m: np.ndarray
    cell_m: float
    shape: tuple[int, int]

    @classmethod
    def over(cls, bounds_m: np.ndarray, cell_m: float, margin_m: float = 0.0) -> "Grid":
        """The grid over bounds ((2, 2): lower and upper corner) widened by a margin [m]."""
        origin_m = bounds_m[0] - margin_m
        counts = np.ceil((bounds_m[1] - bounds_m[0] + 2 * margin_m) / cell_m).astype(int)
        return cls(origin_m, cell_m, (int(counts[0]) + 1, int(counts[1]) + 1))

    def cells(self, points_m: np.ndarray) -> np.ndarray:
        """(K, 2) cell of each point (K, 2), clipped to the grid."""
        cells = np.floor((points_m - self.origin_m) / self.cell_m).astype(int)
        result: np.ndarray = np.clip(cells, 0, np.array(self.shape) - 1)
        return result

    def centres_m(self, cells: np.ndarray) -> np.ndarray:
        """(K, 2) middles of cells (K, 2) [m]."""
        return self.origin_m + (cells + 0.5) * self.cell_m

    def walls(self, segments_m: np.ndarray) -> np.ndarray:
        """Mask of the cells that segments (S, 2, 2) pass through."""
        mask = np.zeros(self.shape, dtype=bool)
        # in parts: the walls of an office building have some ten million points
        for first in range(0, len(segments_m), _SEGMENTS_AT_ONCE):
            part_m = segments_m[first : first + _SEGMENTS_AT_ONCE]
            points, _ = points_on(part_m, self.cell_m / 4)
            mask[tuple(self.cells(points).T)] = True
        return mask


def widened(mask: np.ndarray, radius_cells: float) -> np.ndarray:
    """Mask of the cells whose middle is within a radius of the middle of a cell of the mask."""
    reach = int(np.ceil(radius_cells))
    offsets = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
    offsets = offsets[np.hypot(*offsets.T) <= radius_cells]
    rows, columns = mask.shape
    padded = np.zeros((rows + 2 * reach, columns + 2 * reach), dtype=bool)
    # the mask shifted as a whole: a lit room has a million cells, each to be looked up otherwise
    for i, j in (offsets + reach).tolist():
        padded[i : i + rows, j : j + columns] |= mask
    return padded[reach : reach + rows, reach : reach + columns]


def steps_to(is_open: np.ndarray, seeds: np.ndarray, until: np.ndarray | None = None) -> np.ndarray:
    """Steps from each open cell to the nearest open seed cell (K, 2), over 4 neighbours.

    -1 where no seed can be reached, and, if a cell `until` (2,) is given, what is farther. Four neighbours, not eight: walls are drawn as 8-connected
    cells, which so leak nothing.
    """
    width = is_open.shape[1] + 2
    steps = np.full((is_open.shape[0] + 2, width), -1)
    is_dry = np.zeros(steps.shape, dtype=bool)
    is_dry[1:-1, 1:-1] = is_open
    dry, counts = is_dry.ravel(), steps.reshape(-1)
    front = (seeds[:, 0] + 1) * width + seeds[:, 1] + 1
    front = np.unique(front[dry[front]])
    last = None if until is None else int((until[0] + 1) * width + until[1] + 1)
    count = 0
    while front.size:
        dry[front] = False
        counts[front] = count
        if last is not None and counts[last] == count:
            break
        reached = (front[:, None] + np.array([-width, -1, 1, width])).ravel()
        reached = reached[dry[reached]]
        # each cell once, by whose mark stays on it: sorting them takes three times as long
        marks = np.arange(reached.size)
        counts[reached] = marks
        front = reached[counts[reached] == marks]
        count += 1
    return steps[1:-1, 1:-1]


def flooded(is_open: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """Mask of the open cells that are 4-connected with open seed cells (K, 2)."""
    return steps_to(is_open, seeds) >= 0


def way_down(steps: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """(W, 2) cells from a cell (2,) to the nearest seed, by the steps that `steps_to` counted."""
    # one cell at a time, in plain numbers: NumPy takes thirty times as long for four of them
    rows, columns = steps.shape
    counts, (i, j) = steps.item, np.asarray(cell).tolist()
    way, left = [(i, j)], counts(i, j)
    while left > 0:
        left -= 1
        around = (i - 1, j), (i, j - 1), (i, j + 1), (i + 1, j)
        for i, j in around:
            if 0 <= i < rows and 0 <= j < columns and counts(i, j) == left:
                break
        way.append((i, j))
    return np.array(way)


def pulled_straight(
    points_m: np.ndarray,
    is_way_free: Callable[[np.ndarray, np.ndarray], bool],
    may_be_free: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> np.ndarray:
    """(W, 2) those of a way's points (K, 2) that it turns at, if it goes straight where it can.

    may_be_free: of a point and (E, 2) others, False where a quick look tells that it is not.
    """
    corners = [0]
    while (first := corners[-1]) < len(points_m) - 1:
        # the farthest point in sight; the next one always is
        maybe = first + 2 + np.flatnonzero(may_be_free(points_m[first], points_m[first + 2 :]))
        seen = (i for i in maybe[::-1].tolist() if is_way_free(points_m[first], points_m[i]))
        corners.append(next(seen, first + 1))
    return points_m[corners]


def largest_room(is_open: np.ndarray) -> np.ndarray:
    """Mask of the largest connected part of the open cells that does not touch the border.

    Where every part touches it (a place without outer walls), the largest part of all.
    """
    best, best_key = np.zeros_like(is_open), (False, 0)
    rest = is_open.copy()
    while rest.any():
        part = flooded(rest, np.argwhere(rest)[:1])
        rest &= ~part
        key = (not touches_border(part), int(part.sum()))
        if key > best_key:
            best, best_key = part, key
    return best


def touches_border(mask: np.ndarray) -> bool:
    """Whether a cell of the mask lies at the border of the grid."""
    return bool(mask[[0, -1]].any() or mask[:, [0, -1]].any())


def roomiest_cell(room: np.ndarray) -> np.ndarray:
    """(2,) the cell of a mask that is farthest from what is not."""
    while True:
        smaller = room & ~widened(~room, 1.5)
        if not smaller.any():
            result: np.ndarray = np.argwhere(room)[0]
            return result
        room = smaller


def bared(outlines: Sequence[np.ndarray], covers: Sequence[bool]) -> np.ndarray:
    """(T, 2, 2) what of the outlines (S, 2, 2) of solids lies within no other of them, cut exactly.

    Each outline with the open side on its left. covers: whether a solid hides what is within it.
    Boxes that make a round wall run into each other: their ends inside it are no surface, but stand
    across it and would draw the points near it.
    """
    hides = np.array([bool(covers[i]) for i, outline in enumerate(outlines) if len(outline)])
    outlines = [outline for outline in outlines if len(outline)]
    corners = [(outline.min(axis=(0, 1)), outline.max(axis=(0, 1))) for outline in outlines]
    lower, upper = np.array(corners).reshape(-1, 2, 2).transpose(1, 0, 2)
    lower, upper = lower - _ASIDE_M, upper + _ASIDE_M
    pieces = [np.empty((0, 2, 2))]
    for i, outline in enumerate(outlines):
        is_near = hides & ((lower <= upper[i]) & (upper >= lower[i])).all(axis=1)
        is_near[i] = False
        if is_near.any():
            near = np.concatenate([outlines[j] for j in np.flatnonzero(is_near)])
            outline = np.concatenate([_cut_by(segment, near) for segment in outline])
            outline = outline[~_is_covered(outline, near)]
        pieces.append(outline)
    return np.concatenate(pieces)


def _cut_by(segment: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(P, 2, 2) a segment (2, 2) in pieces, cut where others (S, 2, 2) cross it."""
    along, across = segment[1] - segment[0], others[:, 1] - others[:, 0]
    length_m = np.hypot(*along)
    if length_m == 0.0:
        return np.empty((0, 2, 2))
    way = others[:, 0] - segment[0]
    determinant = along[0] * across[:, 1] - along[1] * across[:, 0]
    is_parallel = np.abs(determinant) < 1e-9 * length_m * np.hypot(*across.T)
    safe = np.where(is_parallel, 1.0, determinant)
    share = (way[:, 0] * across[:, 1] - way[:, 1] * across[:, 0]) / safe
    at_other = (way[:, 0] * along[1] - way[:, 1] * along[0]) / safe
    # a little beyond its ends: a corner of the other that lies on the segment cuts it as well
    is_cut = ~is_parallel & (np.abs(at_other - 0.5) <= 0.5 + 1e-9)
    # what runs along it begins and ends on it
    ends = (others[is_parallel].reshape(-1, 2) - segment[0]) @ along / length_m**2
    cuts = np.concatenate([[0.0, 1.0], share[is_cut], ends])
    cuts = np.unique(cuts[(cuts >= 0.0) & (cuts <= 1.0)])
    cuts = cuts[np.concatenate([[True], np.diff(cuts) * length_m > 1e-9])]
    cuts[-1] = 1.0
    points = segment[0] + cuts[:, None] * along
    points[-1] = segment[1]
    return np.stack([points[:-1], points[1:]], axis=1)


def _is_covered(segments: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(S,) whether the left side of segments (S, 2, 2) lies within outlines, (O, 2, 2) in all.

    By winding numbers: solids that overlap add up, and both directions of a sheet cancel.
    """
    along = segments[:, 1] - segments[:, 0]
    lengths_m = np.maximum(np.hypot(*along.T), 1e-12)
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1) / lengths_m[:, None]
    points = segments.mean(axis=1) + _ASIDE_M * aside
    (ax, ay), (bx, by) = others[:, 0].T, others[:, 1].T
    slope = np.divide(bx - ax, by - ay, where=ay != by, out=np.zeros_like(ax))
    is_covered = np.zeros(len(points), dtype=bool)
    for k in range(0, len(points), 256):  # in parts: a mesh may have thousands of segments
        x, y = points[k : k + 256, 0, None], points[k : k + 256, 1, None]
        turn = (by > y).astype(int) - (ay > y)
        is_right = x < ax + (y - ay) * slope
        right, left = (turn * is_right).sum(axis=1), (turn * ~is_right).sum(axis=1)
        # a seam within a mesh is crossed to one side alone
        is_covered[k : k + 256] = (right != 0) & (left != 0)
    return is_covered

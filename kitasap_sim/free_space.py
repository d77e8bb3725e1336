"""Which parts of a plane can be reached without crossing a wall: grids and flood filling."""

from dataclasses import dataclass

import numpy as np

from kitasap_sim.geometry import points_on


@dataclass(frozen=True)
class Grid:
    """Square cells over a rectangle: cell (i, j) spans origin + cell_m * [i, i + 1] x [j, j + 1]."""

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
        return np.clip(cells, 0, np.array(self.shape) - 1)

    def centres_m(self, cells: np.ndarray) -> np.ndarray:
        """(K, 2) middles of cells (K, 2) [m]."""
        return self.origin_m + (cells + 0.5) * self.cell_m

    def walls(self, segments_m: np.ndarray) -> np.ndarray:
        """Mask of the cells that segments (S, 2, 2) pass through."""
        mask = np.zeros(self.shape, dtype=bool)
        points, _ = points_on(segments_m, self.cell_m / 4)
        mask[tuple(self.cells(points).T)] = True
        return mask


def widened(mask: np.ndarray, radius_cells: float) -> np.ndarray:
    """Mask of the cells whose middle is within a radius of the middle of a cell of the mask."""
    reach = int(np.ceil(radius_cells))
    offsets = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
    offsets = offsets[np.hypot(*offsets.T) <= radius_cells]
    padded = np.zeros((mask.shape[0] + 2 * reach, mask.shape[1] + 2 * reach), dtype=bool)
    cells = np.argwhere(mask) + reach
    for offset in offsets:
        padded[tuple((cells + offset).T)] = True
    return padded[reach : reach + mask.shape[0], reach : reach + mask.shape[1]]


def steps_to(is_open: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """Steps from each open cell to the nearest open seed cell (K, 2), over 4 neighbours.

    -1 where no seed can be reached. Four neighbours, not eight: walls are drawn as 8-connected
    cells, which so leak nothing.
    """
    width = is_open.shape[1] + 2
    steps = np.full((is_open.shape[0] + 2, width), -1)
    is_dry = np.zeros(steps.shape, dtype=bool)
    is_dry[1:-1, 1:-1] = is_open
    dry, counts = is_dry.ravel(), steps.reshape(-1)
    front = (seeds[:, 0] + 1) * width + seeds[:, 1] + 1
    front = np.unique(front[dry[front]])
    count = 0
    while front.size:
        dry[front] = False
        counts[front] = count
        reached = (front[:, None] + np.array([-width, -1, 1, width])).ravel()
        front = np.unique(reached[dry[reached]])
        count += 1
    return steps[1:-1, 1:-1]


def flooded(is_open: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """Mask of the open cells that are 4-connected with open seed cells (K, 2)."""
    return steps_to(is_open, seeds) >= 0


def way_down(steps: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """(W, 2) cells from a cell (2,) to the nearest seed, by the steps that `steps_to` counted."""
    way = [np.array(cell)]
    padded = np.pad(steps, 1, constant_values=-1)
    neighbours = np.array([[-1, 0], [0, -1], [0, 1], [1, 0]])
    while (left := steps[tuple(way[-1])]) > 0:
        around = way[-1] + neighbours
        way.append(around[padded[tuple((around + 1).T)] == left - 1][0])
    return np.array(way)


def largest_room(is_open: np.ndarray) -> np.ndarray:
    """Mask of the largest connected part of the open cells that does not touch the border.

    Where every part touches it (a place without outer walls), the largest part of all.
    """
    best, best_key = np.zeros_like(is_open), (False, 0)
    rest = is_open.copy()
    while rest.any():
        part = flooded(rest, np.argwhere(rest)[:1])
        rest &= ~part
        touches = part[[0, -1]].any() or part[:, [0, -1]].any()
        key = (not touches, int(part.sum()))
        if key > best_key:
            best, best_key = part, key
    return best

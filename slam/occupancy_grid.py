"""The occupancy grid: which squares of the floor are free, which are not, and which nobody saw."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.special import expit

from slam.arrays import BoolArray, FloatArray, IntArray, checked_points
from slam.beams import Beams
from slam.ray_counts import RayCounts
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from slam.surface.surfels import SurfelConfig, surfel_map

UNKNOWN, FREE, OCCUPIED = -1, 0, 100
"""Values of a cell in nav_msgs/OccupancyGrid; between the last two, a probability in percent."""
_FREE_AT_MOST, _OCCUPIED_AT_LEAST = 25, 65
"""What nav2's map_saver takes for free and for occupied, when nothing else is asked for."""

_MISS = -math.log(3.0)
"""Log odds of one scan whose beams pass a cell. Chosen: one is enough to call the cell free."""
_HIT = math.log(9.0)
"""Chosen: a hit outweighs two misses, since beams that graze a wall pass many cells of it."""
_LEG_CELLS = 2
"""Chosen: what stands alone and is not longer than this many cells has no direction to speak of."""
_SIDE_CELLS, _LEAST_SLOPE = 1.5, 0.06
"""Over how many cells it is told to which side a wall faces, and by how much more free there has to
be on that side. Chosen: walls of two cells still have two sides; of the 0.25 of a straight edge."""
_PASSED_CELLS = 0.6
"""A line that stays farther from the middle of a cell than this does not stand for it. Chosen: just
above the half; at 1, lines with gaps of two cells passed."""
_STRETCH = 1.3
"""Pieces are this much longer yet. Chosen: a slanted line of points leaves out the corners of some
squares that it is cut to; one beam in twenty slipped through there."""
_CANDIDATES = 8
"""Chosen: pieces about a point that may be the nearest to it; more change no wall of real maps."""
_FARTHEST_CELL = 1e15
"""Beyond all maps, and what an integer and a float both hold."""


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """A map of square cells, each free, occupied or unknown.

    cells: (rows, columns) int8, read-only: -1 unknown, else the probability of being occupied, from
    0 to 100. Row 0 has the LOWEST y: an image of the map is the other way up. resolution_m: side of
    a cell. T_map_grid: pose in the map frame of the outer corner of cell [0, 0], from which x runs
    along the columns and y along the rows; its heading counts, though much of ROS leaves it out.
    Raises ValueError on an empty or not two-dimensional array, other values, a resolution that is
    not above 0, or a pose that is not finite.
    """

    cells: NDArray[np.int8]
    resolution_m: float
    T_map_grid: SE2

    def __post_init__(self) -> None:
        cells = np.asarray(self.cells)
        if cells.ndim != 2 or cells.size == 0:
            raise ValueError(f"cells must have shape (rows, columns), not {cells.shape}")
        if not np.issubdtype(cells.dtype, np.integer):
            raise ValueError(f"cells must be integers from -1 to 100, not {cells.dtype}")
        if cells.min() < UNKNOWN or cells.max() > OCCUPIED:
            raise ValueError(
                f"cells must lie between -1 and 100, found {cells.min()} to {cells.max()}"
            )
        resolution_m = float(self.resolution_m)
        if not (math.isfinite(resolution_m) and resolution_m > 0.0):
            raise ValueError(f"resolution_m must be above 0, not {self.resolution_m}")
        if not np.isfinite(self.T_map_grid.as_array()).all():
            raise ValueError(f"T_map_grid must be finite, not {self.T_map_grid}")
        cells = np.array(cells, dtype=np.int8)
        cells.flags.writeable = False
        object.__setattr__(self, "cells", cells)
        object.__setattr__(self, "resolution_m", resolution_m)

    @property
    def is_free(self) -> BoolArray:
        """(rows, columns) True where the cell is free: known, and 25 at most."""
        result: BoolArray = (self.cells != UNKNOWN) & (self.cells <= _FREE_AT_MOST)
        return result

    @property
    def is_occupied(self) -> BoolArray:
        """(rows, columns) True where the cell is occupied: 65 at least."""
        return np.asarray(self.cells >= _OCCUPIED_AT_LEAST)

    def cells_of(self, points: ArrayLike) -> IntArray:
        """(N, 2) row and column of the cell that each point lies in; they may lie outside the grid.

        points: (N, 2) [m], map frame. Raises ValueError if they are not finite (N, 2).
        """
        points_grid = self.T_map_grid.inverse() @ checked_points(points, "points")
        columns_rows = np.floor(points_grid / self.resolution_m)
        # what is farther than any integer says is outside all the same
        columns_rows = np.clip(columns_rows, -_FARTHEST_CELL, _FARTHEST_CELL)
        return columns_rows[:, ::-1].astype(np.int64)

    def value_at(self, points: ArrayLike) -> NDArray[np.int8]:
        """(N,) the value of the cell that each point lies in, -1 outside the grid.

        points: (N, 2) [m], map frame. Raises ValueError if they are not finite (N, 2).
        """
        rows_columns = self.cells_of(points)
        is_inside = ((rows_columns >= 0) & (rows_columns < self.cells.shape)).all(axis=1)
        values = np.full(len(rows_columns), UNKNOWN, dtype=np.int8)
        values[is_inside] = self.cells[tuple(rows_columns[is_inside].T)]
        return values

    def is_free_at(self, points: ArrayLike) -> BoolArray:
        """(N,) whether points (N, 2) [m], map frame, lie in cells known to be free."""
        values = self.value_at(points)
        return np.asarray((values >= 0) & (values <= _FREE_AT_MOST))

    def centres_of(self, rows_columns: ArrayLike) -> FloatArray:
        """(N, 2) the middles of cells [m], map frame; of such outside the grid as well.

        rows_columns: (N, 2) row and column of each. Raises ValueError on another shape.
        """
        rows_columns = checked_points(rows_columns, "rows_columns")
        return self.T_map_grid @ ((rows_columns[:, ::-1] + 0.5) * self.resolution_m)

    def points(self) -> FloatArray:
        """(K, 2) where walls are seen [m], map frame: middles of occupied cells beside free ones.

        Beside: at a side or at a corner, so that of a thick wall its surface alone is left. In a
        map without any free cell, all that are occupied.
        """
        return self.centres_of(self._surface())

    def walls(self, config: SurfelConfig | None = None) -> SegmentMap:
        """The walls on `points`, as `surfel_map` makes them, and a cross for each thing too small.

        Each side of a wall has lines of its own; those of a wall one cell thick are its middle.
        A table's leg, alone and not longer than two cells, makes no line: it becomes a cross of its
        size, seen from all around. So does each cell that no line passes.
        config: None takes one that suits the resolution. Raises ValueError where no cell is
        occupied.
        """
        config = config or _surfel_config(self.resolution_m)
        surface = self._surface()
        if len(surface) == 0:
            rows, columns = self.cells.shape
            raise ValueError(f"none of {rows} x {columns} cells is occupied: there are no walls")
        things = _things(self.centres_of(surface), config.reach_m)
        boxes = _boxes(surface, things)
        is_leg = (boxes[:, 1] - boxes[:, 0]).max(axis=1) < _LEG_CELLS
        surface = surface[~is_leg[things]]
        points, sides = self.centres_of(surface), _sides(self.is_free, surface)
        pieces, sigmas_m = [np.empty((0, 2, 2))], [np.empty(0)]
        for side in np.unique(sides):
            lines, line_sigmas_m = _lines(points[sides == side], config)
            pieces.append(lines)
            sigmas_m.append(line_sigmas_m)
        distances_m = _distances_m(points, np.concatenate(pieces))
        left = surface[distances_m > _PASSED_CELLS * self.resolution_m]
        crosses = self._crosses(np.concatenate([boxes[is_leg], np.stack([left, left], axis=1)]))
        pieces.append(crosses)
        sigmas_m.append(np.full(len(crosses), config.min_sigma_m))
        return SegmentMap(np.concatenate(pieces), np.concatenate(sigmas_m))

    def free_space(self, clearance_m: float) -> BoolArray:
        """(rows, columns) True for free cells with no occupied cell so near to their middle.

        An occupied cell is taken for the circle about it: what is called clear is clear, and at its
        sides a fifth of a cell is given away. Unknown cells and the map's border are no obstacles.
        Raises ValueError if clearance_m is negative or nan.
        """
        if not clearance_m >= 0.0:
            raise ValueError(f"clearance_m must not be negative, not {clearance_m}")
        is_occupied = self.is_occupied
        if not is_occupied.any():
            return self.is_free  # there is nothing to be far from
        distances_m = distance_transform_edt(~is_occupied, sampling=self.resolution_m)
        return self.is_free & (distances_m - self.resolution_m / math.sqrt(2.0) >= clearance_m)

    @staticmethod
    def of_scans(
        scans: Iterable[tuple[SE2, Beams]], resolution_m: float = 0.05, free_range_m: float = 0.0
    ) -> OccupancyGrid:
        """The grid of what scans saw: a cell's odds by how many scans hit it, and how many passed.

        scans: T_map_base and beams of each. A scan counts once for a cell, as a hit if any of its
        beams ended there. Ranges of nan, -inf and 0 tell nothing. free_range_m: how far a beam
        without return (inf) has seen nothing; 0 where this is not known: glass returns nothing
        either. Cells that no beam reached are -1. The grid lies along the map's axes, and is as
        large as what was seen. Something that stood in a third of the scans counts as occupied.
        Raises ValueError if no beam tells anything, a pose is not finite, or the beams reach so far
        that the grid would have more than 2**27 cells.
        """
        if not (math.isfinite(resolution_m) and resolution_m > 0.0):
            raise ValueError(f"resolution_m must be above 0, not {resolution_m}")
        if not (math.isfinite(free_range_m) and free_range_m >= 0.0):
            raise ValueError(f"free_range_m must be finite and not negative, not {free_range_m}")
        counts = RayCounts.of(scans, resolution_m, free_range_m)
        hits, misses, corner_m = counts.hits, counts.misses, counts.corner_m
        values = np.rint(OCCUPIED * expit(_HIT * hits + _MISS * misses)).astype(np.int8)
        values[(hits == 0) & (misses == 0)] = UNKNOWN
        return OccupancyGrid(values, resolution_m, SE2(corner_m[0], corner_m[1], 0.0))

    def _surface(self) -> IntArray:
        """(K, 2) row and column of the cells of `points`."""
        is_free, is_surface = self.is_free, self.is_occupied
        if is_free.any():
            is_surface &= binary_dilation(is_free, np.ones((3, 3), dtype=bool))
        return np.argwhere(is_surface)

    def _crosses(self, boxes: IntArray) -> FloatArray:
        """(2 B, 2, 2) a cross through each box of cells (B, 2, 2) [m], map frame.

        A box is its first row and column, and its last.
        """
        lower, upper = boxes[:, 0] - 0.5, boxes[:, 1] + 0.5
        middle = (lower + upper) / 2.0
        ends = []
        for axis in range(2):
            for side in (lower, upper):
                end = middle.copy()
                end[:, axis] = side[:, axis]
                ends.append(self.centres_of(end))
        return np.concatenate([np.stack(ends[:2], axis=1), np.stack(ends[2:], axis=1)])


def _surfel_config(resolution_m: float) -> SurfelConfig:
    """The pieces that suit a grid: five cells of a wall within reach, sigma that of a cell's side.

    Chosen on a room of slanted walls: with pieces 1.5 cells long, one beam in twenty found no wall
    where it ended; of one cell, one in a hundred.
    """
    return SurfelConfig(
        cell_m=max(0.1, resolution_m),
        reach_m=max(0.15, 2.5 * resolution_m),
        min_sigma_m=max(0.01, resolution_m / math.sqrt(12.0)),
    )


def _things(points: FloatArray, reach_m: float) -> NDArray[np.int32]:
    """(K,) number of the thing that each point (K, 2) is of: all that steps of that reach join."""
    pairs = cKDTree(points).query_pairs(reach_m, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), dtype=bool), tuple(pairs.T)), shape=(len(points),) * 2)
    return np.asarray(connected_components(links, directed=False)[1])


def _boxes(rows_columns: IntArray, things: NDArray[np.int32]) -> IntArray:
    """(T, 2, 2) first row and column of each thing, and last, of its cells (K, 2)."""
    boxes = np.empty((things.max() + 1, 2, 2), dtype=np.int64)
    boxes[:, 0], boxes[:, 1] = np.iinfo(np.int64).max, -1
    np.minimum.at(boxes[:, 0], things, rows_columns)
    np.maximum.at(boxes[:, 1], things, rows_columns)
    return boxes


def _sides(is_free: BoolArray, surface: IntArray) -> IntArray:
    """(K,) to which side each cell of the surface (K, 2) faces: 1 to 4; 0 where it has two of them.

    Lines are fitted to each side alone, lest both sides of a wall make one line between them.
    """
    rows, columns = surface.T
    slopes = [
        gaussian_filter(is_free.astype(np.float32), _SIDE_CELLS, order, mode="nearest")
        for order in ((1, 0), (0, 1))
    ]
    along_y, along_x = (slope[rows, columns] for slope in slopes)
    sides = np.where(
        np.abs(along_x) >= np.abs(along_y),
        np.where(along_x > 0.0, 1, 2),
        np.where(along_y > 0.0, 3, 4),
    )
    framed = np.pad(is_free, 1)
    rows, columns = rows + 1, columns + 1
    is_thin = framed[rows - 1, columns] & framed[rows + 1, columns]
    is_thin |= framed[rows, columns - 1] & framed[rows, columns + 1]
    is_thin |= np.hypot(along_x, along_y) < _LEAST_SLOPE
    sides[is_thin] = 0
    return sides


def _lines(points: FloatArray, config: SurfelConfig) -> tuple[FloatArray, FloatArray]:
    """(S, 2, 2) the pieces of `surfel_map` and (S,) their sigmas; none where it finds no line."""
    try:
        found = surfel_map(points, config)
    except ValueError:
        # no line anywhere; the points are finite, and their cells become crosses
        return np.empty((0, 2, 2)), np.empty(0)
    once = len(found) // 2  # each wall is kept in both directions, one half of them each
    segments = found.segments[:once]
    middles = segments.mean(axis=1, keepdims=True)
    return middles + _STRETCH * (segments - middles), found.sigma_m[:once]


def _distances_m(points: FloatArray, segments: FloatArray) -> FloatArray:
    """(K,) distance of points (K, 2) from the nearest of short segments (S, 2, 2); inf: none."""
    nearest_m = np.full(len(points), np.inf)
    if len(points) == 0 or len(segments) == 0:
        return nearest_m
    middles, halves = segments.mean(axis=1), (segments[:, 1] - segments[:, 0]) / 2.0
    lengths_squared = (halves**2).sum(axis=1)
    # of short pieces, the nearest is one of those whose middles are nearest
    _, candidates = cKDTree(middles).query(points, k=min(_CANDIDATES, len(middles)))
    for ids in np.asarray(candidates).reshape(len(points), -1).T:
        offset = points - middles[ids]
        share = (offset * halves[ids]).sum(axis=1) / lengths_squared[ids]
        across = offset - np.clip(share, -1.0, 1.0)[:, np.newaxis] * halves[ids]
        nearest_m = np.minimum(nearest_m, np.hypot(*across.T))
    return nearest_m

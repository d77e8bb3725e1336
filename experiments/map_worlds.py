"""A ROS map made solid: a place for the simulated robot of the cells that are not free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt, label

from kitasap_sim.built_places import Block, place_mjcf
from kitasap_sim.rectangles import rectangles
from kitasap_sim.robot import KITASAP2
from slam.arrays import BoolArray
from slam.files.map_files import read_map
from slam.occupancy_grid import OccupancyGrid
from slam.se2 import SE2

DEFAULT_SPECK_CELLS = 2
"""Chosen: what one or two cells of a map show is noise more often than a leg; 0 keeps all."""
_RIM_CELLS = 2
"""Chosen: so thick are the walls where the map ends and the free space does not."""
_MOST_BOXES = 30_000
"""Chosen: a scan of 682 beams then takes 0.2 s; six times the Willow Garage office."""
_WIDEST_M = 600.0
"""Chosen: the cells in which a place's free space is found are then 0.2 m wide."""
_ANY_NEIGHBOUR = np.ones((3, 3), dtype=int)


@dataclass(frozen=True, eq=False)
class MapWorld:
    """What a map was made into.

    mjcf: the place's file. solid: (rows, columns) cells of the place, lowest y first; T_map_grid:
    pose of the outer corner of solid[0, 0]. free_m2: what is left open; specks, pockets: islands
    taken away, and parts of the free space filled since no way leads there.
    """

    mjcf: str
    solid: BoolArray
    resolution_m: float
    T_map_grid: SE2
    boxes: int
    free_m2: float
    specks: int
    pockets: int
    start: SE2


def map_world(
    path: Path, height_m: float, speck_cells: int = DEFAULT_SPECK_CELLS, start: SE2 | None = None
) -> MapWorld:
    """The place that a map of map_server makes.

    All that is not known to be free is solid: a beam ends where the map ends to know. Islands of no
    more than `speck_cells` cells are taken away. Only the free space connected with the start is
    kept; without one, the part where the robot can go farthest, and its roomiest spot is the start.
    Raises ValueError, one line that names the file, where that makes no place; OSError.
    """
    grid = read_map(path)
    try:
        return _made(grid, path.stem, height_m, speck_cells, start)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _made(
    grid: OccupancyGrid, name: str, height_m: float, speck_cells: int, start: SE2 | None
) -> MapWorld:
    cell_m = grid.resolution_m
    if max(grid.cells.shape) * cell_m > _WIDEST_M:
        rows, columns = grid.cells.shape
        raise ValueError(
            f"{columns} x {rows} cells of {cell_m:g} m: a place may be {_WIDEST_M:g} m wide at most"
        )
    # closed all around, where the map ends as well
    solid, specks = _despeckled(
        np.pad(~grid.is_free, _RIM_CELLS, constant_values=True), speck_cells
    )
    T_map_grid = grid.T_map_grid @ SE2(-_RIM_CELLS * cell_m, -_RIM_CELLS * cell_m, 0.0)
    # at least so far are walls from the middle of a cell: half a cell less than their middles
    room_m = (distance_transform_edt(~solid) - 0.5) * cell_m
    if start is None:
        start = _roomiest(room_m, cell_m, T_map_grid)
    solid, pockets = _one_room(solid, room_m, start, cell_m, T_map_grid)
    solid, T_map_grid = _cropped(solid, cell_m, T_map_grid)
    try:
        boxes = rectangles(solid, _MOST_BOXES)
    except ValueError as error:
        raise ValueError(
            f"its walls are too ragged, they take {error}: despeckle more (--speck), or a coarser map"
        ) from None
    free_m2 = float((~solid).sum()) * cell_m**2
    source = f"Made of the map {name}: {len(boxes)} boxes of its cells of {cell_m:g} m."
    mjcf = place_mjcf(
        name,
        source,
        _blocks(boxes, cell_m, height_m),
        (start.x, start.y, start.theta),
        (T_map_grid.x, T_map_grid.y, T_map_grid.theta),
    )
    return MapWorld(
        mjcf, solid, cell_m, T_map_grid, len(boxes), free_m2, specks, pockets, start
    )  # fmt: skip


def _despeckled(solid: BoolArray, speck_cells: int) -> tuple[BoolArray, int]:
    """The same without the small islands, and how many those were. Cells that touch at a corner
    are one island."""
    islands, _ = label(solid, _ANY_NEIGHBOUR)
    sizes = np.bincount(islands.ravel())
    is_speck = sizes <= speck_cells
    is_speck[0] = False
    return solid & ~is_speck[islands], int(is_speck.sum())


def _roomiest(room_m: np.ndarray, cell_m: float, T_map_grid: SE2) -> SE2:
    """The spot with most room in the largest part that the robot can drive through."""
    parts, count = label(room_m > KITASAP2.radius_m)
    if count == 0:
        raise ValueError(
            f"nowhere in its free space are {KITASAP2.radius_m:g} m of room around the robot"
        )
    largest = 1 + int(np.bincount(parts.ravel())[1:].argmax())
    spot = np.unravel_index(np.where(parts == largest, room_m, 0.0).argmax(), room_m.shape)
    return T_map_grid @ SE2((spot[1] + 0.5) * cell_m, (spot[0] + 0.5) * cell_m, -T_map_grid.theta)


def _one_room(
    solid: BoolArray, room_m: np.ndarray, start: SE2, cell_m: float, T_map_grid: SE2
) -> tuple[BoolArray, int]:
    """All that is not connected with the start is filled; and how many parts that were."""
    x, y = (T_map_grid.inverse() @ np.array([[start.x, start.y]]))[0]
    row, column = int(np.floor(y / cell_m)), int(np.floor(x / cell_m))
    rows, columns = solid.shape
    is_inside = 0 <= row < rows and 0 <= column < columns
    if not (is_inside and room_m[row, column] > KITASAP2.radius_m):
        raise ValueError(
            f"its start ({start.x:.2f}, {start.y:.2f}) has less than {KITASAP2.radius_m:g} m of"
            " known free space around it"
        )
    parts, count = label(~solid)
    return parts != parts[row, column], count - 1


def _cropped(solid: BoolArray, cell_m: float, T_map_grid: SE2) -> tuple[BoolArray, SE2]:
    """No more of the solid around than its rim."""
    rows, columns = (np.flatnonzero((~solid).any(axis=axis)) for axis in (1, 0))
    first_row, first_column = rows[0] - _RIM_CELLS, columns[0] - _RIM_CELLS
    kept = solid[first_row : rows[-1] + _RIM_CELLS + 1, first_column : columns[-1] + _RIM_CELLS + 1]
    return kept, T_map_grid @ SE2(first_column * cell_m, first_row * cell_m, 0.0)


def _blocks(boxes: np.ndarray, cell_m: float, height_m: float) -> Sequence[Block]:
    return [
        Block(
            (left + right) / 2 * cell_m,
            (low + high) / 2 * cell_m,
            (right - left) * cell_m,
            (high - low) * cell_m,
            height_m,
        )
        for low, left, high, right in boxes.tolist()
    ]

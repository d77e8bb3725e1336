"""Maps that recorded logs are localised on: made from reference poses, or read from a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from slam.arrays import BoolArray, FloatArray
from slam.beams import Beams
from slam.laser_model import LaserModel
from slam.localization import Localizer
from slam.lost import Guard, GuardConfig
from slam.map_files import read_map
from slam.matchers import FastMatcher, LimitMatcher, Matcher, Open3dMatcher
from slam.measurements import Measurement
from slam.occupancy_grid import OccupancyGrid, still_standing
from slam.point_map import PointMap
from slam.range_noise import RangeNoise
from slam.relocalization import FreeSpace, Relocalizer
from slam.se2 import SE2
from slam.segment_map import SegmentMap
from slam.surfel_grid import SurfelGrid
from slam.surfels import surfel_map

METHODS = ("open3d", "fast", "limit")
_SPACING_M = 0.05
"""Of the points on walls that ICP is given."""
_GRID_CELL_M = 0.03
_BESIDE_FREE_M = 0.1
"""How far from a cell that is known to be free the robot's middle may be."""


@dataclass(frozen=True, eq=False)
class KnownMap:
    """A map with all that the methods make of it, for one laser.

    points: (K, 2) [m] for ICP; walls: for the others; is_free: where to search, None: anywhere;
    grid: that it was read from.
    """

    points: FloatArray
    walls: SegmentMap
    laser: LaserModel
    is_free: FreeSpace | None = None
    grid: OccupancyGrid | None = None

    @cached_property
    def point_map(self) -> PointMap:
        """The points."""
        return PointMap(self.points, _SPACING_M)

    @cached_property
    def surfels(self) -> SurfelGrid:
        """The wall nearest to each spot."""
        return SurfelGrid.of(self.walls, _GRID_CELL_M)

    @cached_property
    def relocalizer(self) -> Relocalizer:
        """The search of the whole map."""
        return Relocalizer.of(self.walls, self.surfels, self.laser, self.is_free)

    def matcher(self, method: str) -> Matcher:
        """A method by name. Raises ValueError, naming those there are, for another."""
        if method not in METHODS:
            raise ValueError(f"no method called '{method}' here; there are: {', '.join(METHODS)}")
        if method == "open3d":
            return Open3dMatcher(self.point_map)
        fast = FastMatcher(self.surfels, self.laser)
        return fast if method == "fast" else LimitMatcher(self.walls, self.laser, fast)

    def localizer(
        self,
        method: str,
        start: SE2 | None,
        T_base_laser: SE2,
        guard: GuardConfig | None = None,
    ) -> Localizer:
        """A localizer that knows when it is lost; start: None where nothing is known of it."""
        return Localizer(
            self.matcher(method), start, T_base_laser, None, Guard(self.relocalizer, guard)
        )


def assumed_laser(range_max_m: float, range_sigma_m: float) -> LaserModel:
    """What is assumed of the laser of a recorded log."""
    return LaserModel(RangeNoise(((0.0, range_sigma_m),)), 0.0, range_max_m)


def map_of_scans(
    rows: Sequence[tuple[Measurement, SE2]],
    T_base_laser: SE2,
    spacing_m: float,
    laser: LaserModel,
) -> KnownMap:
    """The map that scans make from where they were taken; what has gone since is left out.

    Raises ValueError if they make no wall anywhere.
    """
    point_map = PointMap(np.empty((0, 2)), spacing_m)
    seen = [(T_map_base, Beams.of(m.scan, T_base_laser)) for m, T_map_base in rows]
    for T_map_base, beams in seen:
        point_map.integrate(T_map_base @ beams.points)
    points = point_map.points[still_standing(point_map.points, seen)]
    return KnownMap(points, surfel_map(points), laser)


def map_of_file(path: Path, laser: LaserModel) -> KnownMap:
    """A ROS map. Raises ValueError or OSError for a file that is none, or shows no wall."""
    grid = read_map(path)
    if not grid.is_occupied.any():
        raise ValueError(
            f"{path}: no cell of the map is occupied: nothing to localise by (occupied_thresh?)"
        )
    if len(grid.points()) == 0:
        raise ValueError(
            f"{path}: no occupied cell of the map is beside a free one: no wall is seen"
        )
    walls = grid.walls()
    return KnownMap(walls.sampled(_SPACING_M)[0], walls, laser, _beside_free(grid), grid)


def _beside_free(grid: OccupancyGrid) -> FreeSpace | None:
    if not grid.is_free.any():
        return None
    steps = _BESIDE_FREE_M * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])

    def is_free(points: FloatArray) -> BoolArray:
        near = [grid.is_free_at(points + step) for step in steps]
        return np.asarray(np.any(near, axis=0))

    return is_free

"""A known map with all that the methods make of it: what a `Localizer` on it needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from slam.arrays import BoolArray, FloatArray
from slam.beams import Beams
from slam.guard.guard_config import GuardConfig
from slam.icp import CoarseToFineConfig
from slam.laser_model import LaserModel
from slam.likelihood_grid import SearchConfig, layout
from slam.localization import Localizer, LocalizerConfig
from slam.lost import Guard
from slam.matchers import FastMatcher, LimitMatcher, Matcher, Open3dMatcher
from slam.occupancy_grid import OccupancyGrid
from slam.point_map import PointMap
from slam.range_noise import RangeNoise
from slam.relocalization import FreeSpace, Relocalizer
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from slam.surface.surfaces import Surfaces
from slam.surface.surfel_grid import SurfelGrid
from slam.surface.surfels import surfel_map

METHODS = ("open3d", "fast", "limit")
USUAL_LASER = LaserModel(RangeNoise(((0.0, 0.02),)), 0.0, 12.0)
"""What is assumed of a laser of which nothing is told. chosen: at 12 m the beams of a SICK (1 degree)
are 20 cm apart, as far as a related point may be from either of two neighbours; a SICK's noise of
1 cm with what a scan's own way while it turns adds."""
_MOST_ENDS = 0.8
"""Share of the ranges within which a hall lies; chosen. Of halls 30 to 80 m large, seen from their middle, 12 m show
nothing at all."""
_MOST_WALL_CELLS = 250_000
"""Chosen: of the Intel Research Lab at 5 cm there are 10 000."""
_SPACING_M = 0.05
"""Of the points on walls that ICP is given."""
_BESIDE_FREE_M = 0.1
"""How far from a cell that is known to be free the robot's middle may be."""


def laser_seen(scans: Sequence[Beams]) -> LaserModel:
    """`USUAL_LASER`, as far as `reach_m` of what some scans saw, and no farther than any of them."""
    hits_m = np.concatenate([np.zeros(0), *(beams.ranges_m[beams.is_hit] for beams in scans)])
    most_m = min(float(hits_m.max(initial=0.0)), reach_m(hits_m))
    return replace(USUAL_LASER, range_max_m=most_m) if most_m > 0.0 else USUAL_LASER


def reach_m(ranges_m: FloatArray) -> float:
    """As far as a place is localised in [m] of which a laser measured these ranges (N,): as far as
    `USUAL_LASER`, or, in a hall of which most lies beyond, as most of it."""
    most_m = float(np.quantile(ranges_m, _MOST_ENDS)) if len(ranges_m) else 0.0
    return max(USUAL_LASER.range_max_m, most_m)


@dataclass(frozen=True, eq=False)
class KnownMap:
    """A map with all that the methods make of it, for one laser.

    points: (K, 2) [m] for ICP, spacing_m apart; drawn_walls: for the others, None: those that the
    points make; is_free: where to search, None: anywhere; grid: that it was read from.
    """

    points: FloatArray
    laser: LaserModel
    drawn_walls: SegmentMap | None = None
    is_free: FreeSpace | None = None
    grid: OccupancyGrid | None = None
    spacing_m: float = _SPACING_M
    surfel_cell_m: float = 0.03

    @staticmethod
    def of_surfaces(surfaces: Surfaces, laser: LaserModel = USUAL_LASER) -> KnownMap:
        """Of what scans saw. Raises ValueError for no surface."""
        return KnownMap(surfaces.points(_SPACING_M), laser, surfaces.walls())

    @staticmethod
    def of_walls(walls: SegmentMap, laser: LaserModel = USUAL_LASER) -> KnownMap:
        """Of walls as a plan has them, such as `SegmentMap.known` makes."""
        return KnownMap(walls.sampled(_SPACING_M)[0], laser, walls)

    @staticmethod
    def of_grid(grid: OccupancyGrid, laser: LaserModel = USUAL_LASER) -> KnownMap:
        """Of an occupancy grid, such as `read_map` reads; searched beside its free cells, if any.

        Raises ValueError where it shows no wall, or reaches too far to be searched.
        """
        if not grid.is_occupied.any():
            raise ValueError(
                "no cell of the map is occupied: nothing to localise by (occupied_thresh?)"
            )
        wall_cells = len(grid.points())
        if wall_cells == 0:
            raise ValueError("no occupied cell of the map is beside a free one: no wall is seen")
        if wall_cells > _MOST_WALL_CELLS:
            raise ValueError(
                f"{wall_cells} cells of the map are walls beside free ones, more than"
                f" {_MOST_WALL_CELLS}: noise, or a map to take a part of"
            )
        walls = grid.walls()
        try:
            # before the walls are cut into points, which of a map too large fill the memory
            layout(walls.segments.reshape(-1, 2), laser.range_max_m, SearchConfig())
        except ValueError as error:
            raise ValueError(f"{error} (resolution {grid.resolution_m:g} m?)") from error
        return KnownMap(walls.sampled(_SPACING_M)[0], laser, walls, _beside_free(grid), grid)

    @cached_property
    def point_map(self) -> PointMap:
        """The points."""
        return PointMap(self.points, self.spacing_m)

    @cached_property
    def walls(self) -> SegmentMap:
        """The walls. Raises ValueError for points that make none anywhere."""
        return surfel_map(self.points) if self.drawn_walls is None else self.drawn_walls

    @cached_property
    def surfels(self) -> SurfelGrid:
        """The wall nearest to each spot."""
        return SurfelGrid.of(self.walls, self.surfel_cell_m)

    @cached_property
    def relocalizer(self) -> Relocalizer:
        """The search of the whole map."""
        return Relocalizer.of(self.walls, self.surfels, self.laser, self.is_free)

    def matcher(self, method: str, icp: CoarseToFineConfig | None = None) -> Matcher:
        """A method by name; icp: of `open3d`.

        Raises ValueError, naming those there are, for another.
        """
        if method not in METHODS:
            raise ValueError(f"no method called '{method}' here; there are: {', '.join(METHODS)}")
        if method == "open3d":
            return Open3dMatcher(self.point_map, icp or CoarseToFineConfig())
        fast = FastMatcher(self.surfels, self.laser)
        return fast if method == "fast" else LimitMatcher(self.walls, self.laser, fast)

    def localizer(
        self,
        method: str,
        start: SE2 | None,
        T_base_laser: SE2,
        guard: GuardConfig | None = None,
    ) -> Localizer:
        """A localizer that knows when it is lost; start: None where nothing is known of it.

        What lies beyond the laser's range is left out of its scans, as it is of the map.
        """
        config = LocalizerConfig(range_max_m=self.laser.range_max_m)
        guarded = Guard(self.relocalizer, guard)
        return Localizer(self.matcher(method), start, T_base_laser, config, guarded)


def _beside_free(grid: OccupancyGrid) -> FreeSpace | None:
    if not grid.is_free.any():
        return None
    steps = _BESIDE_FREE_M * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])

    def is_free(points: FloatArray) -> BoolArray:
        near = [grid.is_free_at(points + step) for step in steps]
        return np.asarray(np.any(near, axis=0))

    return is_free

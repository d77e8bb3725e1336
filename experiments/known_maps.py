"""Maps that recorded logs are localised on: made from reference poses, or read from a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from experiments.protocols import DEFAULT_METHOD
from slam.arrays import BoolArray, FloatArray
from slam.beams import Beams
from slam.icp import CoarseToFineConfig
from slam.laser_model import LaserModel
from slam.localization import Localizer
from slam.lost import Guard, GuardConfig
from slam.map_files import read_map
from slam.mapping import SlamMap
from slam.matchers import FastMatcher, LimitMatcher, Matcher, Open3dMatcher
from slam.measurements import Measurement
from slam.occupancy_grid import OccupancyGrid
from slam.point_map import PointMap
from slam.range_noise import RangeNoise
from slam.ray_counts import still_standing
from slam.relocalization import FreeSpace, Relocalizer
from slam.se2 import SE2
from slam.segment_map import SegmentMap
from slam.slam_map_files import read_slam_map
from slam.surfel_grid import SurfelGrid
from slam.surfels import surfel_map

METHODS = ("open3d", "fast", "limit")
_SPACING_M = 0.05
"""Of the points on walls that ICP is given."""
_BESIDE_FREE_M = 0.1
"""How far from a cell that is known to be free the robot's middle may be."""


@dataclass(frozen=True)
class LogConfig:
    """What is assumed of a recorded log and its laser; the same for every log.

    method: open3d, fast or limit. range_max_m: what lies farther is left out, of map and scans.
    chosen: at 12 m the beams of a SICK (1 degree) are 20 cm apart, as far as a related point may be
    from either of two neighbours. range_sigma_m: noise of a range; chosen: a SICK's 1 cm with what
    a scan's own way while it turns adds.
    """

    method: str = DEFAULT_METHOD["localize"]
    range_max_m: float = 12.0
    range_sigma_m: float = 0.02

    @property
    def laser(self) -> LaserModel:
        """The laser assumed."""
        return LaserModel(RangeNoise(((0.0, self.range_sigma_m),)), 0.0, self.range_max_m)


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
        """A localizer that knows when it is lost; start: None where nothing is known of it."""
        return Localizer(
            self.matcher(method), start, T_base_laser, None, Guard(self.relocalizer, guard)
        )


def map_of_scans(
    rows: Sequence[tuple[Measurement, SE2]],
    T_base_laser: SE2,
    spacing_m: float,
    laser: LaserModel,
) -> KnownMap:
    """The map that scans make from where they were taken; what has gone since is left out."""
    points = points_of_scans(rows, T_base_laser, spacing_m)
    seen = [(T_map_base, Beams.of(m.scan, T_base_laser)) for m, T_map_base in rows]
    return KnownMap(points[still_standing(points, seen)], laser, spacing_m=spacing_m)


def points_of_scans(
    rows: Sequence[tuple[Measurement, SE2]], T_base_laser: SE2, spacing_m: float
) -> FloatArray:
    """(K, 2) all that scans saw from where they were taken, thinned to a spacing [m]."""
    point_map = PointMap(np.empty((0, 2)), spacing_m)
    for measurement, T_map_base in rows:
        point_map.integrate(T_map_base @ measurement.scan.points(T_base_laser))
    return point_map.points


def map_of_slam(slam_map: SlamMap, laser: LaserModel) -> KnownMap:
    """The map that the robot made itself. Raises ValueError for one without a surface."""
    surfaces = slam_map.surfaces
    return KnownMap(surfaces.points(_SPACING_M), laser, surfaces.walls())


def map_of_file(path: Path, laser: LaserModel) -> KnownMap:
    """A ROS map, or one of ours. Raises ValueError or OSError for a file that is none, or shows no
    wall."""
    if path.suffix == ".kitasap":
        return map_of_slam(read_slam_map(path), laser)
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
    return KnownMap(walls.sampled(_SPACING_M)[0], laser, walls, _beside_free(grid), grid)


def _beside_free(grid: OccupancyGrid) -> FreeSpace | None:
    if not grid.is_free.any():
        return None
    steps = _BESIDE_FREE_M * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])

    def is_free(points: FloatArray) -> BoolArray:
        near = [grid.is_free_at(points + step) for step in steps]
        return np.asarray(np.any(near, axis=0))

    return is_free

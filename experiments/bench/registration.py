"""What a row of `kitasap bench registration` is, and our own rows. The peers stand beside it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.laser_model import LaserModel
from slam.matchers import FastMatcher, LimitMatcher, Matcher, Open3dMatcher
from slam.measurements import LaserScan
from slam.point_map import PointMap
from slam.scan_matching import SurfelMatchConfig, match_surfels
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from slam.surface.surfel_grid import SurfelGrid

Register = Callable[[FloatArray, LaserScan, SE2], SE2]
"""From points_base (N, 2) [m], the scan that they were taken from, and the pose to start at, to
T_map_base. A row may use either form of the scan, whichever serves it."""


@dataclass(frozen=True)
class KnownMap:
    """What every row is told beforehand.

    points: (K, 2) [m]. segments: (S, 2, 2) [m], the same surfaces. laser_model: what
    is assumed of the laser.
    """

    points: FloatArray
    segments: FloatArray
    T_base_laser: SE2
    laser_model: LaserModel

    @cached_property
    def walls(self) -> SegmentMap:
        """The surfaces as a map of walls."""
        return SegmentMap.known(self.segments, is_one_sided=True)


class Registration(Protocol):
    """One row: a way to find the pose of a scan on a known map."""

    @property
    def name(self) -> str:
        """The first column."""
        ...

    @property
    def note(self) -> str:
        """What the name does not tell: the last column."""
        ...

    @property
    def package(self) -> str | None:
        """The distribution that it needs out of the extra `peers`; None for all other rows."""
        ...

    def prepare(self, known: KnownMap) -> Register:
        """Whatever can be done once per map, and the registration that makes use of it.

        Raises ModuleNotFoundError where a library is missing.
        """
        ...


@dataclass(frozen=True)
class MatcherRow:
    """A matcher as `Localizer` uses it, verdict and all: from the scan to the believed pose."""

    name: str
    note: str
    make: Callable[[KnownMap], Matcher]
    package: str | None = None

    def prepare(self, known: KnownMap) -> Register:
        """The matcher on its map."""
        matcher = self.make(known)

        def register(points_base: FloatArray, scan: LaserScan, T_start: SE2) -> SE2:
            return matcher(Beams.of(scan, known.T_base_laser), T_start).T_map_base

        return register


@dataclass(frozen=True)
class SurfelRow:
    """`fast` at its core: points in, pose out, without a verdict."""

    name: str = "kitasap fast"
    note: str = "Gauss-Newton on the surfel grid"
    package: str | None = None

    def prepare(self, known: KnownMap) -> Register:
        """The grid of the map's walls."""
        grid, noise_table = SurfelGrid.of(known.walls), known.laser_model.noise_table
        origin_m = np.array([known.T_base_laser.x, known.T_base_laser.y])
        config = SurfelMatchConfig()

        def register(points_base: FloatArray, scan: LaserScan, T_start: SE2) -> SE2:
            return match_surfels(
                points_base, origin_m, grid, noise_table, T_start, config
            ).T_map_base

        return register


_SPACING_M = 0.005
"""Where a point map would take up new points; nothing is added to it here."""

OURS: tuple[Registration, ...] = (
    MatcherRow(
        "kitasap open3d, coarse to fine",
        "five start headings, three distances, two layers, weights, verdict",
        lambda known: Open3dMatcher(
            PointMap(known.points, _SPACING_M), range_noise=known.laser_model.noise
        ),
    ),
    MatcherRow(
        "kitasap limit",
        "from the scan to pose, covariance and verdict",
        lambda known: LimitMatcher(
            known.walls,
            known.laser_model,
            FastMatcher(SurfelGrid.of(known.walls), known.laser_model),
        ),
    ),
    SurfelRow(),
)
"""Our rows, slowest first. Any object that keeps the protocol `Registration` may be added."""

"""The methods by name, each made ready for one known place and laser."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from experiments.paper import PAPER_ICP
from kitasap_sim.laser import LaserSpec
from kitasap_sim.places import Place, PlaceMap
from slam.lines import LineMap
from slam.localization import LineMatcher, Matcher, OdometryMatcher, Open3dMatcher, PaperMatcher
from slam.point_map import PointMap
from slam.range_noise import RangeNoise
from slam.se2 import SE2


@dataclass(frozen=True)
class KnownPlace:
    """What a robot is told beforehand: the true map at its laser's height, and the mounting."""

    place: Place
    laser: LaserSpec
    map_spacing_m: float

    @cached_property
    def T_base_laser(self) -> SE2:
        """The laser in the robot's frame."""
        return SE2(self.laser.mount_m[0], self.laser.mount_m[1], 0.0)

    @cached_property
    def point_map(self) -> PointMap:
        """The paper's database: points on all surfaces that the laser can see."""
        return PointMap(self._map.points_m(self.map_spacing_m), self.map_spacing_m)

    @cached_property
    def line_map(self) -> LineMap:
        """The laboratory's earlier database: the straight ones among the surfaces."""
        return LineMap(self._map.segments_m)

    @property
    def range_noise(self) -> RangeNoise | None:
        """What the laser's data sheet says of its noise; None where it is switched off."""
        return RangeNoise(self.laser.sigma_at_m) if self.laser.sigma_at_m else None

    @cached_property
    def _map(self) -> PlaceMap:
        return self.place.map_at(self.laser.mount_m[2])


METHODS: dict[str, Callable[[KnownPlace], Matcher]] = {
    "odometry": lambda known: OdometryMatcher(),
    "line": lambda known: LineMatcher(known.line_map),
    "paper": lambda known: PaperMatcher(known.point_map, PAPER_ICP),
    "open3d": lambda known: Open3dMatcher(known.point_map, range_noise=known.range_noise),
}
"""In the order of the paper's Section 1: what each brought over the one before."""


def checked_methods(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names as they are. Raises ValueError, naming those there are, if one is unknown."""
    for name in names:
        if name not in METHODS:
            raise ValueError(f"no method called '{name}'; there are: {', '.join(METHODS)}")
    if len(set(names)) != len(names) or not names:
        raise ValueError(f"name each method once, at least one: {', '.join(METHODS)}")
    return names

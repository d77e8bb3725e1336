"""The methods by name, each made ready for one known place and laser."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

from experiments.assumptions import assumed_laser, assumed_mount_sigma
from experiments.mapping_drive import made_surfaces
from experiments.paper import PAPER_ICP
from kitasap_sim.laser import LaserSpec
from kitasap_sim.place_map import PlaceMap
from kitasap_sim.places import Place
from slam.icp import CoarseToFineConfig
from slam.laser_model import LaserModel
from slam.lines import LineMap
from slam.localization import Localizer, LocalizerConfig
from slam.lost import Guard
from slam.matchers import (
    FastMatcher,
    LimitMatcher,
    LineMatcher,
    Matcher,
    OdometryMatcher,
    Open3dMatcher,
    PaperMatcher,
)
from slam.point_map import PointMap
from slam.relocalization import Relocalizer
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from slam.surface.surfaces import Surfaces
from slam.surface.surfel_grid import SurfelGrid
from slam.wheel_prior import WheelPrior


@dataclass(frozen=True)
class KnownPlace:
    """What a robot is told beforehand: a map, the true one at its laser's height, and the mounting.

    laser: as it is sold; what the simulated one really does may differ. is_made: the map is the one
    that the robot made itself on a drive before.
    """

    place: Place
    laser: LaserSpec
    map_spacing_m: float
    is_made: bool = False

    @cached_property
    def T_base_laser(self) -> SE2:
        """The laser in the robot's frame."""
        return SE2(self.laser.mount_m[0], self.laser.mount_m[1], 0.0)

    @cached_property
    def point_map(self) -> PointMap:
        """The paper's database: points on all surfaces that the laser can see."""
        if self.is_made:
            return PointMap(self._made.points(self.map_spacing_m), self.map_spacing_m)
        return PointMap(self._map.points_m(self.map_spacing_m), self.map_spacing_m)

    @cached_property
    def line_map(self) -> LineMap:
        """The laboratory's earlier database: the straight ones among the surfaces."""
        return LineMap(self._made.segments if self.is_made else self._map.segments_m)

    @cached_property
    def true_walls(self) -> SegmentMap:
        """The true surfaces, whatever map the robot has: what a scan can tell is told by them."""
        return SegmentMap.known(self._map.segments_m, is_one_sided=True)

    @cached_property
    def segment_map(self) -> SegmentMap:
        """The surfaces of the robot's map."""
        return self._made.walls() if self.is_made else self.true_walls

    @cached_property
    def surfel_grid(self) -> SurfelGrid:
        """The surface nearest to each spot."""
        return SurfelGrid.of(self.segment_map)

    @cached_property
    def relocalizer(self) -> Relocalizer:
        """The search of the whole map."""
        return Relocalizer.of(self.segment_map, self.surfel_grid, self.laser_model)

    @property
    def laser_model(self) -> LaserModel:
        """What is assumed of the laser."""
        return assumed_laser(self.laser.name)

    @cached_property
    def _made(self) -> Surfaces:
        return made_surfaces(self.place, self.laser)

    @cached_property
    def _map(self) -> PlaceMap:
        return self.place.map_at(self.laser.mount_m[2])


ON_SIMULATED_FLOORS = WheelPrior(slips_per_m=0.001)
"""Of the wheels of the simulated robot: in a kilometre and a half of drives they slipped nowhere by
more than 0.14 mm. On floors that nobody knows it is the default, ten times as often."""


def _config(*, deskew: bool = True, fuse: bool = True) -> LocalizerConfig:
    return LocalizerConfig(deskew=deskew, fuse=fuse, wheels=ON_SIMULATED_FLOORS)


@dataclass(frozen=True)
class Method:
    """How a method is made for a known place, and how its `Localizer` follows the robot."""

    matcher: Callable[[KnownPlace], Matcher]
    config: LocalizerConfig = field(default_factory=_config)
    tracker: Callable[[KnownPlace], Matcher] | None = None
    """The same where the prediction is never far off; None: no need of another."""
    finds_itself: bool = False
    """Whether it is given the search of the whole map, and says when it is lost."""

    def localizer(
        self,
        known: KnownPlace,
        believed: SE2 | None,
        *,
        is_tracking: bool = False,
        may_be_lost: bool = False,
    ) -> Localizer:
        """A localizer that believes to stand at a pose; is_tracking: and sees every scan;
        may_be_lost: and is guarded, if the method is one that finds itself. believed: None: one
        that has no idea where it is. Raises ValueError where such a one is not guarded."""
        make = (self.tracker if is_tracking else None) or self.matcher
        guard = Guard(known.relocalizer) if may_be_lost and self.finds_itself else None
        config = replace(self.config, mount_sigma=assumed_mount_sigma(known.laser))
        return Localizer(make(known), believed, known.T_base_laser, config, guard)


def _fast(known: KnownPlace) -> FastMatcher:
    return FastMatcher(known.surfel_grid, known.laser_model)


def _limit(known: KnownPlace) -> LimitMatcher:
    return LimitMatcher(known.segment_map, known.laser_model, _fast(known))


METHODS: dict[str, Method] = {
    "odometry": Method(lambda known: OdometryMatcher()),
    "line": Method(lambda known: LineMatcher(known.line_map)),
    # the paper knows no deskewing
    "paper": Method(lambda known: PaperMatcher(known.point_map, PAPER_ICP), _config(deskew=False)),
    "open3d": Method(
        lambda known: Open3dMatcher(known.point_map, range_noise=known.laser_model.noise),
        # five start headings take 0.3 s: for a scan that comes each 0.1 s, one must do
        tracker=lambda known: Open3dMatcher(
            known.point_map, CoarseToFineConfig(start_headings_rad=(0.0,)), known.laser_model.noise
        ),
        finds_itself=True,
    ),
    "fast": Method(_fast, finds_itself=True),
    "limit": Method(_limit, finds_itself=True),
    "limit_unfused": Method(_limit, _config(fuse=False)),
    "limit_skewed": Method(_limit, _config(deskew=False)),
}
"""In the order of the paper's Section 1: what each brought over the one before. The last two show
what `limit` would be without its fusion, and without its deskewing."""

DEFAULT_METHODS = ("paper", "open3d", "limit")


def checked_methods(names: tuple[str, ...], known: Iterable[str] = METHODS) -> tuple[str, ...]:
    """The names as they are. Raises ValueError, naming those known, if one is not among them."""
    for name in names:
        if name not in known:
            raise ValueError(f"no method called '{name}'; there are: {', '.join(known)}")
    if len(set(names)) != len(names) or not names:
        raise ValueError(f"name each method once, at least one: {', '.join(known)}")
    return names

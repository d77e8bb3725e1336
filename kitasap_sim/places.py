"""Places: MJCF worlds for the robot, their free space, and their true map at the laser's height."""

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from kitasap_sim import furniture, names
from kitasap_sim.facing import facing_out
from kitasap_sim.free_space import (
    Grid,
    NoRoomError,
    bared,
    flooded,
    largest_room,
    pulled_straight,
    roomiest_cell,
    steps_to,
    touches_border,
    way_down,
    widened,
)
from kitasap_sim.geometry import (
    cuts_between,
    is_seen,
    is_within,
    points_on,
    slice_at,
    static_triangles,
    visible_runs,
)
from kitasap_sim.place_digests import digest_of, shape_digest_of
from kitasap_sim.place_files import place_path
from kitasap_sim.place_map import PlaceMap
from kitasap_sim.place_reading import compiled_place, read_place
from kitasap_sim.place_sites import start_site, track_sites
from kitasap_sim.robot import KITASAP2, SWEPT_HEIGHTS_M

_MAP_CELL_M = 0.005
_FREE_CELL_M = 0.025
_TREMBLE_M = 0.001
"""Chosen: beams leave their plane by micrometres at rest, by tenths of a millimetre on a drive."""
_FEW_POINTS = 16
_MAX_CELLS_ALONG = 3000
"""A large place gets coarser cells rather than gigabytes of them."""
_FARTHEST_M = 10_000.0
"""Chosen: a town; MuJoCo calls positions unstable that are far beyond."""


class Place:
    """One MJCF world: a name out of `place_names()`, or the path of any MJCF file.

    Expected of a file: static geoms, a floor at z = 0 or none (one is added), and, if it is to
    say where the robot starts, a site `start` whose x axis is the robot's.
    is_file: it was read from a file, not made by a program.
    Raises ValueError, in one line, if there is no such place or it cannot be used.
    """

    def __init__(self, name_or_path: str | Path) -> None:
        self.name = str(name_or_path)
        self.path = place_path(self.name)
        self.is_file = True
        self._take(read_place(self.path, self.name))

    @classmethod
    def of_mjcf(cls, spec: mujoco.MjSpec, name: str) -> "Place":
        """The place that a specification describes, as a file would: for worlds made by a program.

        Raises ValueError, in one line, if it cannot be used.
        """
        place = cls.__new__(cls)
        place.name, place.path, place.is_file = name, Path(name), False
        place._take(spec)
        return place

    def __deepcopy__(self, memo: dict[int, object]) -> "Place":
        return self  # nobody changes it

    def __reduce__(self) -> tuple[Any, ...]:
        """For another process: it reads the file again; of what a program made, seven digits."""
        if self.is_file:
            return Place, (self.name,)
        return _remade, (self._spec.to_xml(), self.name, self.path, self.start)

    def _take(self, spec: mujoco.MjSpec) -> None:
        """Makes this the place's world. Raises ValueError if it cannot be used."""
        self._spec = spec
        self.model = compiled_place(self._spec.copy(), self.name)
        try:
            solids = static_triangles(self.model, seen_only=False)
        except ValueError as error:
            raise ValueError(f"place {self.name}: {error}") from None
        self._solid = list(solids.values())
        self._seen = [solid for geom, solid in solids.items() if is_seen(self.model, geom)]
        ends_m = np.abs(self._swept)
        if not ends_m.max(initial=0.0) < _FARTHEST_M:
            raise ValueError(
                f"place {self.name} reaches farther than {_FARTHEST_M / 1000:g} km from its origin"
            )
        if not len(self._swept):
            raise ValueError(
                f"place {self.name} has nothing between {SWEPT_HEIGHTS_M[0]} and "
                f"{SWEPT_HEIGHTS_M[1]} m above its floor: a laser would see nothing"
            )

    @cached_property
    def _swept(self) -> np.ndarray:
        """(S, 2, 2) outlines of all that the robot could touch [m]."""
        return cuts_between(self._solid, *SWEPT_HEIGHTS_M)

    def mjcf(self) -> mujoco.MjSpec:
        """The world as an editable specification of its own, the robot not in it."""
        return self._spec.copy()

    def movable(self, height_m: float) -> str:
        """The name of a piece of furniture that a passer-by may push aside; a chair, if it can be.

        Free-standing, at most 0.8 m wide and deep, and seen by beams at the height.
        Raises ValueError if there is none.
        """
        return furniture.movable(self._pieces, height_m, self.name)

    def pushed(self, name: str, distance_m: float, rng: np.random.Generator) -> tuple[float, float]:
        """(dx, dy) of that length by which the piece can be pushed, the direction drawn [m].

        It runs into nothing the robot could touch, and leaves the start and the track clear.
        Raises ValueError if there is no such piece, or no such direction.
        """
        kept_free_m = np.concatenate([self.start[None, :2], self.track_m])
        return furniture.pushed(self._pieces, name, distance_m, kept_free_m, rng, self.name)

    def rearranged(self, moved_m: Mapping[str, tuple[float, float]]) -> "Place":
        """The same place and start with some pieces moved by (dx, dy) [m].

        Pieces are the named frames, bodies and geoms that stand in the worldbody itself.
        Raises ValueError, naming those there are, for an unknown piece.
        """
        spec = self.mjcf()
        furniture.shift(spec, moved_m, self.name)
        place = Place.of_mjcf(spec, self.name)
        place.path, place.start = self.path, self.start
        return place

    @cached_property
    def _pieces(self) -> dict[str, furniture.Piece]:
        return furniture.pieces(self._spec)

    @cached_property
    def digest(self) -> str:
        """Of the compiled place: what its file includes and its meshes count as well."""
        return digest_of(self.model)

    @cached_property
    def shape_digest(self) -> str:
        """Of what stands where, to a micrometre."""
        return shape_digest_of(self.model)

    @cached_property
    def solid_bounds_m(self) -> np.ndarray:
        """(2, 2) lower and upper corner of all that stands on the floor [m]."""
        ends = self._swept.reshape(-1, 2)
        return np.array([ends.min(axis=0), ends.max(axis=0)])

    @cached_property
    def bounds_m(self) -> np.ndarray:
        """(2, 2) the same of all that stands on the floor, and of the start [m]."""
        ends = self.solid_bounds_m
        if self._start_site is not None:
            ends = np.concatenate([ends, self._start_site[None, :2]])
        return np.array([ends.min(axis=0), ends.max(axis=0)])

    @cached_property
    def start(self) -> np.ndarray:
        """(3,) x, y [m] and heading [rad] of the site `start`, or of the roomiest spot."""
        if self._start_site is not None:
            return self._start_site
        return np.array([*self._roomiest_spot(), 0.0])

    @cached_property
    def _start_site(self) -> np.ndarray | None:
        return start_site(self.model)

    @cached_property
    def track_m(self) -> np.ndarray:
        """(T, 2) corners of the place's scripted track: its sites `track_...` by name [m]."""
        return track_sites(self.model)

    @cached_property
    def has_floor(self) -> bool:
        """Whether something carries the robot at z = 0 where it starts."""
        data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, data)
        geom = np.zeros(1, dtype=np.int32)
        above = np.array([*self.start[:2], 0.005])
        down = np.array([0.0, 0.0, -1.0])
        depth_m = mujoco.mj_ray(self.model, data, above, down, None, 1, -1, geom, None)
        return bool(0 <= depth_m < 0.01)

    def map_at(self, height_m: float) -> PlaceMap:
        """The true map at a height: the surfaces that border on space reachable from the start.

        The backs of walls and what lies inside other solids are left out: no beam gets there.
        """
        outlines = [facing_out(slice_at(solid, height_m)) for solid in self._seen]
        # beams that tremble pass under a solid that ends at their very height
        covers = [
            solid[:, :, 2].min() < height_m - _TREMBLE_M
            and solid[:, :, 2].max() > height_m + _TREMBLE_M
            for solid in self._seen
        ]
        segments = bared(outlines, covers)
        if not len(segments):
            raise ValueError(f"place {self.name} has nothing to see at {height_m} m height")
        bounds_m = np.array([segments.min(axis=(0, 1)), segments.max(axis=(0, 1))])
        grid = Grid.over(bounds_m, self._cell_m(bounds_m, _MAP_CELL_M), margin_m=0.05)
        lit = flooded(~grid.walls(segments), grid.cells(self.free_centres_m[::50]))
        points, owners = points_on(segments, grid.cell_m / 2)
        # within 1.5 cm of a lit cell: beams see into crevices that are narrower than a cell
        is_visible = widened(lit, 3.0)[tuple(grid.cells(points).T)]
        return PlaceMap(height_m, visible_runs(points, owners, is_visible))

    @cached_property
    def free_centres_m(self) -> np.ndarray:
        """(K, 2) middles of the cells in which the robot may stand, whatever its heading [m].

        All of them can be reached from the start by driving.
        """
        return self._grid.centres_m(np.argwhere(self._free))

    @property
    def free_cell_m(self) -> float:
        """Side of the cells of `free_centres_m` [m]."""
        return self._grid.cell_m

    def is_free(self, points_m: np.ndarray) -> np.ndarray:
        """(K,) whether the robot may stand with its axle's middle at each point (K, 2) [m]."""
        points_m = np.atleast_2d(points_m)
        upper_m = self._grid.origin_m + np.array(self._grid.shape) * self._grid.cell_m
        is_inside = ((points_m >= self._grid.origin_m) & (points_m < upper_m)).all(axis=1)
        return np.asarray(is_inside & self._free[tuple(self._grid.cells(points_m).T)])

    def is_way_free(self, start_m: np.ndarray, end_m: np.ndarray) -> bool:
        """Whether the robot may move in a straight line between two points (2,) [m]."""
        way = np.stack([start_m[:2], end_m[:2]])[None]
        points, _ = points_on(way, self._grid.cell_m / 2)
        return bool(self.is_free(points).all())

    def _may_be_free(self, start_m: np.ndarray, ends_m: np.ndarray) -> np.ndarray:
        """(K,) False where a few of the points of `is_way_free` tell that a way is not."""
        along_m = ends_m - start_m
        lengths_m = np.hypot(*along_m.T)
        last = np.maximum(np.ceil(lengths_m / (self._grid.cell_m / 2)), 1.0)
        share = np.floor(last[:, None] * np.linspace(0.0, 1.0, _FEW_POINTS)) / last[:, None]
        points = start_m + share[:, :, None] * along_m[:, None]
        is_free = self.is_free(points.reshape(-1, 2)).reshape(-1, _FEW_POINTS)
        return np.asarray(is_free.all(axis=1))

    def way(self, start_m: np.ndarray, end_m: np.ndarray) -> np.ndarray:
        """(W, 2) corners of a way between two free points (2,), straight where it can be [m].

        Raises ValueError if either point is not free.
        """
        for point_m in (start_m, end_m):
            if not self.is_free(point_m)[0]:
                raise ValueError(
                    f"place {self.name}: something is in the robot's way at "
                    f"({point_m[0]:.2f}, {point_m[1]:.2f})"
                )
        if self.is_way_free(start_m, end_m):
            return np.array([start_m, end_m])
        goal, here = self._grid.cells(np.array([end_m, start_m]))
        cells = way_down(steps_to(self._free, goal[None], until=here), here)
        points = np.concatenate([[start_m], self._grid.centres_m(cells[1:-1]), [end_m]])
        return pulled_straight(points, self.is_way_free, self._may_be_free)

    def steps_to(self, spot_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Cells, to the four sides, from each to a free spot (2,) [m], -1 where no way leads there;
        the origin (2,) and the side of the cells [m]. Raises ValueError if the spot is not free."""
        if not self.is_free(spot_m)[0]:
            raise ValueError(f"place {self.name}: ({spot_m[0]:.2f}, {spot_m[1]:.2f}) is not free")
        steps = steps_to(self._free, self._grid.cells(spot_m[None]))
        return steps, self._grid.origin_m, self._grid.cell_m

    def open_floor(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Mask of the cells that are floor connected with the start, wide enough for a robot or not,
        walls as thin as they may be left out; the origin (2,) and the side of the cells [m]."""
        is_open = flooded(~self._blocked, self._grid.cells(self.start[None, :2]))
        return is_open, self._grid.origin_m, self._grid.cell_m

    def draw_free_pose(self, rng: np.random.Generator) -> np.ndarray:
        """(3,) x, y [m] and heading [rad], uniform over the free space and all headings."""
        centre = self.free_centres_m[rng.integers(len(self.free_centres_m))]
        x, y = centre + rng.uniform(-0.5, 0.5, 2) * self._grid.cell_m
        return np.array([x, y, rng.uniform(-np.pi, np.pi)])

    @cached_property
    def _grid(self) -> Grid:
        return Grid.over(self.bounds_m, self._cell_m(self.bounds_m, _FREE_CELL_M), margin_m=0.1)

    @cached_property
    def _blocked(self) -> np.ndarray:
        return self._grid.walls(self._swept)

    @cached_property
    def _free(self) -> np.ndarray:
        """Mask over the grid: room for the upright cylinder around the robot, start's part."""
        clearance_cells = KITASAP2.radius_m / self._grid.cell_m + 1.0
        is_open = ~widened(self._blocked, clearance_cells)
        free = flooded(is_open, self._grid.cells(self.start[None, :2]))
        if free.any():
            return free
        if self._start_site is None:
            raise self._no_room()
        x, y, _ = self._start_site
        raise ValueError(
            f"place {self.name}: its start ({x:.2f}, {y:.2f}) has less than "
            f"{KITASAP2.radius_m} m of room around it"
        )

    def _roomiest_spot(self) -> np.ndarray:
        """(2,) the spot of the largest room that is farthest from its walls [m]."""
        left, is_first = ~self._blocked, True
        while (room := largest_room(left)).any():
            spot_m = self._grid.centres_m(roomiest_cell(room))
            # of a thick wall only the outline is blocked: its inside may be the largest room
            if not is_within(self._solid, spot_m, *SWEPT_HEIGHTS_M):
                if touches_border(room) and not is_first:
                    break
                return spot_m
            left, is_first = left & ~room, False
        raise self._no_room()

    def _no_room(self) -> NoRoomError:
        return NoRoomError(
            f"place {self.name} has no site '{names.START}', and no spot was found within its"
            f" walls with {KITASAP2.radius_m} m of room around it: add the site (are the walls"
            " closed?)"
        )

    def _cell_m(self, bounds_m: np.ndarray, finest_m: float) -> float:
        return max(finest_m, float((bounds_m[1] - bounds_m[0]).max()) / _MAX_CELLS_ALONG)


def _remade(mjcf: str, name: str, path: Path, start: np.ndarray) -> Place:
    place = Place.of_mjcf(mujoco.MjSpec.from_string(mjcf), name)
    place.path, place.start = path, start
    return place

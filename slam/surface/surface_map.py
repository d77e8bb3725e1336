"""A map of the surfaces around the robot, learnt from the points of its last scans as it drives.

Its points are faced: x, y [m] and the direction [rad] in which the surface faces, since the two
sides of a wall are two surfaces. Without that, a scan in a doorway lies between them: 0.1 m were
lost at each door of 12 cm thick walls.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray, lengthened
from slam.beams import Beams
from slam.kernels import surface_map as kernels
from slam.kernels import surface_matching as matching
from slam.kernels import surface_search as search
from slam.kernels.facings import all_moved_in_place, faced_ends_into, facings_into, moved_into
from slam.se2 import SE2
from slam.surface.surface_match import SurfaceMatch

_FIRST_ENTRIES = 1024
"""Chosen: a room's. With eight times as many, which growing maps copy less often, memory grew by 5 MB more over a log,
and no time was saved: what was freed before has to be cleared."""
_NEIGHBOURS_M = 0.2
"""Chosen: so near a point, others are on its surface; short of a wall's next corner, and long enough
that a noise of 4 cm turns the surface by a few degrees only."""


def faced(points: FloatArray, seen_from: FloatArray, *, is_lone_told: bool = True) -> FloatArray:
    """(N, 3) points (N, 2) of a scan in their order [m], as faced points; seen_from: (2,) [m].

    is_lone_told: a point without neighbours, of which nothing is known, is taken to face the laser;
    else only where beams are too far apart for any.
    """
    return faced_and_variances(points, seen_from, is_lone_told=is_lone_told)[0]


def faced_ends(beams: Beams, range_m: float, blocked_m: float, least: int) -> FloatArray:
    """(N, 3) the ends of beams that are less than a range away [m], as faced points; none, where fewer than so
    many are farther than blocked_m: something stands before the laser."""
    out = np.empty((len(beams.ranges_m), 3))
    count = faced_ends_into(
        beams.origins_m, beams.directions, beams.ranges_m, range_m, beams.middle_m, blocked_m, least,
        _NEIGHBOURS_M, out,
    )  # fmt: skip
    return out[:count]


def faced_and_variances(
    points: FloatArray, seen_from: FloatArray, *, is_lone_told: bool = True
) -> tuple[FloatArray, FloatArray]:
    """`faced`, and (N,) [rad2] how wrong each facing is, by how its neighbours scatter; inf: lone."""
    out, variances = np.empty((len(points), 3)), np.empty(len(points))
    facings_into(points, seen_from, _NEIGHBOURS_M, is_lone_told, out, variances)
    return out, variances


def moved(T: SE2, points: FloatArray) -> FloatArray:
    """(N, 3) faced points in another frame."""
    out = np.empty(points.shape)
    moved_into(points, T.x, T.y, T.theta, out)
    return out


def all_moved(poses: FloatArray, scans: Sequence[FloatArray]) -> FloatArray:
    """(N, 3) the faced points of scans at poses (K, 3), one after the other."""
    if len(poses) != len(scans):
        raise ValueError(f"each scan is moved by a pose of its own: {len(scans)}, not {len(poses)}")
    out = np.concatenate(scans) if scans else np.empty((0, 3))
    all_moved_in_place(poses, np.array([len(points) for points in scans], np.int64), out)
    return out


_FARTHEST_SEARCHED_M = 100.0
"""Chosen: farther than lasers indoors; a reflection from 10 km would take 40 GB."""


@dataclass(frozen=True)
class SurfaceMapConfig:
    """How a `SurfaceMap` learns and matches.

    cells_m: sides of its cells, coarse to fine, each a whole multiple of the next (ValueError): who stays in a
    fine cell stays in the coarse one; a surface is what a cell and its neighbours hold.
    scales_m, finest: stage by stage, the residual [m] at which a point counts a quarter, and the
    finest cells looked at. sigma_m: of a point across its surface; chosen: noise of the usual laser
    and what a straight piece leaves of a real wall. share: of a scan's information that counts: its
    points are on few walls, and their errors go together; pull: the same where pose and odometry
    are weighed. max_points: of a scan. chosen, both, on four logs and a ring of corridors.
    """

    cells_m: tuple[float, ...] = (1.2, 0.4, 0.1)
    scales_m: tuple[float, ...] = (0.3, 0.0)
    finest: tuple[int, ...] = (1, 2)
    sigma_m: float = 0.02
    share: float = 0.05
    pull: float = 0.4
    max_points: int = 720
    max_steps: int = 10

    def __post_init__(self) -> None:
        shares = [one / other for one, other in pairwise(self.cells_m)]
        if any(round(share) < 1 or abs(share - round(share)) > 1e-9 for share in shares):
            raise ValueError(
                "cells_m must go from coarse to fine, each side a whole multiple of the next [m], not"
                f" {self.cells_m}"
            )


class SurfaceMap:
    """Surfaces of points that come and go; on a torus of cells, so that it may roll along.

    It takes memory for the cells with points in them or beside them, and for no others.
    """

    def __init__(self, config: SurfaceMapConfig | None = None) -> None:
        self.config = config or SurfaceMapConfig()
        levels, side = len(self.config.cells_m), kernels.SIDE
        self._index: NDArray[np.int32] = np.zeros((levels, side * side), np.int32)
        count = _FIRST_ENTRIES
        self._heads: NDArray[np.int32] = np.zeros((count, kernels.HEAD), np.int32)
        self._sums: NDArray[np.float32] = np.zeros((count, kernels.SIDES, 6), np.float32)
        self._surfels: FloatArray = np.zeros((count, kernels.SIDES, kernels.SURFEL))
        # the lowest are the next
        self._free = np.arange(count, -1, -1, dtype=np.int32) - 1
        self._free[-2:] = kernels.NONE, count - 1
        self._cells_m = np.array(self.config.cells_m)
        self._stages = np.array(self.config.finest), np.array(self.config.scales_m)

    @property
    def memory_bytes(self) -> int:
        """What the cells take."""
        arrays = (self._index, self._heads, self._sums, self._surfels, self._free)
        return sum(array.nbytes for array in arrays)

    def add(self, points_map: FloatArray) -> None:
        """Takes up faced points (N, 3), map frame."""
        self._put(points_map, 1)

    def remove(self, points_map: FloatArray) -> None:
        """Takes out faced points (N, 3) that were added before."""
        self._put(points_map, -1)

    def clear(self) -> None:
        """Takes out all points."""
        kernels.clear(self._index, self._heads, self._free)

    def match(
        self,
        points_base: FloatArray,
        T_start: SE2,
        T_predicted: SE2,
        odometry: FloatArray,
        trust: float = math.inf,
        pull: float | None = None,
    ) -> SurfaceMatch:
        """The pose near T_start at which faced points (N, 3) lie on the surfaces and odometry agrees.

        odometry: (3, 3) information of T_predicted; zeros where nothing is known. trust: normalised
        innovation squared at which it counts a quarter, and ever less beyond. pull: None: as
        configured.
        """
        config, points = self.config, self.thinned(points_base)
        pull = config.pull if pull is None else pull
        information, joined = np.empty((3, 3)), np.empty((3, 3))
        found = matching.align(
            self._index, self._heads, self._sums, self._surfels, self._cells_m, points,
            config.sigma_m**2, pull, config.share, *self._stages, T_start.x, T_start.y, T_start.theta,
            T_predicted.x, T_predicted.y, T_predicted.theta, odometry, trust, config.max_steps,
            information, joined,
        )  # fmt: skip
        return _match_of(len(points), found, information, joined, pull / config.share)

    def match_alone(self, points_base: FloatArray, T_start: SE2) -> SurfaceMatch:
        """The match of faced points (N, 3) near T_start that odometry tells nothing of."""
        return self.match(points_base, T_start, T_start, np.zeros((3, 3)))

    def best_alone(self, points_base: FloatArray, starts: Sequence[SE2]) -> SurfaceMatch:
        """The best of the matches of faced points (N, 3) near each of at least one start, that odometry tells
        nothing of."""
        config, points = self.config, self.thinned(points_base)
        information, joined = np.empty((3, 3)), np.empty((3, 3))
        found = matching.align_alone(
            self._index, self._heads, self._sums, self._surfels, self._cells_m, points,
            config.sigma_m**2, config.pull, config.share, *self._stages,
            np.array([(start.x, start.y, start.theta) for start in starts]), config.max_steps,
            information, joined,
        )  # fmt: skip
        return _match_of(len(points), found, information, joined, config.pull / config.share)

    def searched(
        self,
        points_base: FloatArray,
        T_middle: SE2,
        reach_m: float,
        reach_rad: float,
        level: int = 1,
        most: int = 3,
    ) -> list[SE2]:
        """The poses around T_middle at which most points fall on what is known, best first.

        Every half cell of a level and 2 degrees; so many at most, none beside a better one
        (correlative scan matching: Olson, ICRA 2009).
        """
        cell_m = self.config.cells_m[level]
        # as large as the points reach is the table in which they are looked up
        is_near = np.hypot(points_base[:, 0], points_base[:, 1]) <= _FARTHEST_SEARCHED_M
        points = self.thinned(points_base[is_near], 80)
        steps = np.arange(-math.ceil(2.0 * reach_m / cell_m), math.ceil(2.0 * reach_m / cell_m) + 1)
        x = np.asarray(T_middle.x + steps * cell_m / 2.0, dtype=np.float64)
        y = np.asarray(T_middle.y + steps * cell_m / 2.0, dtype=np.float64)
        turns = np.radians(2.0) * np.arange(
            -math.ceil(reach_rad / np.radians(2.0)), math.ceil(reach_rad / np.radians(2.0)) + 1
        )
        counts = np.empty((len(turns), len(x), len(y)), np.int32)
        search.count_on_walls(
            self._heads, self._sums, level, cell_m, points, float(x[0]), float(y[0]),
            T_middle.theta + turns, counts,
        )  # fmt: skip
        peaks = np.empty((most, 3), np.int64)
        # one and a half cells, and eight degrees, to either side
        count = search.peaks_into(counts, (4, 3, 3), peaks)
        return [
            SE2(float(x[u]), float(y[v]), T_middle.theta + float(turns[k]))
            for k, u, v in peaks[:count].tolist()
        ]

    def thinned(self, points: FloatArray, most: int | None = None) -> FloatArray:
        """At most so many of points (N, ...), evenly in their order; if there are no more, these themselves."""
        most = self.config.max_points if most is None else most
        if len(points) <= most:
            return points
        return np.ascontiguousarray(points[:: -(-len(points) // most)])

    def _put(self, points: FloatArray, sign: int) -> None:
        done = np.zeros(len(self._cells_m), np.int64)
        while not kernels.put(
            self._index, self._heads, self._free, self._sums, points, done, sign, self._cells_m
        ):
            self._grow()

    def _grow(self) -> None:
        """Twice as many entries."""
        count, free = len(self._heads), int(self._free[-1])
        self._heads, self._sums = lengthened(self._heads, count), lengthened(self._sums, count)
        self._surfels = lengthened(self._surfels, count)
        added = np.arange(2 * count - 1, count - 1, -1)
        left, rest = self._free[:free], np.zeros(count - free)
        self._free = np.concatenate([added, left, rest, [count + free]]).astype(np.int32)


def _match_of(
    count: int,
    found: tuple[float, float, float, float, float, float],
    information: FloatArray,
    joined: FloatArray,
    gain: float,
) -> SurfaceMatch:
    """The match of so many points, as `align` found it."""
    x, y, theta, seen, fitting, cost = found
    most = max(count, 1)
    return SurfaceMatch(
        SE2(x, y, theta), information, joined, seen / most, fitting / max(seen, 1.0),
        (cost + count - seen) / most, gain,
    )  # fmt: skip

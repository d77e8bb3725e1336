"""A map against the true one: how far its points lie from real surfaces, and what it lacks."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from kitasap_sim.laser import LaserSpec
from kitasap_sim.place_map import PlaceMap
from slam.arrays import BoolArray, FloatArray
from slam.beams import Beams
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap

NEAR_M = 0.05
"""How far a point of the map may lie from a true surface, and the other way round."""
_SPACING_M = 0.01
_HIT_M = 0.02
"""Chosen: as much of a surface as a beam that hits it is said to have seen, to either side."""
_LEAST_VIEWS = 2
"""Chosen: of a surface that a map is to have, from poses a second apart."""
_VIEW_S = 1.0


@dataclass(frozen=True)
class MapQuality:
    """rmse_m: of all points of the map from the true surfaces [m]. precision: share of them within
    NEAR_M; recall: of the true surfaces that the laser could see on the drive, the share within
    NEAR_M of a point."""

    rmse_m: float
    precision: float
    recall: float


@dataclass(frozen=True, eq=False)
class TrueMap:
    """The true surfaces at the laser's height, for a laser that sees no farther than its spec."""

    place_map: PlaceMap
    laser: LaserSpec

    @cached_property
    def _points(self) -> FloatArray:
        return self.place_map.points_m(_SPACING_M)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._points)

    @cached_property
    def _walls(self) -> SegmentMap:
        return SegmentMap.known(self.place_map.segments_m, is_one_sided=True)

    def seen_from(self, times_s: FloatArray, poses: FloatArray) -> BoolArray:
        """(K,) which of the surfaces' points the laser could see from poses (N, 3) at times (N,)."""
        spec, views = self.laser, np.zeros(len(self._points), dtype=np.int64)
        at_m = np.tile(spec.mount_m[:2], (spec.beam_count, 1))
        beams = Beams(at_m, spec.angles_rad, np.zeros(spec.beam_count))
        last_s = -math.inf
        for time_s, pose in zip(times_s, poses, strict=True):
            if time_s - last_s < _VIEW_S:
                continue
            last_s = time_s
            T_map_base = SE2.from_array(pose)
            ranges_m, _ = self._walls.ranges(beams, T_map_base, spec.range_max_m)
            is_hit = np.isfinite(ranges_m) & (ranges_m < spec.range_max_m)
            ends_m = at_m[is_hit] + ranges_m[is_hit, np.newaxis] * beams.directions[is_hit]
            if len(ends_m):
                hits = cKDTree(T_map_base @ ends_m)
                off_m, _ = hits.query(self._points, distance_upper_bound=_HIT_M)
                views += np.isfinite(off_m)
        return np.asarray(views >= _LEAST_VIEWS)

    def quality(self, points_m: FloatArray, is_seen: BoolArray) -> MapQuality:
        """Of a map's points (N, 2) in the true frame; is_seen: as from `seen_from`."""
        if len(points_m) == 0:
            return MapQuality(math.nan, 0.0, 0.0)
        off_m = self.off_m(points_m)
        missed_m, _ = cKDTree(points_m).query(self._points[is_seen])
        return MapQuality(
            float(np.sqrt(np.mean(off_m**2))),
            float(np.mean(off_m <= NEAR_M)),
            float(np.mean(missed_m <= NEAR_M)),
        )

    def off_m(self, points_m: FloatArray) -> FloatArray:
        """(N,) how far each point of a map (N, 2) lies from the nearest true surface [m]."""
        off_m, _ = self._tree.query(points_m)
        return np.asarray(off_m)

    def is_wrong(self, points_m: FloatArray) -> BoolArray:
        """(N,) which points of a map (N, 2) lie off every true surface."""
        return self.off_m(points_m) > NEAR_M

    def missed_m(self, points_m: FloatArray, is_seen: BoolArray) -> FloatArray:
        """(M, 2) points of the true surfaces that could be seen and that a map (N, 2) lacks [m]."""
        seen_m = self._points[is_seen]
        if len(points_m) == 0 or len(seen_m) == 0:
            return seen_m
        away_m, _ = cKDTree(points_m).query(seen_m)
        return seen_m[away_m > NEAR_M]

"""The point map: the paper's database of map points."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from slam.arrays import FloatArray, checked_points, frozen_array


@dataclass(frozen=True, eq=False)
class Pairs:
    """The related points of one step: scan_ids (P,) and map_ids (P,), in the order of the scan."""

    scan_ids: NDArray[np.intp]
    map_ids: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.scan_ids)


class PointMap:
    """Points of the map, (K, 2) [m], map frame; grows by `integrate`. The one mutable type.

    The points given first are kept as they are; `spacing_m` is the least distance at which
    `integrate` adds others to them. `version` counts the changes, for caches made of the points.
    Raises ValueError if the points are not finite (K, 2) or the spacing is not above 0.
    """

    def __init__(self, points: ArrayLike, spacing_m: float) -> None:
        if not (math.isfinite(spacing_m) and spacing_m > 0.0):
            raise ValueError(f"spacing_m must be above 0, not {spacing_m}")
        self.spacing_m = float(spacing_m)
        self.version = 0
        self._points = frozen_array(checked_points(points, "map points"), (None, 2), "map points")
        self._tree: cKDTree | None = None

    def __len__(self) -> int:
        return len(self._points)

    @property
    def points(self) -> FloatArray:
        """(K, 2) [m], map frame, read-only."""
        return self._points

    def nearest(self, points_map: ArrayLike, max_distance_m: float) -> Pairs:
        """Each point paired with its nearest map point, where one lies within reach.

        points_map: (N, 2) [m], map frame. An empty map, or no point within reach, gives no pairs.
        max_distance_m may be inf. Raises ValueError if points_map is not finite (N, 2) or the
        distance not above 0.
        Paper, Section 3.2, step 3; the distance limit is ours.
        """
        points = checked_points(points_map, "points_map")
        if not max_distance_m > 0.0:
            raise ValueError(f"max_distance_m must be above 0, not {max_distance_m}")
        if len(self) == 0 or len(points) == 0:
            return Pairs(np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp))
        distances_m, map_ids = self._search_tree().query(
            points, distance_upper_bound=max_distance_m
        )
        scan_ids = np.flatnonzero(np.isfinite(distances_m))
        return Pairs(scan_ids, np.asarray(map_ids)[scan_ids])

    def integrate(self, points_map: ArrayLike) -> None:
        """Adds the points, in their order, that have no map point nearer than the spacing.

        Paper, Section 3.3, step 8 (the update of the database); the thinning is ours: without it
        the map grows by every scan of a robot that stands still.
        Raises ValueError if points_map is not finite (N, 2).
        """
        points = checked_points(points_map, "points_map")
        known = self.nearest(points, self.spacing_m)
        is_new = np.ones(len(points), dtype=bool)
        is_new[known.scan_ids] = False
        added = thinned(points[is_new], self.spacing_m)
        if len(added) == 0:
            return
        self._points = frozen_array(np.vstack([self._points, added]), (None, 2), "map points")
        self._tree = None
        self.version += 1

    def _search_tree(self) -> cKDTree:
        if self._tree is None:
            self._tree = cKDTree(self._points)
        return self._tree


def thinned(points: FloatArray, spacing_m: float) -> FloatArray:
    """The points left when each, in order, drops all later ones nearer than the spacing."""
    if len(points) == 0:
        return points
    is_kept = np.ones(len(points), dtype=bool)
    pairs = cKDTree(points).query_pairs(spacing_m, output_type="ndarray")
    first, later = pairs.min(axis=1, initial=len(points)), pairs.max(axis=1, initial=0)
    too_near = np.hypot(*(points[first] - points[later]).T) < spacing_m
    first, later = first[too_near], later[too_near]
    order = np.argsort(first, kind="stable")
    starts = np.searchsorted(first[order], np.arange(len(points) + 1))
    for i in range(len(points)):
        if is_kept[i]:
            is_kept[later[order[starts[i] : starts[i + 1]]]] = False
    return points[is_kept]

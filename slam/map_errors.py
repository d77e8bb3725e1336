"""What the errors of a map that was made of scans do to a match, however good the laser is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.beams import Beams
from slam.laser_model import LaserModel
from slam.range_noise import RangeNoise
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from slam.surface.surface_map import faced, faced_and_variances
from slam.surface.surfel_grid import SurfelGrid

_SHARED_M, _SHARED = 0.3, 0.3
"""Chosen: pieces of a wall are fitted to the points 15 cm around, so that those 30 cm apart have no
point in common; within, so much of their roughness is error of their place."""
_PATCH_M, _PATCHES = 1.0, 1.5
"""Chosen: what is wrong with a map (a door, both sides of a thin wall taken for one) is seldom wider;
a variance estimated of a dozen patches is as often too small as too large, and this evens it."""
_LEVER = 0.9
"""Chosen: of a patch left out; without all of the only one across a direction nothing is left."""
_OPEN = np.diag([1e-4, 1e-4, 0.025])
"""Information that is none: 100 m, a full turn."""
_FLATTEST = 0.3**2
_KERNEL = 6.0
"""As in `kernels.surfel_matching`."""
_MIN_COSINE = 0.02
_FACING_COSINE = 0.7
"""Chosen: halfway between a surface and one across it."""
_ROOT_TWO_PI = math.sqrt(2.0 * math.pi)


@dataclass(frozen=True, eq=False)
class MetSurfaces:
    """Where a scan met surfaces, seen from the base.

    points: (N, 2) [m]; normals: (N, 2); residuals_m: (N,) along the normal; sigma_m: (N,) of the
    surface across itself; weights: (N,) [1/m2] with which each residual held the pose.
    """

    points: FloatArray
    normals: FloatArray
    residuals_m: FloatArray
    sigma_m: FloatArray
    weights: FloatArray

    @staticmethod
    def of_points(
        beams: Beams, grid: SurfelGrid, noise: RangeNoise, T_map_base: SE2
    ) -> MetSurfaces:
        """As `match_surfels` sees them: each point by the surface of its cell."""
        points, rows = beams.points, len(grid.surfels) // grid.columns
        at = np.floor((T_map_base @ points - grid.origin_m) / grid.cell_m)
        is_on = np.all((at >= 0.0) & (at < [grid.columns, rows]), axis=1)
        column, row = np.where(is_on[:, np.newaxis], at, 0.0).astype(np.int64).T
        surfels = grid.surfels[row * grid.columns + column].astype(np.float64)
        points, surfels = points[is_on], surfels[is_on]
        points, surfels = points[surfels[:, 3] > 0.0], surfels[surfels[:, 3] > 0.0]
        normals = _turned(surfels[:, :2], T_map_base.theta)
        along = points - beams.middle_m
        ranges_m = np.hypot(*along.T)
        cosines = np.sum(normals * along, axis=1) / np.maximum(ranges_m, 1e-9)
        residuals_m = np.sum(surfels[:, :2] * (T_map_base @ points), axis=1) - surfels[:, 2]
        across = noise.sigma_m(ranges_m) ** 2 * np.maximum(cosines**2, _FLATTEST)
        variances = across + surfels[:, 3] ** 2
        limits = _KERNEL * variances
        weights = (limits / (limits + residuals_m**2)) ** 2 / variances
        if grid.is_one_sided:
            weights = np.where(cosines > 0.0, 0.0, weights)
        return MetSurfaces(points, normals, residuals_m, surfels[:, 3], weights)

    @staticmethod
    def of_beams(
        beams: Beams,
        segment_map: SegmentMap,
        laser: LaserModel,
        T_map_base: SE2,
        noise_scale: float = 1.0,
    ) -> MetSurfaces:
        """As `match_beams` sees them: each beam by that wall along it which is nearest to its end.

        noise_scale: times the laser's noise with which the pose was found.
        """
        targets_m = np.where(beams.is_hit, beams.ranges_m, 0.0)
        ranges_m, walls = segment_map.ranges(beams, T_map_base, laser.range_max_m, targets_m)
        normals = _turned(segment_map.normals[walls], T_map_base.theta)
        cosines = np.sum(normals * beams.directions, axis=1)
        is_met = beams.is_hit & (walls >= 0) & (np.abs(cosines) >= _MIN_COSINE)
        ranges_m, normals, cosines = ranges_m[is_met], normals[is_met], cosines[is_met]
        sigma_m = segment_map.sigma_m[walls[is_met]]
        points = beams.origins_m[is_met] + ranges_m[:, np.newaxis] * beams.directions[is_met]
        residuals_m = (beams.ranges_m[is_met] - ranges_m) * cosines
        variances = (noise_scale * laser.noise.sigma_m(ranges_m) * cosines) ** 2 + sigma_m**2
        bells = np.exp(-0.5 * residuals_m**2 / variances)
        # per metre across the wall, of what is spread evenly along the beam
        density = laser.outliers[0] / np.abs(cosines)
        kept = bells / (bells + _ROOT_TWO_PI * density * np.sqrt(variances))
        return MetSurfaces(points, normals, residuals_m, sigma_m, kept / variances)

    def pose_covariance(self, T_map_base: SE2) -> FloatArray:
        """(3, 3) of the pose (base frame), by which the map's errors move it; none of the laser's.

        Beams that meet the same 30 cm of a wall share its error, however many they are. What the
        walls' own sigma does not know shows where metres of the map pull the pose different ways:
        the jackknife over such patches (Efron and Tibshirani, An Introduction to the Bootstrap,
        1993, chapter 11). Nothing along what the scan leaves open.
        """
        if len(self.points) == 0:
            return np.zeros((3, 3))
        rows = self._rows()
        weighted = rows * self.weights[:, np.newaxis]
        forms = weighted[:, :, np.newaxis] * rows[:, np.newaxis, :]
        information = forms.sum(axis=0) + _OPEN
        at = T_map_base @ self.points
        shifts = (weighted * self.sigma_m[:, np.newaxis])[:, :, np.newaxis]
        shared = _sums(shifts * self.normals[:, np.newaxis, :], at, _SHARED_M)
        moved = np.linalg.solve(information, shared)
        known = np.einsum("cik,cjk->ij", moved, moved)
        pulls = _sums(weighted * self.residuals_m[:, np.newaxis], at, _PATCH_M)
        without = information - _LEVER * _sums(forms, at, _PATCH_M)
        steps = np.linalg.solve(without, pulls[:, :, np.newaxis])[:, :, 0]
        return np.asarray(_SHARED**2 * known + _PATCHES * steps.T @ steps)

    def information(self) -> FloatArray:
        """(3, 3) with which the surfaces hold the pose (base frame), as if each were right."""
        rows = self._rows()
        return np.asarray(rows.T @ (rows * self.weights[:, np.newaxis]))

    def _rows(self) -> FloatArray:
        """(N, 3) how each residual changes with the pose."""
        x, y = self.points.T
        return np.column_stack([self.normals, x * self.normals[:, 1] - y * self.normals[:, 0]])

    def that_face_as_seen(self, seen_from: FloatArray) -> MetSurfaces:
        """Those that the scan's own points show to face so; seen_from: (2,) [m], the laser.

        Beside an edge the nearest surface is often not the one that was met.
        """
        facings_rad = faced(self.points, seen_from)[:, 2]
        x, y = self.normals.T
        return self._of(np.abs(x * np.cos(facings_rad) + y * np.sin(facings_rad)) > _FACING_COSINE)

    def facing_as_seen(self, seen_from: FloatArray, sigma_rad: float) -> tuple[MetSurfaces, float]:
        """Those that face as the scan's own points show; and the variance of their facings [rad2].

        seen_from: (2,) [m], the laser. Where its beams lie too far apart to show any facing, the
        map's stand, known by sigma_rad; surfaces seen so flat that it shows none are left out.
        """
        faced_base, variances = faced_and_variances(self.points, seen_from, is_lone_told=False)
        is_shown = np.isfinite(variances)
        shown = np.column_stack([np.cos(faced_base[:, 2]), np.sin(faced_base[:, 2])])
        normals = np.where(is_shown[:, np.newaxis], shown, self.normals)
        # at a corner neighbours scatter too: the median is that of walls
        usual = float(np.median(variances[is_shown])) if is_shown.any() else sigma_rad**2
        seen = replace(self, normals=normals)._of(np.isfinite(faced_base[:, 2]))
        share = np.count_nonzero(is_shown) / max(len(is_shown), 1)
        return seen, share * usual + (1.0 - share) * sigma_rad**2

    def _of(self, is_kept: BoolArray) -> MetSurfaces:
        """Those of (N,) kept."""
        return MetSurfaces(
            self.points[is_kept], self.normals[is_kept], self.residuals_m[is_kept],
            self.sigma_m[is_kept], self.weights[is_kept],
        )  # fmt: skip


def _turned(normals: FloatArray, heading_rad: float) -> FloatArray:
    """(N, 2) seen from a base of that heading."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    x, y = normals.T
    return np.column_stack([c * x + s * y, c * y - s * x])


def _sums(values: FloatArray, points_map: FloatArray, side_m: float) -> FloatArray:
    """(C, ...) sums of values (N, ...) over each square of the map that holds points."""
    cells: IntArray = np.floor(points_map / side_m).astype(np.int64)
    keys = (cells[:, 0] << 32) + cells[:, 1]
    order = np.argsort(keys, kind="stable")
    is_first = np.diff(keys[order], prepend=keys[order[0]] - 1) != 0
    return np.asarray(np.add.reduceat(values[order], np.flatnonzero(is_first), axis=0))

"""A map of walls out of a map of points: a short straight piece for each cell that has some."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from slam.arrays import FloatArray, checked_points
from slam.surface.segment_map import SegmentMap

_OVERLAP = 1.1
"""Pieces are this much longer than their cells, so that no beam slips between two."""


@dataclass(frozen=True)
class SurfelConfig:
    """How `surfel_map` fits its pieces.

    cell_m: side of the cells that are tiled. reach_m: points so near to the middle of a cell's own
    are fitted with them, so that neighbours agree. min_points: fewer make no line. min_sigma_m:
    least standard deviation across a piece; chosen: what the poses behind a good map leave.
    """

    cell_m: float = 0.1
    reach_m: float = 0.15
    min_points: int = 3
    min_sigma_m: float = 0.01

    def __post_init__(self) -> None:
        if not (self.cell_m > 0.0 and self.reach_m > 0.0 and self.min_sigma_m > 0.0):
            raise ValueError(f"cell_m, reach_m and min_sigma_m must be above 0, not {self}")
        if self.min_points < 2:
            raise ValueError(f"a line needs two points at least, not {self.min_points}")


def surfel_map(points: FloatArray, config: SurfelConfig | None = None) -> SegmentMap:
    """The walls that points (K, 2) [m] lie on, seen from either side, each with its roughness.

    A line through the points around each cell (principal component), cut to the cell.
    Raises ValueError if the points are not finite (K, 2), or make no line anywhere.
    """
    config = config or SurfelConfig()
    points = checked_points(points, "map points")
    cells = np.floor(points / config.cell_m).astype(np.int64)
    corners, cell_of_point = np.unique(cells, axis=0, return_inverse=True)
    counts = np.bincount(cell_of_point.ravel(), minlength=len(corners))
    sums = np.stack(
        [
            np.bincount(cell_of_point.ravel(), weights=axis, minlength=len(corners))
            for axis in points.T
        ],
        axis=1,
    )
    middles = sums / np.maximum(counts, 1)[:, np.newaxis]
    tree = cKDTree(points)
    pieces, sigmas = [], []
    for corner, middle in zip(corners, middles, strict=True):
        around = points[tree.query_ball_point(middle, config.reach_m)]
        if len(around) < config.min_points:
            continue
        mean = around.mean(axis=0)
        variances, axes = np.linalg.eigh(np.cov(around.T, ddof=0))
        if variances[1] <= 0.0:
            continue
        piece = _cut(mean, axes[:, 1], (corner + 0.5) * config.cell_m, config.cell_m)
        if piece is not None:
            pieces.append(piece)
            sigmas.append(max(math.sqrt(max(variances[0], 0.0)), config.min_sigma_m))
    if not pieces:
        raise ValueError(
            f"{len(points)} points make no line: {config.min_points} within {config.reach_m} m needed"
        )
    return SegmentMap(np.array(pieces), np.array(sigmas))


def _cut(
    point: FloatArray, along: FloatArray, centre: FloatArray, side_m: float
) -> FloatArray | None:
    """(2, 2) the part of a line within a square, a little longer than that; None if it has none."""
    half = 0.5 * side_m * _OVERLAP
    low, high = -math.inf, math.inf
    for axis in range(2):
        offset = centre[axis] - point[axis]
        if abs(along[axis]) < 1e-12:
            if abs(offset) > half:
                return None
            continue
        ends = sorted(((offset - half) / along[axis], (offset + half) / along[axis]))
        low, high = max(low, ends[0]), min(high, ends[1])
    if not high > low:
        return None
    return np.array([point + low * along, point + high * along])

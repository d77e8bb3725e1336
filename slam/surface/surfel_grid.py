"""A grid over the map that knows, in each cell, the nearest piece of surface."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray
from slam.surface.near_cells import nearest_points
from slam.surface.segment_map import SegmentMap

_MAX_CELLS = 16_000_000
_LEAST_SIGMA_M = 1e-4
_NORMAL_SIGMA_RAD = 0.005
"""Chosen: a cell of 2 cm takes a wall round by 2 m for one that is straight; 5 mrad at its rim."""
_FITTED_NORMAL_SIGMA_RAD = 0.05
"""Chosen: of a line fitted to half a dozen points, a centimetre rough, over 30 cm."""


@dataclass(frozen=True, eq=False)
class SurfelGrid:
    """The surface nearest to each cell's middle: its line itself, not a distance sampled there.

    So a wall is where it is to the micrometre, wherever it lies within its cells.
    surfels: (rows * columns, 4) float32: unit normal, offset along it, standard
    deviation [m]; 0 where no surface is within reach. is_one_sided: normals point to the open side.
    is_exact: the walls are known, not fitted.
    """

    surfels: NDArray[np.float32]
    columns: int
    origin_m: FloatArray
    cell_m: float
    is_one_sided: bool
    is_exact: bool

    @property
    def normal_sigma_rad(self) -> float:
        """How wrong normals are by chance."""
        return _NORMAL_SIGMA_RAD if self.is_exact else _FITTED_NORMAL_SIGMA_RAD

    @staticmethod
    def of(segment_map: SegmentMap, cell_m: float = 0.02, reach_m: float = 0.5) -> SurfelGrid:
        """The grid of a map of walls, for points within reach of them.

        A wall that no beam can see, because it stands within another, draws the points near it all
        the same: leave such out of the map. cell_m: coarser in maps too large for it.
        Raises ValueError for an empty map.
        """
        if len(segment_map) == 0:
            raise ValueError("the map has no walls: there is no surface to match with")
        ends = segment_map.segments.reshape(-1, 2)
        lower, upper = ends.min(axis=0) - reach_m, ends.max(axis=0) + reach_m
        area_m2 = float(np.prod(upper - lower))
        cell_m = max(cell_m, math.sqrt(area_m2 / _MAX_CELLS))
        starts, sigmas = segment_map.segments[:, 0], np.maximum(segment_map.sigma_m, _LEAST_SIGMA_M)
        columns, rows = (np.ceil((upper - lower) / cell_m).astype(int) + 1).tolist()
        points, owners = segment_map.sampled(cell_m / 2.0)
        x = lower[0] + (np.arange(columns) + 0.5) * cell_m
        y = lower[1] + (np.arange(rows) + 0.5) * cell_m
        surfels = np.zeros((rows * columns, 4), dtype=np.float32)
        for cells, _, nearest in nearest_points(points, x, y, reach_m):
            walls = owners[nearest]
            normals = segment_map.normals[walls]
            surfels[cells, :2] = normals
            surfels[cells, 2] = np.sum(normals * starts[walls], axis=1)
            surfels[cells, 3] = sigmas[walls]
        return SurfelGrid(
            surfels, columns, lower, cell_m, segment_map.is_one_sided, segment_map.is_exact
        )

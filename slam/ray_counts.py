"""How many scans hit each cell of a grid, and how many saw through it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.arrays import BoolArray, FloatArray, IntArray, checked_points
from slam.beams import Beams
from slam.kernels.grid_rays import count_cells
from slam.se2 import SE2

_MOST_CELLS = 2**27
"""Chosen: 580 m x 580 m at 5 cm, which needs 2 GB while it is counted."""


class TooManyCellsError(ValueError):
    """What scans saw reaches so far that no grid holds it."""


@dataclass(frozen=True, eq=False)
class RayCounts:
    """Hits and misses of the cells that the beams of scans reached.

    hits: (rows, columns) scans of which a beam ended in the cell; misses: (rows, columns) those
    whose beams did no more than pass it. corner_m: (2,) outer corner of cell [0, 0], map frame,
    from which x runs along the columns and y along the rows. cell_m: side of a cell.
    """

    hits: NDArray[np.int32]
    misses: NDArray[np.int32]
    corner_m: FloatArray
    cell_m: float

    @staticmethod
    def of(
        scans: Iterable[tuple[SE2, Beams]], cell_m: float, free_range_m: float = 0.0
    ) -> RayCounts:
        """The counts of scans, each with its T_map_base, on a grid as large as what they saw.

        Ranges of nan, -inf and 0 tell nothing. free_range_m: how far a beam without return (inf)
        has seen nothing; 0: such tell nothing either.
        Raises ValueError if no beam tells anything or a pose is not finite, TooManyCellsError if the
        beams reach so far that the grid would have more than 2**27 cells.
        """
        rays = _Rays.of(scans, free_range_m)
        if len(rays.starts_m) == 0:
            raise ValueError(
                "no beam of the scans tells anything: no hit, nothing known to be free"
            )
        if not (np.isfinite(rays.starts_m).all() and np.isfinite(rays.ends_m).all()):
            raise ValueError("the poses and beams of scans must be finite")
        starts, ends = rays.starts_m / cell_m, rays.ends_m / cell_m
        lower = np.floor(np.minimum(starts.min(axis=0), ends.min(axis=0)))
        upper = np.floor(np.maximum(starts.max(axis=0), ends.max(axis=0)))
        if not np.prod(upper - lower + 1.0) <= _MOST_CELLS:
            width_m, height_m = (upper - lower + 1.0) * cell_m
            raise TooManyCellsError(
                f"the beams span {width_m:.6g} x {height_m:.6g} m, too many cells of"
                f" {cell_m} m; cut the far ranges"
            )
        columns, rows = (upper - lower + 1.0).astype(np.int64)
        hits, misses = np.zeros((2, rows, columns), dtype=np.int32)
        count_cells(starts - lower, ends - lower, rays.is_hit, rays.firsts, hits, misses)
        return RayCounts(hits, misses, lower * cell_m, cell_m)


def still_standing(
    points: ArrayLike,
    scans: Iterable[tuple[SE2, Beams]],
    cell_m: float = 0.1,
    least_share: float = 0.1,
) -> BoolArray:
    """(K,) which of points (K, 2) [m], map frame, were not seen through by most later looks.

    scans: T_map_base and beams of those that made the points. A point stands where, of the scans
    that looked at its cell, this share at least ended there; and off the grid of what they saw.
    chosen: doors that were shut once and people go; what stands on thin legs stays.
    """
    points = checked_points(points, "points")
    counts = RayCounts.of(scans, cell_m)
    columns, rows = np.floor((points - counts.corner_m) / cell_m).astype(np.int64).T
    row_count, column_count = counts.hits.shape
    is_inside = (rows >= 0) & (rows < row_count) & (columns >= 0) & (columns < column_count)
    rows, columns = rows[is_inside], columns[is_inside]
    hits, misses = counts.hits[rows, columns], counts.misses[rows, columns]
    stands = np.ones(len(points), dtype=np.bool_)
    stands[is_inside] = hits >= least_share * np.maximum(hits + misses, 1)
    return stands


@dataclass(frozen=True, eq=False)
class _Rays:
    """The beams of scans that tell something, one after the other.

    starts_m, ends_m: (B, 2) map frame; is_hit: (B,) whether something was at the end; firsts:
    (S + 1,) the first of each scan, and their number.
    """

    starts_m: FloatArray
    ends_m: FloatArray
    is_hit: BoolArray
    firsts: IntArray

    @staticmethod
    def of(scans: Iterable[tuple[SE2, Beams]], free_range_m: float) -> _Rays:
        """The rays of scans, each with its T_map_base."""
        starts, ends = [np.empty((0, 2))], [np.empty((0, 2))]
        is_hit, counts = [np.empty(0, bool)], [0]
        for T_map_base, beams in scans:
            hit = beams.is_hit & (beams.ranges_m > 0.0)
            tells = hit | (np.isposinf(beams.ranges_m) & (free_range_m > 0.0))
            lengths_m = np.where(hit, beams.ranges_m, free_range_m)[tells, np.newaxis]
            origins_m = beams.origins_m[tells]
            starts.append(T_map_base @ origins_m)
            ends.append(T_map_base @ (origins_m + lengths_m * beams.directions[tells]))
            is_hit.append(hit[tells])
            counts.append(len(origins_m))
        firsts = np.cumsum(counts, dtype=np.int64)
        return _Rays(np.concatenate(starts), np.concatenate(ends), np.concatenate(is_hit), firsts)

"""Slow, obvious versions of what the kernels do fast, for the tests to compare them with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam.beams import Beams
from slam.se2 import SE2
from slam.segment_map import SegmentMap

FloatArray = NDArray[np.float64]


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def cast_all(
    segments: FloatArray, beams: Beams, T_map_base: SE2, range_max_m: float = np.inf
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Ranges (N,) and walls (N,) by trying all beams with all walls (S, 2, 2) from their left."""
    starts = T_map_base.inverse() @ segments[:, 0]
    along = T_map_base.inverse() @ segments[:, 1] - starts
    # origin + direction * range = start + along * share, by Cramer's rule
    to_start = starts[np.newaxis] - beams.origins_m[:, np.newaxis]
    determinant = cross(beams.directions[:, np.newaxis], along[np.newaxis])
    with np.errstate(divide="ignore", invalid="ignore"):
        ranges = cross(to_start, along[np.newaxis]) / determinant
        share = cross(to_start, beams.directions[:, np.newaxis]) / determinant
    is_hit = (determinant > 0.0) & (ranges > 0.0) & (share >= 0.0) & (share <= 1.0)
    ranges = np.where(is_hit & (ranges <= range_max_m), ranges, np.inf)
    nearest = ranges.argmin(axis=1)
    best = ranges[np.arange(len(beams)), nearest]
    return best, np.where(np.isfinite(best), nearest, -1)


def gradients(
    segment_map: SegmentMap, beams: Beams, T_map_base: SE2, step: float = 1e-6
) -> FloatArray:
    """(N, 3) change of each range by a motion (x, y, theta) of the base in its own frame."""
    columns = []
    for axis in np.eye(3):
        there, _ = segment_map.ranges(beams, T_map_base @ SE2.exp(step * axis))
        back, _ = segment_map.ranges(beams, T_map_base @ SE2.exp(-step * axis))
        with np.errstate(invalid="ignore"):
            columns.append((there - back) / (2.0 * step))
    return np.column_stack(columns)

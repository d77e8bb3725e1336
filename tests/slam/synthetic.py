"""A room of exact segments and the scans that a laser would take in it, for the tests of slam."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.measurements import LaserScan
from slam.se2 import SE2

FloatArray = NDArray[np.float64]

# A 6 x 4 m room with a cupboard in one corner, a box and a slanted board: no symmetry.
ROOM_SEGMENTS = np.array(
    [
        [[0.0, 0.0], [6.0, 0.0]],
        [[6.0, 0.0], [6.0, 4.0]],
        [[6.0, 4.0], [0.0, 4.0]],
        [[0.0, 4.0], [0.0, 0.0]],
        [[0.0, 3.0], [1.0, 3.0]],
        [[1.0, 3.0], [1.0, 4.0]],
        [[4.0, 0.0], [4.0, 0.7]],
        [[4.0, 0.7], [4.9, 0.7]],
        [[4.9, 0.7], [4.9, 0.0]],
        [[5.0, 4.0], [6.0, 2.9]],
    ]
)
ROOM_CENTRE = SE2(2.6, 1.9, 0.4)
# 240 degrees, a beam every 0.5 degrees: an URG-04LX, thinned
ANGLES_RAD = np.radians(np.arange(-120.0, 120.5, 0.5))


def sampled(segments: ArrayLike, spacing_m: float) -> FloatArray:
    """Points along the segments (S, 2, 2), evenly spaced, both ends included: (K, 2)."""
    points = []
    for start, end in np.asarray(segments, dtype=np.float64):
        count = max(2, int(np.ceil(np.hypot(*(end - start)) / spacing_m)) + 1)
        points.append(start + np.linspace(0.0, 1.0, count)[:, np.newaxis] * (end - start))
    return np.vstack(points)


def round_wall(radius_m: float, piece_count: int = 720) -> FloatArray:
    """A circle about the origin as many short segments (S, 2, 2)."""
    angles = np.linspace(0.0, 2.0 * np.pi, piece_count + 1)
    corners = radius_m * np.column_stack([np.cos(angles), np.sin(angles)])
    return np.stack([corners[:-1], corners[1:]], axis=1)


def scan_of(
    segments: ArrayLike,
    T_map_laser: SE2,
    rng: np.random.Generator | None = None,
    sigma_m: float = 0.0,
    angles_rad: FloatArray = ANGLES_RAD,
    range_max_m: float = 30.0,
) -> LaserScan:
    """The scan of the segments (S, 2, 2) by exact ray casting, with Gaussian range noise."""
    segments = np.asarray(segments, dtype=np.float64)
    starts = T_map_laser.inverse() @ segments[:, 0]
    edges = T_map_laser.inverse() @ segments[:, 1] - starts
    beams = np.column_stack([np.cos(angles_rad), np.sin(angles_rad)])
    # beam * r = start + edge * u: Cramer's rule for every beam (rows) and segment (columns)
    determinant = _cross(beams[:, np.newaxis], edges[np.newaxis])
    with np.errstate(divide="ignore", invalid="ignore"):
        ranges = _cross(starts, edges)[np.newaxis] / determinant
        along = _cross(starts[np.newaxis], beams[:, np.newaxis]) / determinant
    hits = (ranges > 0.0) & (along >= 0.0) & (along <= 1.0)
    ranges_m = np.where(hits, ranges, np.inf).min(axis=1)
    if rng is not None:
        ranges_m = np.maximum(ranges_m + rng.normal(0.0, sigma_m, len(ranges_m)), 0.0)
    return LaserScan(0.0, angles_rad, np.where(ranges_m <= range_max_m, ranges_m, np.inf))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])

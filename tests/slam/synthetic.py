"""A room of exact segments and the scans that a laser would take in it, for the tests of slam."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.laser_model import LaserModel
from slam.measurements import LaserScan
from slam.range_noise import RangeNoise
from slam.relocalization import FreeSpace, Relocalizer
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from slam.surface.surfel_grid import SurfelGrid

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


def box(left_m: float, low_m: float, right_m: float, high_m: float) -> FloatArray:
    """Four walls (4, 2, 2) about a rectangle, seen from outside."""
    corners = np.array([[left_m, low_m], [left_m, high_m], [right_m, high_m], [right_m, low_m]])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def room(left_m: float, low_m: float, right_m: float, high_m: float) -> FloatArray:
    """Four walls (4, 2, 2) about a rectangle, seen from inside."""
    return box(left_m, low_m, right_m, high_m)[:, ::-1]


# One-sided, for the search of a whole map: 4 x 3 m with things that no turn brings over themselves
CLUTTERED_ROOM = np.concatenate(
    [
        room(0.0, 0.0, 4.0, 3.0),
        box(3.1, 2.2, 3.9, 2.9),
        box(0.1, 1.1, 0.5, 1.9),
        box(1.7, 0.1, 2.6, 0.4),
        [[[2.2, 3.0], [1.2, 2.6]], [[1.2, 2.6], [1.1, 3.0]]],
    ]
)
# Looks the same after half a turn about the origin
SYMMETRIC_ROOM = room(-2.0, -1.5, 2.0, 1.5)


def legs(T_map_laser: SE2, bearings_rad: ArrayLike, away_m: float = 0.8) -> FloatArray:
    """Walls (S, 2, 2) of pairs of legs in the laser's way, 12 cm wide and 25 cm apart."""
    walls = []
    for bearing in np.asarray(bearings_rad):
        for side in (-0.5, 0.5):
            at = bearing + side * 0.25 / away_m
            x, y = (T_map_laser @ (away_m * np.array([[np.cos(at), np.sin(at)]])))[0]
            walls.append(box(x - 0.06, y - 0.06, x + 0.06, y + 0.06))
    return np.concatenate(walls)


def searcher(
    walls: FloatArray, is_free: FreeSpace | None = None, range_max_m: float = 10.0
) -> Relocalizer:
    """The search of a map of one-sided walls (S, 2, 2), for a laser of 10 mm noise."""
    segment_map = SegmentMap(walls, is_one_sided=True)
    laser = LaserModel(RangeNoise(((1.0, 0.01),)), 0.02, range_max_m)
    return Relocalizer.of(segment_map, SurfelGrid.of(segment_map), laser, is_free)

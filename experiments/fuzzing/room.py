"""A small room and what a robot in it measures: valid inputs, made in a moment."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.measurements import LaserScan, Measurement
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap

WALLS = np.array(
    [
        *([[0.0, 0.0], [6.0, 0.0]], [[6.0, 0.0], [6.0, 4.0]], [[6.0, 4.0], [0.0, 4.0]]),
        *([[0.0, 4.0], [0.0, 0.0]], [[0.0, 3.0], [1.0, 3.0]], [[1.0, 3.0], [1.0, 4.0]]),
        *([[4.0, 0.0], [4.0, 0.7]], [[4.0, 0.7], [4.9, 0.7]], [[4.9, 0.7], [4.9, 0.0]]),
        [[5.0, 4.0], [6.0, 2.9]],
    ]
)
"""(S, 2, 2) 6 x 4 m with a cupboard, a box and a slanted board: no symmetry."""
T_BASE_LASER = SE2(0.12, 0.0, 0.0)
START = SE2(2.6, 1.9, 0.4)
STEP = SE2(0.02, 0.0, 0.02)
SCAN_S = 0.1
_SIGMA_M = 0.005


def angles(count: int) -> FloatArray:
    """(N,) of a fan of 240 degrees."""
    return np.linspace(math.radians(-120.0), math.radians(120.0), count)


def scan(T_map_base: SE2, time_s: float, count: int, rng: np.random.Generator) -> LaserScan:
    """What a laser with so many beams sees from there."""
    blank = LaserScan(time_s, angles(count), np.ones(count))
    true_m = SegmentMap(WALLS).ranges(Beams.of(blank, T_BASE_LASER), T_map_base)[0]
    noisy_m = np.maximum(0.0, true_m + rng.normal(0.0, _SIGMA_M, count))
    return LaserScan(time_s, blank.angles_rad, noisy_m)


def drive(scans: int, beams: int) -> Iterator[tuple[SE2, Measurement]]:
    """True poses and measurements of a robot that drives a bend."""
    rng, T_map_base = np.random.default_rng(0), START
    for number in range(scans):
        motion = SE2.identity() if number == 0 else STEP
        T_map_base = T_map_base @ motion
        time_s = SCAN_S * number
        yield T_map_base, Measurement(time_s, motion, scan(T_map_base, time_s, beams, rng))

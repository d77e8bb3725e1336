"""Drives around a block of rooms: corridors with niches, wheels that drift, a laser of 8 m."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slam.measurements import Measurement
from slam.se2 import SE2
from tests.slam.synthetic import box, room, scan_of

RANGE_MAX_M = 8.0
T_BASE_LASER = SE2(0.1, 0.0, 0.0)
SIGMA_M = 0.01
_NICHES = [
    box(2.0, -0.4, 2.6, 0.0), box(7.5, -0.3, 8.9, 0.0), box(12.0, 3.0, 12.5, 3.7),
    box(12.0, 8.0, 12.3, 9.5), box(9.0, 12.0, 9.4, 12.6), box(3.1, 12.0, 4.4, 12.4),
    box(-0.5, 8.8, 0.0, 9.2), box(-0.3, 4.0, 0.0, 5.5),
]  # fmt: skip
RING = np.concatenate([room(-1.5, -1.5, 13.5, 13.5), box(1.0, 1.0, 11.0, 11.0), *_NICHES])
"""Corridors of 2.5 m about a core of 10 by 10 m; no two corners are alike."""


def way(laps: float, step_m: float = 0.15) -> list[SE2]:
    """Poses along the middle of the corridors, counter-clockwise, corners cut. A lap begins 0.8 m ahead
    of where the one before ended, within one step: the robot jumps, and the wheels tell it."""
    corners = np.array([[0.0, -0.8], [12.8, -0.8], [12.8, 12.8], [-0.8, 12.8], [-0.8, -0.8]])
    poses, heading = [], 0.0
    total_m = 0.0
    for _ in range(math.ceil(laps)):
        for leg in range(4):
            start, end = corners[leg], corners[leg + 1]
            along = math.atan2(*(end - start)[::-1])
            while (turn := math.remainder(along - heading, 2.0 * math.pi)) > 1e-6:
                heading += min(turn, 0.25)
                poses.append(SE2(*start, heading))
            length_m = float(np.hypot(*(end - start)))
            for k in range(int(length_m / step_m)):
                poses.append(SE2(*(start + (end - start) * k * step_m / length_m), heading))
                total_m += step_m
                if total_m > laps * 53.6:
                    return poses
    return poses


def drive(
    poses: list[SE2],
    rng: np.random.Generator,
    turn_scale: float = 1.05,
    way_scale: float = 1.02,
    walls: np.ndarray = RING,
    range_max_m: float = RANGE_MAX_M,
) -> list[Measurement]:
    """What scans and wheels tell on the way; the first motion is none."""
    found, before = [], poses[0]
    for index, pose in enumerate(poses):
        motion = before.inverse() @ pose
        told = SE2(
            motion.x * way_scale + rng.normal(0.0, 0.002), motion.y,
            motion.theta * turn_scale + rng.normal(0.0, 0.002),
        )  # fmt: skip
        scan = scan_of(walls, pose @ T_BASE_LASER, rng, SIGMA_M, range_max_m=range_max_m)
        noise = np.diag([0.01**2, 0.005**2, 0.02**2])
        found.append(Measurement(0.2 * index, told if index else SE2.identity(), scan, noise))
        before = pose
    return found


def blinded(measurements: Sequence[Measurement], first: int, last: int) -> list[Measurement]:
    """The same with a laser that says nothing from one scan to before another."""
    return [
        replace(one, scan=replace(one.scan, ranges_m=np.full_like(one.scan.ranges_m, np.nan)))
        if first <= k < last
        else one
        for k, one in enumerate(measurements)
    ]

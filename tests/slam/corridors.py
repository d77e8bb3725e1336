"""Corridors and a room along x, bare or not, and the maps of drives through them, by wheels that spin or do not."""

import math
from collections.abc import Callable

import numpy as np

from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.se2 import SE2
from slam.slam_map import SlamMap
from tests.slam.synthetic import box, room, scan_of

# 14 m of bare walls between two ends with things to see
WALLS = np.concatenate(
    [
        room(-6.0, -1.0, 20.0, 1.0),
        box(-3.0, 0.4, -2.2, 1.0),
        box(-1.0, -1.0, -0.5, -0.5),
        box(15.0, 0.3, 15.6, 1.0),
        box(17.0, -1.0, 17.9, -0.4),
    ]
)
ROOM = np.concatenate(
    [
        room(-3.0, -3.0, 17.0, 3.0),
        box(0.5, 1.5, 1.5, 3.0),
        box(3.0, -3.0, 4.0, -2.0),
        box(5.5, 1.8, 6.0, 2.4),
        box(8.0, -2.6, 9.1, -1.9),
        box(10.0, 2.2, 12.0, 3.0),
        box(13.0, -3.0, 13.6, -1.4),
        box(15.0, 1.0, 15.5, 1.7),
    ]
)


DOORS = np.concatenate(
    [room(-6.0, -1.0, 20.0, 1.0), box(-3.0, 0.4, -2.2, 1.0), box(18.0, -1.0, 18.9, -0.4)]
    # walls a hand's breadth thick between doors of a corridor, each in its own distance
    + [
        box(x, 0.85, x + long, 1.0)
        for x, long in ((0.5, 0.9), (2.9, 0.5), (6.1, 1.1), (8.8, 0.7), (12.7, 0.9), (15.2, 0.4))
    ]
    + [
        box(x, -1.0, x + long, -0.85)
        for x, long in ((-1.2, 0.5), (1.6, 0.8), (4.4, 0.6), (7.7, 1.0), (10.9, 0.5), (14.1, 1.2))
    ]
)


# one like the other, each half a metre
PILLARS = np.concatenate(
    [room(-6.0, -1.0, 22.0, 1.0), box(-3.0, 0.4, -2.2, 1.0), box(19.0, -1.0, 19.9, -0.4)]
    + [box(x, 0.85, x + 0.2, 1.0) for x in np.arange(-1.0, 17.0, 0.5)]
    + [box(x, -1.0, x + 0.2, -0.85) for x in np.arange(-1.0, 17.0, 0.5)]
)
ANGLES_RAD = np.radians(np.linspace(-135.0, 135.0, 361))


def person(x: float, y: float) -> np.ndarray:
    """Two legs."""
    legs = [box(x - 0.06, y + aside - 0.06, x + 0.06, y + aside + 0.06) for aside in (-0.15, 0.15)]
    return np.concatenate(legs)


def spun(true_m: np.ndarray, at: int, far_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Where a robot is [m] whose wheels spin over so far while it stands, and what they tell of each step."""
    step_m = true_m[1] - true_m[0]
    long = round(far_m / step_m)
    told_m = np.full(len(true_m) + long, step_m)
    told_m[0] = 0.0
    return np.insert(true_m, at, np.full(long, true_m[at - 1])), told_m


def mapped(
    true_m: np.ndarray,
    told_m: np.ndarray,
    sigma_m: float,
    walls: Callable[[float], np.ndarray],
    *,
    angles_rad: np.ndarray = ANGLES_RAD,
    range_m: float = 8.0,
    turn_rad: float = 0.0,
    seed: int = 0,
) -> tuple[SlamMap, float]:
    """The map of a drive along x, and how far off it is at most [m]. sigma_m: of a metre by the wheels;
    turn_rad: of each step by them."""
    rng, mapper = np.random.default_rng(seed), Mapper(SE2.identity())
    step_m = true_m[1] - true_m[0]
    for k, (x, way_m) in enumerate(zip(true_m, told_m, strict=True)):
        scan = scan_of(walls(x), SE2(x, 0.0, 0.0), rng, 0.01, angles_rad, range_m)
        noise = sigma_m * math.sqrt(way_m)
        motion = SE2(way_m + rng.normal(0.0, noise), 0.0, rng.normal(0.0, turn_rad) if k else 0.0)
        told = np.diag([noise**2 + 1e-6, 1e-4, 1e-4])
        mapper.update(Measurement(max(0.2, step_m) * k, motion, scan, told))
    slam_map = mapper.finish()
    return slam_map, float(np.abs(slam_map.trajectory.poses[:, 0] - true_m).max())

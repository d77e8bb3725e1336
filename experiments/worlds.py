"""The simulated robot and its world for a trial, and in what they differ from what is assumed."""

import math
from dataclasses import replace
from functools import cache

import numpy as np

from kitasap_sim.laser import LaserSpec, laser
from kitasap_sim.places import Place
from kitasap_sim.robot import OdometryPreset
from kitasap_sim.simulation import Simulation

MISMATCHES = {
    "none": "as assumed",
    "noisy": "true sigma twice the assumed one",
    "quiet": "true sigma half the assumed one",
    "offset": "ranges 5 mm too long",
    "mount": "laser mounted 5 mm and 0.3 degrees off",
    "chair": "a chair moved by 20 cm since the map was made",
}
"""No inverse crime: what the simulator does, where the estimators assume something else."""

_OFFSET_M = 0.005
_MOUNT_M = np.array([0.003, 0.004])
"""5 mm, to the front and to the left."""
_MOUNT_RAD = math.radians(0.3)
_PUSH_M = 0.2


def checked_mismatch(name: str) -> str:
    """The name as it is. Raises ValueError, naming those there are, if it is unknown."""
    if name not in MISMATCHES:
        raise ValueError(f"no mismatch called '{name}'; there are: {', '.join(MISMATCHES)}")
    return name


def true_laser(name: str, mismatch: str) -> LaserSpec:
    """The laser as it really is on the simulated robot."""
    spec = laser(name)
    match mismatch:
        case "noisy" | "quiet":
            factor = 2.0 if mismatch == "noisy" else 0.5
            return replace(spec, sigma_at_m=tuple((at, factor * s) for at, s in spec.sigma_at_m))
        case "offset":
            return replace(spec, range_bias_m=_OFFSET_M)
        case "mount":
            x, y, z = spec.mount_m
            return replace(
                spec,
                mount_m=(x + _MOUNT_M[0], y + _MOUNT_M[1], z),
                first_angle_rad=spec.first_angle_rad + _MOUNT_RAD,
            )
    return spec


@cache
def moved_furniture(place: Place, laser_name: str) -> dict[str, tuple[float, float]]:
    """The chair, or what else can be pushed, moved by 20 cm: the same way in every trial."""
    piece = place.movable(laser(laser_name).mount_m[2])
    return {piece: place.pushed(piece, _PUSH_M, np.random.default_rng(0))}


def simulated(
    place: Place,
    laser_name: str,
    odometry: str | OdometryPreset,
    rng: np.random.Generator,
    *,
    people: int = 0,
    mismatch: str = "none",
    range_max_m: float = math.inf,
) -> Simulation:
    """The robot in the world as it truly is; range_max_m: no beam returns from farther.

    Raises ValueError where that cannot be.
    """
    moved_m = moved_furniture(place, laser_name) if mismatch == "chair" else None
    spec = true_laser(laser_name, mismatch)
    spec = replace(spec, range_max_m=min(spec.range_max_m, range_max_m))
    return Simulation(place, spec, odometry, rng=rng, people=people, moved_m=moved_m)

"""The scans and the map that all rows of `kitasap bench registration` are given alike."""

from dataclasses import dataclass

import numpy as np

from experiments.assumptions import assumed_laser
from experiments.bench.registration import KnownMap
from kitasap_sim.laser import LaserSpec, laser, measured_ranges
from kitasap_sim.place_map import PlaceMap
from kitasap_sim.places import Place
from kitasap_sim.simulation import Simulation
from slam.arrays import FloatArray
from slam.measurements import LaserScan
from slam.se2 import SE2

MAP_POINTS = 10_000
START_ERROR_M, START_ERROR_RAD = 0.05, 0.05
"""Uniform to either side, on each axis: the starts of `notes/algorithms.md`, section 6."""
MIN_HIT_SHARE = 600 / 682
"""Of the beams; where fewer hit anything, the pose is drawn again."""
_MAX_DRAWS = 1000
_SEED_KEY = 101
"""Apart from the keys of the experiments, so that nothing shares random numbers."""


@dataclass(frozen=True)
class RegistrationTrial:
    """One scan of a robot at rest, where it was taken, and where the search starts."""

    scan: LaserScan
    points_base: FloatArray
    T_true: SE2
    T_start: SE2


@dataclass(frozen=True)
class RegistrationData:
    """The map with its spacing [m], and the trials."""

    known: KnownMap
    map_spacing_m: float
    trials: tuple[RegistrationTrial, ...]

    @property
    def scan_sizes(self) -> list[int]:
        """How many points each scan has."""
        return [len(trial.points_base) for trial in self.trials]


def drawn(place: Place, spec: LaserSpec | str, trials: int, seed: int) -> RegistrationData:
    """Scans at random free poses of a place, with all the errors of the laser.

    Trial i depends on place, laser, seed and i alone.
    Raises ValueError where the laser hardly sees anything, wherever the robot stands.
    """
    spec = laser(spec) if isinstance(spec, str) else spec
    T_base_laser = SE2(spec.mount_m[0], spec.mount_m[1], 0.0)
    place_map = place.map_at(spec.mount_m[2])
    spacing_m = spacing_for(place_map, MAP_POINTS)
    known = KnownMap(
        points=place_map.points_m(spacing_m),
        segments=place_map.segments_m,
        T_base_laser=T_base_laser,
        laser_model=assumed_laser(spec.name),
    )
    simulation = Simulation(place, spec, "ideal", rng=np.random.default_rng(0))
    drawn_trials = tuple(
        _trial(simulation, spec, T_base_laser, _generator(seed, index)) for index in range(trials)
    )
    return RegistrationData(known, spacing_m, drawn_trials)


def spacing_for(place_map: PlaceMap, count: int) -> float:
    """The spacing [m] at which a place's map has as near to so many points as can be."""
    low_m, high_m = 1e-4, 1.0
    found: dict[float, int] = {}
    while high_m - low_m > 1e-6:
        middle_m = (low_m + high_m) / 2
        found[middle_m] = len(place_map.points_m(middle_m))
        if found[middle_m] > count:
            low_m = middle_m
        else:
            high_m = middle_m
    return min(found, key=lambda spacing_m: abs(found[spacing_m] - count))


def _generator(seed: int, index: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_SEED_KEY, index)))


def _trial(
    simulation: Simulation, spec: LaserSpec, T_base_laser: SE2, rng: np.random.Generator
) -> RegistrationTrial:
    for _ in range(_MAX_DRAWS):
        pose = simulation.place.draw_free_pose(rng)
        simulation.reset(pose)
        # the robot is at rest, so that all beams may be fired at once
        ranges_m = measured_ranges(spec, simulation.true_ranges_m(), rng)
        scan = LaserScan(0.0, spec.angles_rad, ranges_m)
        if np.count_nonzero(scan.is_hit) >= MIN_HIT_SHARE * spec.beam_count:
            limits = [START_ERROR_M, START_ERROR_M, START_ERROR_RAD]
            start = pose + rng.uniform(-1.0, 1.0, 3) * limits
            return RegistrationTrial(
                scan, scan.points(T_base_laser), SE2.from_array(pose), SE2.from_array(start)
            )
    raise ValueError(
        f"place {simulation.place.name}: {spec.name} sees less than {MIN_HIT_SHARE:.0%} of its "
        f"beams return at each of {_MAX_DRAWS} free poses"
    )

"""Experiment 2 (paper, Section 4.1, second Fig. 5, Table 2): lifted, moved -1 m in y, turned by 90 degrees.

The robot finds itself at (1), is carried to (2) by hand, its wheels held by the motors, and has to
find itself again: its encoders tell nothing of the way. The paper's protocol repeats one pair of
poses; random ones start anywhere in the free space, wherever (2) is free as well.
"""

import numpy as np

from experiments.bounds import scan_bound
from experiments.localization import in_view, make_localizers, start_poses, update_all
from experiments.paper import KIDNAP_MOTION
from experiments.sources import MeasurementSource
from experiments.trials import TrialConfig, TrialResult
from kitasap_sim.hand import Operator, kidnap
from kitasap_sim.places import Place

NAME = "kidnap"
_MAX_DRAWS = 10_000
_HAND_MARGIN_M = 0.05
"""Room left around (2) for the operator's inaccuracy: five of its standard deviations."""


def run_trial(config: TrialConfig, rng: np.random.Generator) -> TrialResult:
    """One trial: every method gets the same two measurements; the outcomes are those at (2)."""
    known, (pose_rng, simulation_rng) = config.known_place, rng.spawn(2)
    simulation = config.simulation(simulation_rng)
    pose, believed = _start_with_free_target(config, simulation.world, pose_rng)
    simulation.reset(pose)
    source = MeasurementSource(known.laser, simulation.wheel_ticks())
    localizers = make_localizers(config, believed)
    before = source.measurement(simulation.next_frame())
    true_before = simulation.truth().pose
    update_all(config, localizers, before, true_before)
    nominal = believed if config.poses == "paper" else pose
    kidnap(simulation, Operator().aimed(nominal + KIDNAP_MOTION, pose_rng))
    after = source.measurement(simulation.next_frame())
    true = simulation.truth().pose
    outcomes, cpu_s = update_all(config, localizers, after, true)
    bound = scan_bound(known, config.true_laser, after.scan, true)
    scans = [before.scan, after.scan]
    return TrialResult(
        [true_before, true], outcomes, simulation.time_s, bound, cpu_s, scans, in_view(simulation)
    )


def checked(config: TrialConfig) -> TrialConfig:
    """The configuration, if it names a place where (2) is free. Raises ValueError if not."""
    config = config.checked()
    world = config.simulation(np.random.default_rng(0)).world
    _start_with_free_target(config, world, np.random.default_rng(0))
    return config


def _start_with_free_target(
    config: TrialConfig, place: Place, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """`start_poses`, such that the robot can be set down at (2) as well.

    Raises ValueError if the place has no such pose.
    """
    for _ in range(_MAX_DRAWS if config.poses == "random" else 1):
        pose, believed = start_poses(config, place, rng)
        if _is_free_around(place, (pose + KIDNAP_MOTION)[:2]):
            return pose, believed
    raise ValueError(
        f"place {place.name}: nothing is free 1 m lower in y than "
        + ("its start" if config.poses == "paper" else "any free pose")
        + "; the robot cannot be kidnapped as in the paper there"
    )


def _is_free_around(place: Place, point_m: np.ndarray) -> bool:
    """Whether the robot can stand at a point (2,) and within the hand's margin of it."""
    steps = _HAND_MARGIN_M * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    return bool(place.is_free(point_m + steps).all())


if __name__ == "__main__":
    from experiments.cli import run_script

    run_script(NAME)

"""Experiment 1 (paper, Section 4.1, Fig. 5, Table 1): the robot stands and finds its pose.

The paper's protocol repeats one pose (1), where an operator sets the robot down each time; the
robot believes to stand exactly at (1). Random poses: anywhere in the free space, any heading, and
the belief off by up to 10 cm on each axis and 5 degrees.
"""

import time

import numpy as np

from experiments.methods import METHODS
from experiments.sources import MeasurementSource
from experiments.trials import Outcome, TrialConfig, TrialResult
from kitasap_sim.hand import Operator
from kitasap_sim.simulation import Simulation
from slam.localization import Localizer
from slam.measurements import Measurement
from slam.se2 import SE2

NAME = "localization"


def run_trial(config: TrialConfig, rng: np.random.Generator) -> TrialResult:
    """One trial: every method gets the same measurement."""
    known, (pose_rng, simulation_rng) = config.known_place, rng.spawn(2)
    simulation = Simulation(known.place, known.laser, config.odometry, rng=simulation_rng)
    pose, believed = start_poses(config, pose_rng)
    simulation.reset(pose)
    source = MeasurementSource(known.laser, simulation.wheel_ticks())
    measurement = source.measurement(simulation.next_frame())
    true = simulation.truth().pose
    localizers = make_localizers(config, believed)
    outcomes, cpu_s = update_all(config, localizers, measurement, true)
    return TrialResult([true], outcomes, simulation.time_s, cpu_s, [measurement.scan])


def checked(config: TrialConfig) -> TrialConfig:
    """The configuration, if everything that it names exists. Raises ValueError if not."""
    return config.checked()


def start_poses(config: TrialConfig, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Where the robot stands, and where it believes to stand; (3,) each [m, rad]."""
    place = config.known_place.place
    if config.poses == "paper":
        return Operator().aimed(place.start, rng), place.start
    pose = place.draw_free_pose(rng)
    limits = np.array([config.start_error_m, config.start_error_m, config.start_error_rad])
    return pose, pose + rng.uniform(-limits, limits)


def make_localizers(config: TrialConfig, believed: np.ndarray) -> dict[str, Localizer]:
    """A localizer of its own for each method, all with the same belief (3,) of the pose."""
    known = config.known_place
    return {
        name: Localizer(METHODS[name](known), SE2.from_array(believed), known.T_base_laser)
        for name in config.methods
    }


def update_all(
    config: TrialConfig,
    localizers: dict[str, Localizer],
    measurement: Measurement,
    true: np.ndarray,
) -> tuple[dict[str, Outcome], dict[str, float]]:
    """What each method made of a measurement taken at a true pose (3,), and its CPU time [s]."""
    outcomes, cpu_s = {}, {}
    for name, localizer in localizers.items():
        started_s = time.process_time()
        estimate = localizer.update(measurement)
        cpu_s[name] = time.process_time() - started_s
        outcomes[name] = Outcome.of(estimate.match, estimate.T_map_base, true, config)
    return outcomes, cpu_s


if __name__ == "__main__":
    from experiments.cli import run_script

    run_script(NAME)

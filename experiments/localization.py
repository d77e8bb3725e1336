"""Experiment 1 (paper, Section 4.1, Fig. 5, Table 1): the robot stands and finds its pose.

The paper's protocol repeats one pose (1), where an operator sets the robot down each time; the
robot believes to stand exactly at (1). Random poses: anywhere in the free space, any heading, and
the belief off by up to 10 cm on each axis and 5 degrees.
"""

import time

import numpy as np

from experiments.bounds import scan_bound
from experiments.methods import METHODS
from experiments.observer import NOBODY, TrialObserver
from experiments.sources import MeasurementSource
from experiments.trials import Outcome, TrialConfig, TrialResult
from kitasap_sim.hand import Operator
from kitasap_sim.places import Place
from kitasap_sim.simulation import Simulation
from slam.localization import Localizer
from slam.measurements import Measurement
from slam.se2 import SE2

NAME = "localization"
DEFAULTS = TrialConfig()
_ON_A_LEG_M = 0.10
"""From the axis of a leg: its radius, and what it has walked since the beam ended on it."""


def run_trial(
    config: TrialConfig, rng: np.random.Generator, observer: TrialObserver = NOBODY
) -> TrialResult:
    """One trial: every method gets the same measurement."""
    known, (pose_rng, simulation_rng) = config.known_place, rng.spawn(2)
    simulation = config.simulation(simulation_rng)
    pose, believed = start_poses(config, simulation.world, pose_rng)
    simulation.reset(pose)
    source = MeasurementSource(known.laser, simulation.wheel_ticks())
    observer.begins(simulation, SE2.from_array(believed))
    frame = simulation.next_frame()
    measurement, true = source.measurement(frame), simulation.truth().pose
    observer.frame(frame, true)
    localizers = make_localizers(config, believed)
    outcomes, cpu_s = update_all(config, localizers, measurement, true)
    observer.estimates(outcomes)
    bound = scan_bound(known, config.true_laser, measurement.scan, true)
    return TrialResult(
        [true], outcomes, simulation.time_s, bound, cpu_s, [measurement.scan], in_view(simulation)
    )


def checked(config: TrialConfig) -> TrialConfig:
    """The configuration, if everything that it names exists. Raises ValueError if not."""
    return config.checked()


def start_poses(
    config: TrialConfig, place: Place, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Where the robot stands, and where it believes to stand; (3,) each [m, rad].

    place: the world as it truly is, where furniture may have been moved.
    """
    if config.poses == "paper":
        return Operator().aimed(place.start, rng), place.start
    pose = place.draw_free_pose(rng)
    return pose, pose + start_error(config, rng)


def start_error(config: TrialConfig, rng: np.random.Generator) -> np.ndarray:
    """(3,) how wrong a belief is at first, uniform to either side on each axis [m, rad]."""
    limits = np.array([config.start_error_m, config.start_error_m, config.start_error_rad])
    return rng.uniform(-limits, limits)


def make_localizers(
    config: TrialConfig,
    believed: np.ndarray,
    *,
    is_tracking: bool = False,
    may_be_lost: bool = False,
) -> dict[str, Localizer]:
    """A localizer of its own for each method, all with the same belief (3,) of the pose.

    is_tracking: they will see every scan. may_be_lost: those that can are asked for a verdict.
    """
    known, T_believed = config.known_place, SE2.from_array(believed)
    return {
        name: METHODS[name].localizer(
            known, T_believed, is_tracking=is_tracking, may_be_lost=may_be_lost
        )
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
        is_guarded = localizer.guard is not None
        outcomes[name] = Outcome.of(estimate, true, config, is_guarded=is_guarded)
    return outcomes, cpu_s


def in_view(simulation: Simulation) -> int:
    """How many people have a leg in the latest scan: where a beam ended on it."""
    legs_m = simulation.people_m()
    if not len(legs_m):
        return 0
    assert simulation.laser is not None
    ranges_m = simulation.fan_ranges_m()
    is_hit = np.isfinite(ranges_m)
    mount = SE2(simulation.laser.mount_m[0], simulation.laser.mount_m[1], 0.0)
    angles_rad = simulation.laser.angles_rad[is_hit]
    beams = ranges_m[is_hit, None] * np.stack([np.cos(angles_rad), np.sin(angles_rad)], axis=1)
    ends = SE2.from_array(simulation.truth().pose) @ (mount @ beams)
    off_m = np.linalg.norm(legs_m[:, :, None] - ends, axis=3).min(axis=(1, 2), initial=np.inf)
    return int((off_m < _ON_A_LEG_M).sum())


if __name__ == "__main__":
    from experiments.cli import run_script

    run_script(NAME)

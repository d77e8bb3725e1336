"""From what a task of `kitasap_sim.env` lets a policy see to what `slam` understands.

Of the task itself only what a robot knows is asked: its laser, its control period, its map.
"""

import math
from functools import lru_cache
from typing import Any

import gymnasium
import numpy as np

from experiments.methods import KnownPlace
from experiments.sources import DRIVE, ODOMETRY_NOISE
from kitasap_sim.env.base import KitasapEnv, Observation, scan_range_m
from kitasap_sim.env.motors import CONTROL_S
from kitasap_sim.laser import LaserSpec
from kitasap_sim.places import Place
from slam.measurements import LaserScan, Measurement
from slam.se2 import SE2

_MAP_SPACING_M = 0.0025
"""Of the paper's point map, as in `experiments.trials`; `limit` and `fast` need none."""
_PLACES_KEPT = 16
"""Chosen: more than the places that come with the project; a random room takes half a megabyte."""


class ObservationSource:
    """The measurements of one episode: of the observation of `reset`, then of each step's.

    The observation must have `scan` and `odometry`; `info` only `time_s`.
    """

    def __init__(self, env: KitasapEnv) -> None:
        laser, step_s = env.laser, env.simulation.timestep_s
        self._angles_rad = laser.angles_rad
        self._range_m = np.float32(scan_range_m(laser))  # as a scan has it
        # a beam is fired by the first physics step after it is due; where that is the first one of
        # the next period, the latest range of that beam is of this period's first step
        due_s = np.ceil(laser.delays_s() / step_s - 1e-9) * step_s
        self._fired_s = np.where(due_s > CONTROL_S - step_s / 2.0, 0.0, due_s)
        self._T_last: SE2 | None = None

    def measurement(self, observation: Observation, info: dict[str, Any]) -> Measurement:
        """The scan, with the motion since the last observation. Nothing moved before the first."""
        time_s = float(info["time_s"])
        T_start_base = SE2.from_array(observation["odometry"].astype(float))
        if self._T_last is None:
            # all beams at once, at rest
            motion, beam_times_s = SE2.identity(), np.full(len(self._angles_rad), time_s)
        else:
            motion = self._T_last.inverse() @ T_start_base
            beam_times_s = time_s - CONTROL_S + self._fired_s
        self._T_last = T_start_base
        scan = LaserScan(
            time_s=time_s,
            angles_rad=self._angles_rad,
            ranges_m=self._ranges_m(observation["scan"]),
            beam_times_s=beam_times_s,
        )
        return Measurement(time_s, motion, scan, ODOMETRY_NOISE.covariance(DRIVE, _ticks(motion)))

    def _ranges_m(self, scan: np.ndarray) -> np.ndarray:
        """(N,) as REP-117 has them: the observation's bounds say that nothing was measured."""
        ranges_m = scan.astype(float)
        ranges_m[scan >= self._range_m] = np.inf
        ranges_m[scan <= 0.0] = -np.inf
        return ranges_m


def task_of(env: gymnasium.Env[Any, Any], wrapper: str) -> KitasapEnv:
    """The task within wrappers. Raises TypeError, naming the wrapper, where there is none."""
    task = env.unwrapped
    if not isinstance(task, KitasapEnv):
        raise TypeError(f"{wrapper} wraps the tasks Kitasap2/...-v0, not {task}")
    return task


def known_place(task: KitasapEnv) -> KnownPlace:
    """What the robot is told of the episode's place: its true map. Made once for each place.

    Raises ValueError for a laser of which nothing is assumed.
    """
    return _known_place(task.place, task.sold_laser)


@lru_cache(maxsize=_PLACES_KEPT)
def _known_place(place: Place, laser: LaserSpec) -> KnownPlace:
    return KnownPlace(place, laser, _MAP_SPACING_M)


def _ticks(motion: SE2) -> np.ndarray:
    """(2,) what the encoders counted on a motion, left and right."""
    ahead_m, _, turned_rad = motion.log()
    half_m = turned_rad * DRIVE.track_m / 2.0
    turns = np.array([ahead_m - half_m, ahead_m + half_m]) / DRIVE.wheel_radius_m / math.tau
    return turns * DRIVE.ticks_per_turn

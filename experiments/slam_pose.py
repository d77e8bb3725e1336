"""A SLAM pose for the driving tasks: what their encoders let drift, the laser holds."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs

from experiments.methods import METHODS, checked_methods
from experiments.observations import ObservationSource, known_place, task_of
from kitasap_sim.env.base import Observation, box
from kitasap_sim.env.track import TrackEnv, path_ahead
from slam.localization import Estimate
from slam.se2 import SE2

_FARTHEST_M = 1000.0
"""Bound of `pose_slam`: as of `odometry`."""
_GOAL_BOUNDS = np.array([100.0, 100.0, 1.0, 1.0], dtype=np.float32)
"""As of the task's."""
_VAGUEST = 10.0
"""Bound of `pose_sigma` [m, rad]; chosen: more is no knowledge of a pose in any place here."""


class SlamPose(
    gymnasium.Wrapper[Observation, np.ndarray, Observation, np.ndarray], RecordConstructorArgs
):
    """A task of `kitasap_sim.env` whose robot follows itself on the place's true map.

    At reset the robot is told its pose; from then on `slam` follows it by each step's `scan` and
    `odometry`. Truth is not asked. What the task shows in the robot's frame by its encoders, it
    shows as seen from that pose: goal and path no longer drift away.

    ## Action, reward, start, termination, truncation: those of the task

    ## Observation: that of the task, and besides

    | key | shape | bounds | what |
    |---|---|---|---|
    | `pose_slam` | (3,) | +-1000 m, +-pi | x, y [m], heading [rad] in the map's frame |
    | `pose_sigma` | (3,) | 0 to 10 | standard deviations ahead, aside [m], of the heading [rad] |
    | `goal` | (4,) | as the task's | of `GoTo`: as seen from `pose_slam` |
    | `path` | (10,) | as the task's | of `Track`: the points ahead of the nearest to `pose_slam` |

    The map's frame is the world's. `pose_sigma` is in the robot's frame; 10 where the method claims
    nothing. `path` is as seen from `pose_slam`: the robot is told the path at reset.

    ## Info: that of the task, and besides, with every reset and step

    `pose_slam` (3,), as float64.

    ## Keywords

    `method`: out of `experiments.methods.METHODS`, "limit" by default. The first episode in a place
    makes its map: 0.2 s for a random room, 2 s for `place_fig6`. A step takes 4 to 8 ms more.
    Raises ValueError for an unknown method, TypeError for an environment that is none of ours.
    """

    def __init__(
        self, env: gymnasium.Env[Observation, np.ndarray], *, method: str = "limit"
    ) -> None:
        RecordConstructorArgs.__init__(self, method=method)
        super().__init__(env)
        checked_methods((method,))
        self._task, self._method = task_of(env, "SlamPose"), METHODS[method]
        space = env.observation_space
        assert isinstance(space, gymnasium.spaces.Dict)
        self.observation_space = gymnasium.spaces.Dict(
            {
                **space.spaces,
                "pose_slam": box([-_FARTHEST_M, -_FARTHEST_M, -np.pi]),
                "pose_sigma": box(np.zeros(3), np.full(3, _VAGUEST)),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """A new episode of the task, at a pose that the robot is told."""
        observation, info = self.env.reset(seed=seed, options=options)
        # before it has moved, where its odometry has it is where it stands
        self._T_map_start = SE2.from_array(info["pose_odometry"])
        self._source, self._along_m = ObservationSource(self._task), 0.0
        self._localizer = self._method.localizer(
            known_place(self._task), self._T_map_start, is_tracking=True
        )
        return self._localised(observation, info)

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """A step of the task."""
        observation, reward, is_over, is_late, info = self.env.step(action)
        observation, info = self._localised(observation, info)
        return observation, float(reward), is_over, is_late, info

    def _localised(
        self, observation: Observation, info: dict[str, Any]
    ) -> tuple[Observation, dict[str, Any]]:
        """Observation and info of the task with what the SLAM pose adds to them."""
        estimate = self._localizer.update(self._source.measurement(observation, info))
        T_map_base = estimate.T_map_base
        T_start_base = SE2.from_array(observation["odometry"].astype(float))
        # from where the encoders have the robot to where it is
        T_base_believed = T_map_base.inverse() @ self._T_map_start @ T_start_base
        added = {
            "pose_slam": T_map_base.as_array().astype(np.float32),
            "pose_sigma": _sigmas(estimate).astype(np.float32),
        }
        if "goal" in observation:
            added["goal"] = _goal(T_base_believed, observation["goal"])
        if isinstance(self._task, TrackEnv):
            path, pose = self._task.path, T_map_base.as_array()
            self._along_m, _ = path.nearest(pose[:2], self._along_m)
            added["path"] = path_ahead(path, pose, self._along_m)
        return {**observation, **added}, {**info, "pose_slam": T_map_base.as_array()}


def _goal(T_base_believed: SE2, goal: np.ndarray) -> np.ndarray:
    """(4,) float32 a goal x, y, cosine, sine in the frame where the encoders have the robot, as
    seen from where it is."""
    spot_m, along = goal[:2].astype(float), goal[2:].astype(float)
    turned = SE2(0.0, 0.0, T_base_believed.theta) @ along[None]
    seen = np.concatenate([(T_base_believed @ spot_m[None])[0], turned[0]])
    return seen.astype(np.float32).clip(-_GOAL_BOUNDS, _GOAL_BOUNDS)


def _sigmas(estimate: Estimate) -> np.ndarray:
    """(3,) of a pose, not more than the bound, which says that nothing is claimed."""
    if estimate.covariance is None:
        return np.full(3, _VAGUEST)
    return np.sqrt(np.diag(estimate.covariance)).clip(0.0, _VAGUEST)

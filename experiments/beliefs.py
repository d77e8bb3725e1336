"""What a robot that was carried off believes: observation and reward of `Kitasap2/Relocalize`."""

import math
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs

from experiments.methods import METHODS, KnownPlace, Method, checked_methods
from experiments.observations import ObservationSource, known_place, task_of
from kitasap_sim.env.base import Observation, box
from slam.guard.hypotheses_config import HypothesesConfig
from slam.localization import Estimate, Localizer
from slam.se2 import SE2, wrap_angle
from slam.verdict import Status

BELIEF_SIZE = 8
CERTAIN_REWARD = 5.0
_RIGHT_M, _RIGHT_RAD = 0.05, math.radians(2.0)
"""Chosen: ten times what the method's errors are, and far less than any two places are apart."""
_SIGMAS = 3.0
"""Chosen: so many standard deviations lie within what is right, of a pose that is certain."""
_VAGUE_M, _VAGUE_RAD = 0.1, 0.1
"""Standard deviations that the belief shows as 1; chosen: twice what is right, and more."""
_MOST_PLACES = HypothesesConfig().max_places


class BeliefReward(
    gymnasium.Wrapper[Observation, np.ndarray, Observation, np.ndarray], RecordConstructorArgs
):
    """`Kitasap2/Relocalize-v0` with a robot that searches its map, and is paid for being certain.

    `slam` is told the place's true map and no pose; it takes each step's `scan` and `odometry`.

    ## Action, start, truncation: those of the task

    ## Observation: that of the task, and besides

    | key | shape | bounds | what |
    |---|---|---|---|
    | `belief` | (8,) | 0 to 1; of 4, -1 to 1 | see below |

    | n | `belief` |
    |---|---|
    | 0 | 1 while the robot is tracking: one place is believed |
    | 1 | 1 while it is lost: no place explains the scans. Where 0 and 1 both are 0 it is unsure |
    | 2 | likelihood of the best place, of all that are carried along; 0 where there is none |
    | 3 | how many those are, in twelfths |
    | 4 | turn on the spot after which a scan would tell most, counter-clockwise, in pi rad |
    | 5 | standard deviation of the position where largest, in 0.1 m; 1: more, or none claimed |
    | 6 | standard deviation of the heading, in 0.1 rad; 1: more, or none claimed |
    | 7 | certain scans in a row, of those needed |

    While tracking, 4 is 0. A scan is certain if the robot is tracking and three standard deviations
    lie within what counts as right: 5 cm and 2 degrees.

    ## Reward: the sum of `reward_terms`: those of the task, and

    | term | what |
    |---|---|
    | `certain` | once, after `scans` certain scans in a row: 5 if the pose is right, else -5 |

    ## Termination: as the task, and when the robot is certain

    `is_success` and `success` are True then, if it is right and has not collided.

    ## Info: that of the task, and besides, with every reset and step

    `pose_slam` (3,): the best guess, x, y [m], heading [rad] in the world; `is_certain`: the
    episode ended so, right or wrong.

    ## Keywords

    `method`: out of `experiments.methods.METHODS`, one that finds itself: "limit" by default.
    `scans`: that must be certain in a row, 3 by default (chosen: one may fit by chance).
    Raises ValueError for values that make no sense, TypeError for an environment that is none of
    ours.
    """

    def __init__(
        self,
        env: gymnasium.Env[Observation, np.ndarray],
        *,
        method: str = "limit",
        scans: int = 3,
    ) -> None:
        RecordConstructorArgs.__init__(self, method=method, scans=scans)
        super().__init__(env)
        able = [name for name, one in METHODS.items() if one.finds_itself]
        checked_methods((method,), able)
        if isinstance(scans, bool) or not isinstance(scans, int) or scans < 1:
            raise ValueError(f"scans: a whole number, 1 or more, not {scans}")
        self._task = task_of(env, "BeliefReward")
        self._method, self._needed = METHODS[method], scans
        space = env.observation_space
        assert isinstance(space, gymnasium.spaces.Dict)
        low = np.zeros(BELIEF_SIZE)
        low[4] = -1.0
        self.observation_space = gymnasium.spaces.Dict(
            {**space.spaces, "belief": box(low, np.ones(BELIEF_SIZE))}
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """A new episode of the task; the robot has no idea where it is, but for its first scan."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._source = ObservationSource(self._task)
        self._localizer = lost_localizer(self._method, known_place(self._task))
        self._certain_scans = 0
        estimate, belief = self._look(observation, info)
        info["reward_terms"] = {**info["reward_terms"], "certain": 0.0}
        return {**observation, "belief": belief}, self._told(info, estimate, False, False)

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """A step of the task, and what the robot believes after it."""
        observation, _, is_over, is_late, info = self.env.step(action)
        estimate, belief = self._look(observation, info)
        is_certain = self._certain_scans >= self._needed
        is_right = _is_right(estimate.T_map_base, info["pose_true"])
        paid = (CERTAIN_REWARD if is_right else -CERTAIN_REWARD) if is_certain else 0.0
        terms = info["reward_terms"] = {**info["reward_terms"], "certain": paid}
        info = self._told(info, estimate, is_certain, is_right)
        observation = {**observation, "belief": belief}
        return observation, float(sum(terms.values())), is_over or is_certain, is_late, info

    def _look(self, observation: Observation, info: dict[str, Any]) -> tuple[Estimate, np.ndarray]:
        """What the robot makes of an observation, and its belief."""
        estimate = self._localizer.update(self._source.measurement(observation, info))
        position_m, heading_rad = _sigmas(estimate)
        is_tracking = estimate.verdict.status is Status.TRACKING
        is_sharp = _SIGMAS * position_m <= _RIGHT_M and _SIGMAS * heading_rad <= _RIGHT_RAD
        self._certain_scans = self._certain_scans + 1 if is_tracking and is_sharp else 0
        share, count = _best_of(estimate)
        belief = [
            float(is_tracking),
            float(estimate.verdict.status is Status.LOST),
            share,
            min(count / _MOST_PLACES, 1.0),
            wrap_angle(self._localizer.telling_turn_rad()) / math.pi,
            min(position_m / _VAGUE_M, 1.0),
            min(heading_rad / _VAGUE_RAD, 1.0),
            min(self._certain_scans / self._needed, 1.0),
        ]
        return estimate, np.array(belief, dtype=np.float32)

    def _told(
        self, info: dict[str, Any], estimate: Estimate, is_certain: bool, is_right: bool
    ) -> dict[str, Any]:
        is_success = is_certain and is_right and not info["collision"]
        return {
            **info,
            "is_success": is_success,
            "success": is_success,
            "pose_slam": estimate.T_map_base.as_array(),
            "is_certain": is_certain,
        }


def lost_localizer(method: Method, known: KnownPlace) -> Localizer:
    """A localizer that knows the place, and nothing of where in it the robot is."""
    return method.localizer(known, None, is_tracking=True, may_be_lost=True)


def _best_of(estimate: Estimate) -> tuple[float, int]:
    """Likelihood of the best of the places that the robot may be at, and how many there are."""
    places = estimate.verdict.hypotheses
    if estimate.verdict.status is Status.TRACKING:
        return 1.0, 1
    if not places:
        return 0.0, 0
    ahead = np.array([place.log_likelihood for place in places])
    likelihoods = np.exp(ahead - ahead.max())
    return float(likelihoods[0] / likelihoods.sum()), len(places)


def _sigmas(estimate: Estimate) -> tuple[float, float]:
    """Standard deviations of the position where it is largest [m] and of the heading [rad]."""
    if estimate.covariance is None:
        return math.inf, math.inf
    largest = float(np.linalg.eigvalsh(estimate.covariance[:2, :2])[-1])
    return math.sqrt(max(largest, 0.0)), math.sqrt(float(estimate.covariance[2, 2]))


def _is_right(T_map_base: SE2, true: np.ndarray) -> bool:
    """Whether a pose is that where the robot truly is (3,), as far as it matters."""
    return T_map_base.is_near(SE2.from_array(true), _RIGHT_M, _RIGHT_RAD)

"""What a trained policy is told: how far it is free all around, the goal, and the way to it."""

import math

import numpy as np

from experiments.policies.driving import Driver, DrivingConfig
from experiments.policies.goto import Navigator
from kitasap_sim.env.motors import CONTROL_S, MAX_SPEED_MPS, MAX_TURN_RATE_RADPS
from kitasap_sim.laser import LaserSpec

SECTORS, REACH_M = 48, 3.0
FEATURES = SECTORS + 14
"""Chosen: sectors of 7.5 degrees; what is farther than 3 m matters later."""
REPEAT = 4
"""Steps for which an action is held: who decides at 5 Hz learns with a fourth of the work."""
_AHEAD_M = (0.35, 0.9)
"""Chosen: how far ahead the points of the way lie that it is told."""
_REPLAN = 3
"""Decisions after which the way is planned anew."""
_SHARES = (1.0, 0.6, 0.3)
_BACK_MPS = 0.1
"""Chosen: nobody looks where it backs to."""
_ALONE = DrivingConfig(margin_m=0.06, lag_s=0.1, held_s=CONTROL_S, may_leave=True)
"""Chosen: commands may come two steps late; each is kept for a step, then it could still stop."""


class Surroundings:
    """The grid a robot keeps, as numbers for a network, and what holds its commands back.

    A command that would not let the robot stop before what it remembers gives way to slower ones,
    and these to what the baseline does then.
    """

    def __init__(self, laser: LaserSpec) -> None:
        self._navigator = Navigator(laser, replan_steps=_REPLAN)
        self._alone = Driver(_ALONE)
        self._grid = self._navigator.grid
        self.reset()

    def reset(self) -> None:
        """Forgets the last episode."""
        self._navigator.reset()
        self._goal: tuple[np.ndarray, float] | None = None

    def see(self, observation: dict[str, np.ndarray]) -> None:
        """Takes an observation in; the first of an episode tells where the goal is."""
        self._navigator.see(observation)
        if self._goal is None:
            self._goal = self._navigator.goal(observation)
        self._velocity = observation["velocity"].tolist()
        self._last = observation["last_action"].tolist()

    def features(self) -> np.ndarray:
        """(FEATURES,) float32 of about 1 each.

        Free reach of each sector, from straight behind counter-clockwise, in units of REACH_M; two
        points of the way over the grid, in units of how far ahead they are; of the goal: nearness
        twice, cosine and sine of its bearing and of its heading; speed, turn rate, and the last
        action.
        """
        assert self._goal is not None
        goal_m, heading_rad = self._goal
        points_m = self._grid.obstacles_near(REACH_M)
        free = np.ones(SECTORS)
        if len(points_m):
            reach = np.hypot(*points_m.T) / REACH_M
            turn = (np.arctan2(points_m[:, 1], points_m[:, 0]) / math.tau + 0.5) * SECTORS
            np.minimum.at(free, turn.astype(int) % SECTORS, reach)
        x, y = self._grid.in_robot(goal_m).tolist()
        distance_m = math.hypot(x, y)
        bearing = (x / distance_m, y / distance_m) if distance_m > 1e-6 else (1.0, 0.0)
        turn_rad = heading_rad - float(self._grid.pose[2])
        ahead = self._navigator.points_ahead(goal_m, _AHEAD_M) / np.array([_AHEAD_M]).T
        rest = [
            *ahead.ravel().clip(-2.0, 2.0),
            min(distance_m / REACH_M, 1.0), math.exp(-2.0 * distance_m), *bearing,
            math.cos(turn_rad), math.sin(turn_rad),
            self._velocity[0] / MAX_SPEED_MPS, self._velocity[1] / MAX_TURN_RATE_RADPS, *self._last,
        ]  # fmt: skip
        return np.concatenate([free, rest]).astype(np.float32)

    def held_back_alone(self, action: np.ndarray) -> np.ndarray:
        """(2,) the action, slower, a turn only, or none, where the robot could not stop any more.

        Nobody helps then: so it is in training, where the network learns what to keep away from.
        """
        v, w, now = self._meant(action)
        commands = [(share * v, share * w) for share in _SHARES] + [(0.0, w), (0.0, 0.3 * w)]
        kept = self._alone.first_kept(commands, now, self._navigator.obstacles_m)
        return kept if kept is not None else np.zeros(2, dtype=np.float32)

    def held_back(self, action: np.ndarray) -> np.ndarray:
        """(2,) the action, slower where need be; the baseline's where it leads into something."""
        assert self._goal is not None
        v, w, now = self._meant(action)
        commands = [(share * v, share * w) for share in _SHARES]
        navigator = self._navigator
        kept = navigator.driver.first_kept(commands, now, navigator.obstacles_m)
        return kept if kept is not None else navigator.go_to(*self._goal)

    def _meant(self, action: np.ndarray) -> tuple[float, float, np.ndarray]:
        """Speed and turn rate that an action asks for; and (2,) those it may have by then."""
        forward, turn = action.tolist()
        v = forward * (MAX_SPEED_MPS if forward > 0.0 else _BACK_MPS)
        # what was commanded last may still be to come
        now = np.array([max(self._velocity[0], self._last[0] * MAX_SPEED_MPS), self._velocity[1]])
        return v, turn * MAX_TURN_RATE_RADPS, now

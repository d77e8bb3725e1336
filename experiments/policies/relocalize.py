"""Turns to where most is told of the pose, and drives a little where turning does not suffice."""

import math

import numpy as np

from experiments.policies.driving import action_of
from kitasap_sim.env.base import Observation
from kitasap_sim.laser import LaserSpec
from kitasap_sim.robot import KITASAP2

_TURN_RAD = math.radians(40.0)
"""Where the belief names no turn: as the steps of `slam.guard.guard_config.GuardConfig`."""
_THERE_RAD = 0.15
"""Chosen: so near a turn's end the next one begins; the robot need not stop in between."""
_GAIN_PER_S = 4.0
"""Of a turn [rad/s per rad]; chosen: brakes from full speed by 4 rad/s2 within the last 0.3 rad."""
_ROUND_RAD = math.tau
"""Turned so much in all, either way, every view from here has been seen."""
_WAY_M = 0.5
"""Driven between two rounds; chosen: far enough that what hid something does so no more."""
_LEAST_WAY_M = 0.1
"""Chosen: a shorter way shows nothing new."""
_SPEED_MPS = 0.25
_MARGIN_M = 0.1
"""Left to all sides of a way; chosen: more than the robot rolls on while it brakes, 3 cm, and than
passes unseen between two beams 4 degrees apart at the end of a way."""
_CHOICE_M = 0.05
"""More margin, of a way that is chosen; else, faced, it may be none by the noise of the beams."""
_APART_RAD = math.radians(15.0)
"""From one way that is looked at to the next."""
_BACK_M = 0.1
"""Chosen: what a way straight back may be longer, that the robot does not drive to and fro."""


class TurnToDisambiguate:
    """Policy for `Kitasap2/Relocalize-v0` within `experiments.beliefs.BeliefReward`.

    Of the observation it uses `belief`, `scan` and `odometry`; the action is that of
    `control="twist"`. Unsure or lost it turns on the spot by the telling turn, and then on to the
    same side: turn by telling turn it would go to and fro, while two places are about as likely.
    After a whole round in all it drives up to half a metre where its scans showed most room, on
    rather than back, and turns again; where there is none, it goes on turning. Tracking, it stands.
    On the spot the robot touches nothing; it drives only where its beams have seen a way as wide as
    itself with 0.1 m to each side, so it hits nothing but what moves.
    """

    def __init__(self, laser: LaserSpec) -> None:
        """laser: of the task, `env.unwrapped.laser`."""
        self._mount_m = laser.mount_m[0]
        self._angles_rad = laser.angles_rad
        self.reset()

    def reset(self) -> None:
        """For a new episode."""
        self._target_rad: float | None = None
        self._side = 1.0
        self._last_rad: float | None = None
        self._turned_rad = 0.0
        self._from_m: np.ndarray | None = None
        self._is_facing = False
        self._along_rad: float | None = None
        self._best: tuple[float, float] | None = None

    def __call__(self, observation: Observation) -> np.ndarray:
        """(2,) float32, speed and turn rate in shares of the largest. Raises ValueError without a
        belief."""
        if "belief" not in observation:
            raise ValueError(
                "this policy acts on `belief`, which is not in the observation: wrap the task in"
                " experiments.beliefs.BeliefReward"
            )
        x, y, heading_rad = observation["odometry"].astype(float).tolist()
        if self._last_rad is not None:
            self._turned_rad += abs(math.remainder(heading_rad - self._last_rad, math.tau))
        self._last_rad = heading_rad
        if observation["belief"][0] > 0.5:
            self.reset()
            return action_of(0.0, 0.0)
        if self._from_m is not None:
            return self._drive(observation, np.array([x, y]), heading_rad)
        self._notice(observation, heading_rad)
        if self._turned_rad >= _ROUND_RAD and self._best is not None:
            self._target_rad = self._along_rad = self._best[1]
            self._from_m, self._is_facing, self._best = np.array([x, y]), False, None
            return self._drive(observation, np.array([x, y]), heading_rad)
        return self._turn(float(observation["belief"][4]) * math.pi, heading_rad)

    def _turn(self, telling_rad: float, heading_rad: float) -> np.ndarray:
        """On the spot: by the telling turn, then on to the same side."""
        if self._target_rad is None:
            turn_rad = telling_rad or _TURN_RAD
            self._target_rad, self._side = heading_rad + turn_rad, math.copysign(1.0, turn_rad)
        elif abs(self._off_rad(heading_rad)) < _THERE_RAD:
            self._target_rad = heading_rad + self._side * _TURN_RAD
        return action_of(0.0, _GAIN_PER_S * self._off_rad(heading_rad))

    def _drive(
        self, observation: Observation, here_m: np.ndarray, heading_rad: float
    ) -> np.ndarray:
        """Towards the roomiest side: first to face it, then ahead as far as it is free."""
        assert self._from_m is not None
        off_rad = self._off_rad(heading_rad)
        self._is_facing = self._is_facing or abs(off_rad) < 0.05
        if not self._is_facing:
            return action_of(0.0, _GAIN_PER_S * off_rad)
        room_m = self._room_m(observation, 0.0)
        left_m = min(_WAY_M - float(np.hypot(*(here_m - self._from_m))), room_m)
        if left_m < 0.02:
            self._from_m, self._target_rad, self._turned_rad = None, None, 0.0
            return action_of(0.0, 0.0)
        # braking by 1 m/s2 takes v2 / 2
        return action_of(min(_SPEED_MPS, math.sqrt(left_m)), 0.0)

    def _notice(self, observation: Observation, heading_rad: float) -> None:
        """Remembers the best way seen in this round: how good it is [m], and its heading [rad]."""
        first, last = float(self._angles_rad[0]), float(self._angles_rad[-1])
        # with beams to either side of the way
        low, high = min(first + math.pi / 2.0, 0.0), max(last - math.pi / 2.0, 0.0)
        most = math.floor(math.pi / _APART_RAD)
        for turn_rad in (k * _APART_RAD for k in range(-most, most + 1)):
            if not low <= turn_rad <= high:
                continue
            room_m = min(self._room_m(observation, turn_rad, _CHOICE_M), _WAY_M)
            along_rad = heading_rad + turn_rad
            back = abs(math.remainder(along_rad - (self._along_rad or 0.0), math.tau)) / math.pi
            worth_m = room_m - _BACK_M * back
            if room_m >= _LEAST_WAY_M and (self._best is None or worth_m > self._best[0]):
                self._best = worth_m, along_rad

    def _room_m(self, observation: Observation, turn_rad: float, more_m: float = 0.0) -> float:
        """How far the robot can drive ahead after a turn on the spot, by its beams."""
        ranges_m = observation["scan"].astype(float)
        x = self._mount_m + ranges_m * np.cos(self._angles_rad)
        y = ranges_m * np.sin(self._angles_rad)
        c, s = math.cos(turn_rad), math.sin(turn_rad)
        ahead_m, aside_m = c * x + s * y, c * y - s * x
        width_m = KITASAP2.radius_m + _MARGIN_M + more_m
        is_in_way = (np.abs(aside_m) < width_m) & (ahead_m > 0.0)
        nearest_m = float(ahead_m[is_in_way].min(initial=math.inf))
        return max(nearest_m - width_m, 0.0)

    def _off_rad(self, heading_rad: float) -> float:
        """From the heading to the target, the shorter way round."""
        assert self._target_rad is not None
        return math.remainder(self._target_rad - heading_rad, math.tau)

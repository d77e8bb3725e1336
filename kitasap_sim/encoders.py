"""Wheel encoders: whole counts, never the true angle, and the dead reckoning a robot does on them.

`slam.odometry` does the same for any robot's data; neither package may import the other.
"""

import math
from collections.abc import Iterable

import numpy as np

from kitasap_sim.robot import KITASAP2, RobotSpec


def ticks(wheel_angles_rad: Iterable[float], ticks_per_turn: int) -> np.ndarray:
    """(2,) whole counts of the encoders at wheel angles (2,) [rad]: an edge counts once passed."""
    per_rad = ticks_per_turn / (2 * math.pi)
    return np.array([math.floor(angle * per_rad) for angle in wheel_angles_rad])


class DeadReckoning:
    """The pose that the robot itself computes from its encoders and nominal geometry.

    moved_m: along the last arc, forward.
    """

    def __init__(self, pose: np.ndarray, wheel_ticks: np.ndarray, robot: RobotSpec = KITASAP2):
        """pose: (3,) x, y [m], heading [rad] at the time of the counts (2,)."""
        self.pose = np.array(pose, dtype=float)
        self.moved_m = 0.0
        self._robot = robot
        self._ticks = (int(wheel_ticks[0]), int(wheel_ticks[1]))

    def update(self, wheel_ticks: np.ndarray) -> np.ndarray:
        """(3,) the pose after the wheels turned to new counts (2,), along an exact arc."""
        turn_m = 2 * math.pi * self._robot.wheel_radius_m / self._robot.ticks_per_turn
        (left, right), before = wheel_ticks.tolist(), self._ticks
        self._ticks = (left, right)
        left_m, right_m = (left - before[0]) * turn_m, (right - before[1]) * turn_m
        turned, self.moved_m = (right_m - left_m) / self._robot.track_m, (left_m + right_m) / 2
        # the chord of the arc: sin(a/2) / (a/2) of its length, along its middle heading
        half = turned / 2
        chord_m = self.moved_m * (math.sin(half) / half if half else 1.0)
        x, y, heading = self.pose.tolist()
        middle = heading + half
        self.pose = np.array(
            [x + chord_m * math.cos(middle), y + chord_m * math.sin(middle), heading + turned]
        )
        return self.pose.copy()

"""The baseline of `Kitasap2/GoTo-v0`: remember obstacles, plan around them, pursue the way."""

import math

import numpy as np

from experiments.policies import kernels
from experiments.policies.driving import OBSTACLES_M, Driver
from experiments.policies.local_grid import CELL_M, LocalGrid
from kitasap_sim.laser import LaserSpec
from kitasap_sim.robot import KITASAP2

_REPLAN_STEPS = 4
_AHEAD_M = 0.35
"""Chosen: how far along the way the point lies that is pursued."""
_COMFORT_M, _TOUCHING_M, _WALL_M = 0.55, 0.25, 0.10
_COMFORT_PRICE, _TIGHT_PRICE, TOUCHING_PRICE = 3.0, 15.0, 1000.0
"""Chosen: what a metre of way costs beyond its length, by the room about it. Above _COMFORT_M
nothing; less, up to the first down to the robot's radius, from there up to the second; where it
would touch something the third, not infinity: by noise obstacles look wider than they are."""
_ARRIVED_M, _LEFT_M = 0.05, 0.12
"""Of the goal: nearer than the first it turns to its heading, beyond the second it goes on."""


class Navigator:
    """Goes to poses in the odometry's frame, over a grid of what it saw.

    obstacles_m: (K, 2) what of it is near the robot, in its frame; there from the first `see` on.
    """

    def __init__(
        self, laser: LaserSpec, driver: Driver | None = None, replan_steps: int = _REPLAN_STEPS
    ) -> None:
        """replan_steps: calls after which the way is planned anew."""
        self.grid = LocalGrid(laser)
        self.driver = driver or Driver()
        self._replan_steps = replan_steps
        self.reset()

    def reset(self) -> None:
        """Nothing is known."""
        self.grid.reset()
        self.driver.reset()
        self._steps = 0
        self._goal_m: np.ndarray | None = None
        self._is_there = False

    def see(self, observation: dict[str, np.ndarray]) -> None:
        """Remembers what the scan tells."""
        self.grid.update(observation)
        self._velocity = observation["velocity"]
        self.obstacles_m = self.grid.obstacles_near(OBSTACLES_M)

    def goal(self, observation: dict[str, np.ndarray]) -> tuple[np.ndarray, float]:
        """Point (2,) and heading of the goal that is observed, in the odometry's frame.

        It is asked for once: what is told later drifts with the odometry; the grid does not.
        """
        x, y, c, s = observation["goal"].tolist()
        goal_m = self.grid.from_robot(np.array([x, y]))
        return goal_m, float(self.grid.pose[2]) + math.atan2(s, c)

    def go_to(self, goal_m: np.ndarray, heading_rad: float | None) -> np.ndarray:
        """(2,) action towards a point (2,) of the odometry's frame, and, there, to a heading."""
        grid = self.grid
        off_m = math.hypot(*(goal_m - grid.pose[:2]).tolist())
        self._is_there = off_m < (_LEFT_M if self._is_there else _ARRIVED_M)
        if self._is_there:
            if heading_rad is None:
                return np.zeros(2, dtype=np.float32)
            angle_rad = math.remainder(heading_rad - float(grid.pose[2]), math.tau)
            return self.driver.turning(angle_rad, self._velocity, self.obstacles_m)
        target_m = self.points_ahead(goal_m, (_AHEAD_M,))[0]
        most_mps = math.sqrt(2.0 * 0.5 * off_m)  # stops there with half the deceleration
        return self.driver.towards(target_m, self._velocity, self.obstacles_m, most_mps)

    def points_ahead(self, goal_m: np.ndarray, ahead_m: tuple[float, ...]) -> np.ndarray:
        """(K, 2) points of the way to a goal (2,), so far away each, in the robot's frame [m]."""
        self._plan(goal_m)
        corner = np.array(self._window[:2])
        here = (self.grid.cell(self.grid.pose[:2]) - corner).clip(0, np.array(self.costs.shape) - 1)
        count = round(2.5 * max(ahead_m) / CELL_M) + 12
        way = kernels.way_down(self.costs, here, count)
        points_m = self.grid.middles_m(way + corner)
        far_m = np.hypot(*(points_m - self.grid.pose[:2]).T)
        chosen = []
        for least_m in ahead_m:
            beyond = np.flatnonzero(far_m >= least_m)
            point_m = points_m[beyond[0]] if beyond.size else goal_m
            chosen.append(self.grid.in_robot(point_m))
        return np.array(chosen)

    def _plan(self, goal_m: np.ndarray) -> None:
        is_same = self._goal_m is not None and math.dist(goal_m, self._goal_m) < 0.5 * CELL_M
        self._steps += 1
        if is_same and self._steps % self._replan_steps:
            return
        self._goal_m = goal_m
        self._window = self.grid.window(goal_m)
        corner = np.array(self._window[:2])
        self.costs = kernels.costs_to(
            prices(self.grid.clearance_m(self._window)), (self.grid.cell(goal_m) - corner)[None]
        )


def prices(clearance_m: np.ndarray) -> np.ndarray:
    """Per cell of way, by the room about the cells; inf within walls."""
    comfort = np.interp(clearance_m, [KITASAP2.radius_m, _COMFORT_M], [_COMFORT_PRICE, 0.0])
    tight = np.interp(
        clearance_m, [_TOUCHING_M, KITASAP2.radius_m], [_TIGHT_PRICE - _COMFORT_PRICE, 0.0]
    )
    extra = np.where(clearance_m < _TOUCHING_M, TOUCHING_PRICE, comfort + tight)
    return np.where(clearance_m < _WALL_M, np.inf, 1.0 + extra)


class GoToBaseline:
    """Plans on what the scans showed so far; what was not seen counts as free."""

    def __init__(self, laser: LaserSpec) -> None:
        self._navigator = Navigator(laser)
        self.reset()

    def reset(self) -> None:
        """Forgets the last episode."""
        self._navigator.reset()
        self._goal: tuple[np.ndarray, float] | None = None

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """(2,) action."""
        self._navigator.see(observation)
        if self._goal is None:
            self._goal = self._navigator.goal(observation)
        return self._navigator.go_to(*self._goal)

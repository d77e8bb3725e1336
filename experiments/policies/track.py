"""The baseline of `Kitasap2/Track-v0`: pure pursuit, slower where the path bends."""

import math

import numpy as np

from experiments.policies.driving import OBSTACLES_M, Driver
from experiments.policies.local_grid import LocalGrid
from kitasap_sim.env.motors import MAX_SPEED_MPS
from kitasap_sim.laser import LaserSpec
from slam.se2 import SE2

_SIDEWAYS_MPS2 = 0.35
"""Chosen: how fast bends are driven."""
_SLOW_MPS = 0.15
_SPACING_M = 0.2
_AHEAD_M = _SPACING_M * np.arange(1, 6)
_REACH_M = 0.6
"""Chosen: so far on the nearest point of the path is looked for: a path may cross itself."""
_APART_M = 0.01


class TrackBaseline:
    """Pursues the point 0.4 m ahead, where the path bends 0.2 m; stops before people.

    The path is observed by an odometry that drifts. Seen from the start it stands still: so it is
    remembered, and followed by the pose that the scans hold.
    """

    def __init__(self, laser: LaserSpec) -> None:
        self._grid = LocalGrid(laser)
        self._driver = Driver()
        self.reset()

    def reset(self) -> None:
        """Forgets the last episode."""
        self._grid.reset()
        self._driver.reset()
        # the path as far as it was seen, from the start: corners [m] and the lengths along it there
        self._corners_m = np.zeros((1, 2))
        self._at_m = np.zeros(1)
        self._along_m = 0.0

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """(2,) action."""
        self._grid.update(observation)
        self._remember(observation)
        path_m = self._ahead()
        turns_rad = _turns_rad(path_m)
        # where a corner comes within the nearer points, the near one is pursued: less is cut
        bends_soon = float(turns_rad[:2].max(initial=0.0))
        target_m = path_m[0] if bends_soon > 0.3 else path_m[1]
        obstacles_m, velocity = self._grid.obstacles_near(OBSTACLES_M), observation["velocity"]
        return self._driver.towards(target_m, velocity, obstacles_m, _most_mps(path_m, turns_rad))

    def _remember(self, observation: dict[str, np.ndarray]) -> None:
        """Adds what came in view of the path; at first all five points, then the last of them."""
        T_start_believed = SE2.from_array(observation["odometry"].astype(float))
        seen_m = T_start_believed @ observation["path"].astype(float).reshape(-1, 2)
        # the nearest point jumps where the path returns: then more than the last one is new
        jump_m = math.dist(seen_m[-1], self._corners_m[-1])
        new = len(seen_m) if len(self._at_m) == 1 else 1 + int(jump_m / _SPACING_M)
        for corner_m in seen_m[-new:]:
            further_m = math.dist(corner_m, self._corners_m[-1])
            if further_m > _APART_M:
                self._corners_m = np.concatenate([self._corners_m, corner_m[None]])
                self._at_m = np.append(self._at_m, self._at_m[-1] + further_m)

    def _ahead(self) -> np.ndarray:
        """(5, 2) points of the path ahead of the nearest, in the robot's frame [m]."""
        reach_m = np.arange(self._along_m, self._along_m + _REACH_M, _APART_M)
        points_m = self._points(reach_m.clip(max=self._at_m[-1]))
        off_m = np.hypot(*(points_m - self._grid.pose[:2]).T)
        self._along_m = min(float(reach_m[int(off_m.argmin())]), float(self._at_m[-1]))
        ahead_m = self._points((self._along_m + _AHEAD_M).clip(max=self._at_m[-1]))
        return np.array([self._grid.in_robot(point_m) for point_m in ahead_m])

    def _points(self, along_m: np.ndarray) -> np.ndarray:
        x, y = (np.interp(along_m, self._at_m, values) for values in self._corners_m.T)
        return np.stack([x, y], axis=1)


def _turns_rad(path_m: np.ndarray) -> np.ndarray:
    """By how much a path (5, 2) turns from leg to leg; legs without length are left out."""
    legs_m = np.diff(path_m, axis=0)
    is_leg = np.hypot(*legs_m.T) > 1e-3
    headings = np.arctan2(legs_m[:, 1], legs_m[:, 0])[is_leg]
    result: np.ndarray = np.abs((np.diff(headings) + math.pi) % math.tau - math.pi)
    return result


def _most_mps(path_m: np.ndarray, turns_rad: np.ndarray) -> float:
    """So fast the robot may be, to brake in time for the path's bends and for its end."""
    end_m = math.hypot(*path_m[-1].tolist())
    most_mps = min(MAX_SPEED_MPS, math.sqrt(2.0 * 0.5 * (end_m + 0.05)))
    for k, turn_rad in enumerate(turns_rad.tolist()):
        # a corner is a bend over one spacing of the points; before it there is time to brake
        bend_mps = max(_SLOW_MPS, math.sqrt(_SIDEWAYS_MPS2 * _SPACING_M / max(turn_rad, 1e-3)))
        most_mps = min(most_mps, math.sqrt(bend_mps**2 + 2.0 * 0.5 * _SPACING_M * k))
    return most_mps

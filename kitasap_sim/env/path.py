"""A path to be followed: where along it one is, and what comes next."""

import math

import numpy as np

from kitasap_sim.env.kernels import leg_at, nearest_along, seen_along

_REACH_M = 0.6
"""Chosen: so far along the nearest point is looked for: a path may cross itself. Never back: where
it returns beside itself, who follows it would be taken back along the leg that is behind."""
_WORLD = np.zeros(3)


class Path:
    """A polyline through corners (K, 2) [m]; repeated corners count once.

    Raises ValueError for one without any length.
    """

    def __init__(self, corners_m: np.ndarray) -> None:
        is_new = np.append(True, np.hypot(*np.diff(corners_m, axis=0).T) > 1e-9)
        self.corners_m = np.ascontiguousarray(corners_m[is_new], dtype=float)
        if len(self.corners_m) < 2:
            raise ValueError(f"a path needs two corners apart from each other, not {corners_m}")
        lengths_m = np.hypot(*np.diff(self.corners_m, axis=0).T)
        self._at_m = np.append(0.0, np.cumsum(lengths_m))
        self.length_m = float(self._at_m[-1])

    def at(self, along_m: float) -> tuple[float, float]:
        """The point at a length along it; its ends beyond."""
        x, y = self.seen(np.array([along_m]), _WORLD)[0].tolist()
        return x, y

    def seen(self, lengths_m: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """(L, 2) points at lengths (L,) along it, its ends beyond, in the frame of a pose (3,)."""
        points_m = np.empty((len(lengths_m), 2))
        seen_along(self.corners_m, self._at_m, lengths_m, pose, points_m)
        return points_m

    def heading_rad(self, along_m: float) -> float:
        """Where it leads at a length along it."""
        leg = leg_at(self._at_m, float(along_m))
        dx, dy = (self.corners_m[leg + 1] - self.corners_m[leg]).tolist()
        return math.atan2(dy, dx)

    def nearest(self, point_m: np.ndarray, near_m: float) -> tuple[float, float]:
        """Length along it, from near_m on, of the point nearest to a point (2,); how far [m]."""
        high_m = min(near_m + _REACH_M, self.length_m)
        result: tuple[float, float] = nearest_along(
            self.corners_m, self._at_m, float(point_m[0]), float(point_m[1]), float(near_m), high_m
        )
        return result

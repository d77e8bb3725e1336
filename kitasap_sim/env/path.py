"""A path to be followed: where along it one is, and what comes next."""

import math
from bisect import bisect_right
from collections.abc import Iterable

import numpy as np

_REACH_M = 0.6
"""Chosen: so far along the nearest point is looked for: a path may cross itself. Never back: where
it returns beside itself, who follows it would be taken back along the leg that is behind."""


class Path:
    """A polyline through corners (K, 2) [m]; repeated corners count once.

    Raises ValueError for one without any length.
    """

    def __init__(self, corners_m: np.ndarray) -> None:
        is_new = np.append(True, np.hypot(*np.diff(corners_m, axis=0).T) > 1e-9)
        self.corners_m = corners_m[is_new]
        if len(self.corners_m) < 2:
            raise ValueError(f"a path needs two corners apart from each other, not {corners_m}")
        lengths_m = np.hypot(*np.diff(self.corners_m, axis=0).T)
        self._at_m = [0.0, *np.cumsum(lengths_m).tolist()]
        self._corners = self.corners_m.tolist()
        self.length_m: float = self._at_m[-1]

    def at(self, along_m: float) -> tuple[float, float]:
        """The point at a length along it; its ends beyond."""
        leg, share = self._leg(along_m)
        (x0, y0), (x1, y1) = self._corners[leg], self._corners[leg + 1]
        return x0 + share * (x1 - x0), y0 + share * (y1 - y0)

    def points(self, lengths_m: Iterable[float]) -> list[tuple[float, float]]:
        """The points at lengths along it that do not fall; its ends beyond."""
        at_m, corners = self._at_m, self._corners
        leg, last, found = 0, len(corners) - 2, []
        for along_m in lengths_m:
            while leg < last and at_m[leg + 1] <= along_m:
                leg += 1
            share = min(max((along_m - at_m[leg]) / (at_m[leg + 1] - at_m[leg]), 0.0), 1.0)
            (x0, y0), (x1, y1) = corners[leg], corners[leg + 1]
            found.append((x0 + share * (x1 - x0), y0 + share * (y1 - y0)))
        return found

    def heading_rad(self, along_m: float) -> float:
        """Where it leads at a length along it."""
        leg, _ = self._leg(along_m)
        (x0, y0), (x1, y1) = self._corners[leg], self._corners[leg + 1]
        return math.atan2(y1 - y0, x1 - x0)

    def nearest(self, point_m: np.ndarray, near_m: float) -> tuple[float, float]:
        """Length along it, from near_m on, of the point nearest to a point (2,); how far [m]."""
        px, py = float(point_m[0]), float(point_m[1])
        low_m, high_m = near_m, min(near_m + _REACH_M, self.length_m)
        best_m, best_off_m = near_m, math.inf
        for leg in range(self._leg(low_m)[0], self._leg(high_m)[0] + 1):
            (x0, y0), (x1, y1) = self._corners[leg], self._corners[leg + 1]
            start_m, end_m = self._at_m[leg], self._at_m[leg + 1]
            length_m = end_m - start_m
            along_m = ((px - x0) * (x1 - x0) + (py - y0) * (y1 - y0)) / length_m
            along_m = min(max(along_m, low_m - start_m, 0.0), high_m - start_m, length_m)
            share = along_m / length_m
            off_m = math.hypot(px - x0 - share * (x1 - x0), py - y0 - share * (y1 - y0))
            if off_m < best_off_m:
                best_m, best_off_m = start_m + along_m, off_m
        return best_m, best_off_m

    def _leg(self, along_m: float) -> tuple[int, float]:
        """The leg on which a length lies, and the share of it that is behind."""
        leg = bisect_right(self._at_m, along_m, 1, len(self._at_m) - 1) - 1
        start_m, end_m = self._at_m[leg], self._at_m[leg + 1]
        return leg, min(max((along_m - start_m) / (end_m - start_m), 0.0), 1.0)

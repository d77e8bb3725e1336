"""Where people walk: tracks between waypoints of a place, and where the feet go on them."""

import math
from dataclasses import dataclass, field

import numpy as np

from kitasap_sim.places import Place

Point = tuple[float, float]

_SPACING_M = 0.02
_ASIDE_M = 0.10
"""Of each foot from the middle; chosen: feet 20 cm apart, as wide as hips."""
_STEP_M = 0.6
"""Chosen: a grown person's at a stroll."""
_TURN_M = 0.3
"""Chosen: corners are rounded for the feet over half a step on either side."""
_WAYPOINTS_APART_M = 1.0
_SPOTS_AT_ONCE = 1000


@dataclass(frozen=True)
class Track:
    """A way walked in equal steps, the feet beside each other after each whole one.

    centre_m, left_m, right_m: points at equal lengths along the way, the middle's and each foot's.
    headings_rad: of the feet there, not wrapped. All lengths are along the middle [m].
    """

    start: int
    goal: int
    length_m: float
    step_m: float
    centre_m: tuple[Point, ...] = field(repr=False)
    left_m: tuple[Point, ...] = field(repr=False)
    right_m: tuple[Point, ...] = field(repr=False)
    headings_rad: tuple[float, ...] = field(repr=False)

    @classmethod
    def along(cls, corners_m: np.ndarray, start: int, goal: int) -> "Track":
        """The track through corners (W, 2), from one waypoint's number to another's."""
        legs_m = np.linalg.norm(np.diff(corners_m, axis=0), axis=1)
        at_m = np.concatenate([[0.0], np.cumsum(legs_m)])
        length_m = float(at_m[-1])
        s = np.linspace(0, length_m, round(length_m / _SPACING_M) + 1)

        def middle(s: np.ndarray) -> np.ndarray:
            return np.stack([np.interp(s, at_m, corners_m[:, i]) for i in (0, 1)], axis=1)

        ahead = middle(s + _TURN_M) - middle(s - _TURN_M)
        headings = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
        aside = _ASIDE_M * np.stack([-np.sin(headings), np.cos(headings)], axis=1)
        centre = middle(s)
        return cls(
            start, goal, length_m, length_m / max(1, round(length_m / _STEP_M)),
            _points(centre), _points(centre + aside), _points(centre - aside),
            tuple(headings.tolist()),
        )  # fmt: skip

    def middle_m(self, along_m: float) -> Point:
        """The middle at a length along the way, the nearer end beyond."""
        return self._between(self.centre_m, along_m)

    def feet_m(self, along_m: float) -> tuple[float, float]:
        """How far along the left and the right foot are when the body is so far along.

        One stands while the other swings past it; a swing starts and ends without a jerk.
        """
        steps = along_m / self.step_m
        standing = math.floor(steps + 0.5)
        share = steps + 0.5 - standing
        swinging = standing - 1 + 2 * share * share * (3 - 2 * share)
        left, right = (standing, swinging) if standing % 2 == 0 else (swinging, standing)
        return left * self.step_m, right * self.step_m

    def legs(self, along_m: float) -> tuple[Point, Point, float, float]:
        """Where left and right leg stand, and their headings, when the body is so far along."""
        left_m, right_m = self.feet_m(along_m)
        return (
            self._between(self.left_m, left_m),
            self._between(self.right_m, right_m),
            self.heading_rad(left_m),
            self.heading_rad(right_m),
        )

    def heading_rad(self, along_m: float) -> float:
        """Of a foot at a length along the way."""
        last = len(self.headings_rad) - 1
        index = round(along_m / self.length_m * last)
        return self.headings_rad[min(max(index, 0), last)]

    def _between(self, points_m: tuple[Point, ...], along_m: float) -> Point:
        at = along_m / self.length_m * (len(points_m) - 1)
        first = min(max(int(at), 0), len(points_m) - 2)
        share = min(max(at - first, 0.0), 1.0)
        (x, y), (next_x, next_y) = points_m[first], points_m[first + 1]
        return x + share * (next_x - x), y + share * (next_y - y)


class Tracks:
    """Waypoints drawn from a place's free space, and the tracks between them, made when asked for.

    Raises ValueError if the place has no two waypoints a metre apart.
    """

    def __init__(self, place: Place, count: int, rng: np.random.Generator) -> None:
        self._place = place
        self._made: dict[tuple[int, int], Track] = {}
        spots_m = rng.permutation(place.free_centres_m)
        chosen: list[np.ndarray] = []
        # in parts: the first few hundred spots give as many waypoints as are asked for
        for first in range(0, len(spots_m), _SPOTS_AT_ONCE):
            left_m = spots_m[first : first + _SPOTS_AT_ONCE]
            for waypoint_m in chosen:
                left_m = _apart(left_m, waypoint_m)
            while len(left_m) and len(chosen) < count:
                chosen.append(left_m[0])
                left_m = _apart(left_m, left_m[0])
            if len(chosen) == count:
                break
        if len(chosen) < 2:
            raise ValueError(f"place {place.name} is too small for people to walk in")
        self._waypoints_m = np.array(chosen)

    def __len__(self) -> int:
        return len(self._waypoints_m)

    def between(self, start: int, goal: int) -> Track:
        """The track from one waypoint to another, by their numbers."""
        if (start, goal) not in self._made:
            there, back = min(start, goal), max(start, goal)
            corners_m = self._place.way(self._waypoints_m[there], self._waypoints_m[back])
            # one way for both directions: who turns round goes back where she came from
            self._made[there, back] = Track.along(corners_m, there, back)
            self._made[back, there] = Track.along(corners_m[::-1], back, there)
        return self._made[start, goal]

    def from_waypoint(self, start: int) -> list[Track]:
        """All tracks that set out there."""
        return [self.between(start, goal) for goal in range(len(self)) if goal != start]

    def draw(self, start: int, rng: np.random.Generator) -> Track:
        """One of the tracks that set out there."""
        goal = int(rng.integers(len(self) - 1))
        return self.between(start, goal + (goal >= start))


def _points(points_m: np.ndarray) -> tuple[Point, ...]:
    return tuple(map(tuple, points_m.tolist()))


def _apart(spots_m: np.ndarray, waypoint_m: np.ndarray) -> np.ndarray:
    """Those of spots (K, 2) that are far enough from a waypoint (2,)."""
    result: np.ndarray = spots_m[np.hypot(*(spots_m - waypoint_m).T) >= _WAYPOINTS_APART_M]
    return result

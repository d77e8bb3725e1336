"""`Kitasap2/Track-v0`: follow a path at speed."""

import itertools
import math
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from kitasap_sim.env.base import SUCCESS_REWARD, KitasapEnv, Observation, box
from kitasap_sim.env.checks import finite_numbers, number_between
from kitasap_sim.env.path import Path
from kitasap_sim.places import Place

_AHEAD_M = np.array([0.2, 0.4, 0.6, 0.8, 1.0])
_FARTHEST_M = 100.0
_LEGS, _LEAST_LEG_M, _TRIES = 3, 1.5, 200
"""Of a path that is drawn: free spots so far apart, joined by ways that can be driven."""
_ASIDE_COST = 0.5
STEP_COST = 0.005


class TrackEnv(KitasapEnv):
    """Drive along a path to its end, near it and fast.

    The path is the place's own scripted track where it has one, else ways between four free spots.

    ## Action, keywords, and the rest of observation and info: see `KitasapEnv`

    ## Observation: besides `scan`, `odometry`, `velocity` and `last_action`

    | key | shape | bounds | what |
    |---|---|---|---|
    | `path` | (10,) | +-100 m | x, y [m] in the robot's frame of five points of the path |

    The points lie 0.2, 0.4, 0.6, 0.8 and 1 m ahead of the nearest, or at the path's end, where it
    ends before; by the encoders since the start, which drift.

    ## Reward: the sum of `reward_terms`

    | term | what |
    |---|---|
    | `progress` | way along the path since the last step [m] |
    | `aside` | -0.5 per metre beside the path and second |
    | `time` | -0.005 |
    | `success` | 5 once, at the end of the path |
    | `collision` | -5 once, also for leaving the path |

    ## Start, termination, truncation

    Start: at rest on the first point of the path, along it; `reset(options={"path": (K, 2) corners
    [m], "place": ...})` sets it. Terminated: within 0.15 m of the end with all of the path behind
    it (`is_success`), farther than `most_aside_m` from the path, or at a collision. Truncated:
    after 1600 steps (80 s).

    ## Info: besides that of `KitasapEnv`

    `aside_m`: from the path; `along_m`: of it; `length_m`: of all of it; `mean_aside_m`: so far.

    ## Keywords: besides those of `KitasapEnv`

    `most_aside_m`: from the path, 0.5 by default.
    """

    OPTIONS: ClassVar[tuple[str, ...]] = ("path", "place")
    TERMS: ClassVar[tuple[str, ...]] = ("progress", "aside", "time", "success", "collision")

    def __init__(
        self, render_mode: str | None = None, *, most_aside_m: float = 0.5, **keywords: Any
    ) -> None:
        """Raises ValueError, naming the keyword, for a value that makes no sense."""
        super().__init__(render_mode, **keywords)
        self._most_aside_m = number_between(most_aside_m, 0.05, 10.0, "most_aside_m")

    def _spaces(self) -> dict[str, spaces.Box]:
        return {"path": box([-_FARTHEST_M] * (2 * len(_AHEAD_M)))}

    def _begin(self, options: dict[str, Any]) -> np.ndarray:
        if "path" in options:
            expected = "path: (K, 2) finite corners, two at least"
            corners_m = finite_numbers(options["path"], (None, 2), expected)
            if len(corners_m) < 2:
                raise ValueError(f"{expected}, not {options['path']!r}")
        elif len(self.place.track_m) >= 2:
            corners_m = self.place.track_m
        else:
            corners_m = _drawn(self.place, self.np_random)
        for start_m, end_m in itertools.pairwise(corners_m):
            if not self.place.is_way_free(start_m, end_m):
                raise ValueError(
                    f"path: something stands between ({start_m[0]:.2f}, {start_m[1]:.2f}) and"
                    f" ({end_m[0]:.2f}, {end_m[1]:.2f}) of {self.place.name}"
                )
        self._path = Path(corners_m)
        return np.array([*corners_m[0], self._path.heading_rad(0.0)])

    def _started(self) -> None:
        # what the robot believes runs along with what is true
        self._along_m = self._believed_m = 0.0
        self._aside_m = self._aside_sum_m = 0.0
        self._count = 0

    def _rewarded(self) -> tuple[dict[str, float], bool, bool]:
        before_m = self._along_m
        self._along_m, self._aside_m = self._path.nearest(self._pose[:2], self._along_m)
        self._count += 1
        self._aside_sum_m += self._aside_m
        is_off = self._aside_m > self._most_aside_m
        end_m = math.hypot(*(self._pose[:2] - self._path.corners_m[-1]).tolist())
        is_done = end_m < 0.15 and self._path.length_m - self._along_m < 0.15
        self._collided = self._collided or is_off
        terms = {
            "progress": self._along_m - before_m,
            "aside": -_ASIDE_COST * self._aside_m / self.metadata["render_fps"],
            "time": -STEP_COST,
            "success": SUCCESS_REWARD if is_done and not self._collided else 0.0,
        }
        return terms, is_done, is_done

    @property
    def path(self) -> Path:
        """Of this episode, in the world: what the robot is to follow."""
        return self._path

    def _observed(self) -> Observation:
        believed = self._last_odometry
        self._believed_m, _ = self._path.nearest(believed[:2], self._believed_m)
        return {"path": path_ahead(self._path, believed, self._believed_m)}

    def _told(self) -> dict[str, Any]:
        return {
            "aside_m": self._aside_m,
            "along_m": self._along_m,
            "length_m": self._path.length_m,
            "mean_aside_m": self._aside_sum_m / max(self._count, 1),
        }

    def _marks(self) -> list[tuple[np.ndarray, tuple[float, float, float]]]:
        spots = np.arange(0.0, self._path.length_m, 0.25)
        return [(np.array(self._path.at(float(s))), (0.1, 0.65, 0.25)) for s in spots]


def path_ahead(path: Path, pose: np.ndarray, along_m: float) -> np.ndarray:
    """(10,) the observation `path` of a robot that believes to be at a pose (3,), so far along."""
    seen_m = path.seen(along_m + _AHEAD_M, pose).ravel().astype(np.float32)
    np.minimum(seen_m, _FARTHEST_M, out=seen_m)
    return np.maximum(seen_m, -_FARTHEST_M, out=seen_m)


def _drawn(place: Place, rng: np.random.Generator) -> np.ndarray:
    """(K, 2) corners of ways between free spots. Raises ValueError in a place too small for one."""
    ways = [place.draw_free_pose(rng)[None, :2]]
    for _ in range(_TRIES):
        here, there = ways[-1][-1], place.draw_free_pose(rng)[:2]
        if math.hypot(*(there - here).tolist()) < _LEAST_LEG_M:
            continue
        ways.append(place.way(here, there)[1:])
        if len(ways) > _LEGS:
            return np.concatenate(ways)
    raise ValueError(
        f"place {place.name} is too small for a path of {_LEGS} legs of {_LEAST_LEG_M} m"
    )

"""`Kitasap2/GoTo-v0`: reach a goal pose among obstacles."""

import math
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from kitasap_sim.env.base import SUCCESS_REWARD, KitasapEnv, Observation, box, seen_from
from kitasap_sim.env.checks import finite_numbers, number_between
from kitasap_sim.env.distance import Distance

_LEAST_WAY_M = 1.5
"""From start to goal; chosen."""
_FARTHEST_M = 100.0
_TRIES = 200
STEP_COST = 0.01
_FACING_M = 0.5
"""Chosen: so near the goal, turning towards its heading begins to count."""
_FACING_WORTH = 0.3


class GoToEnv(KitasapEnv):
    """Reach a goal pose: within `tolerance` (0.2 m and 0.35 rad by default) of it.

    Start and goal are drawn in free space, 1.5 m or more apart; there always is a way between them.

    ## Action, keywords, and the rest of observation and info: see `KitasapEnv`

    ## Observation: besides `scan`, `odometry`, `velocity` and `last_action`

    | key | shape | bounds | what |
    |---|---|---|---|
    | `goal` | (4,) | +-100 m, +-1 | x, y [m], cosine, sine of its heading, in the robot's frame |

    The goal is where the encoders have it since the start; they drift.

    ## Reward: the sum of `reward_terms`

    | term | what |
    |---|---|
    | `progress` | by how much the way to the goal became shorter [m]; near it, the turn as well |
    | `time` | -0.01 |
    | `success` | 5 once, at the goal |
    | `collision` | -5 once |

    The way is counted along the grid's axes: a diagonal counts 1.41 times. Within 0.5 m of the goal
    a radian less to turn counts as well, from nothing at 0.5 m to 0.3 at the goal.

    ## Start, termination, truncation

    Start: at rest, any heading; `reset(options={"pose": ..., "goal": (x, y, heading),
    "place": ...})` sets it. Terminated: at the goal (`is_success`) or at a collision. Truncated:
    after 800 steps (40 s).

    ## Info: besides that of `KitasapEnv`

    `goal_true` (3,): the goal in the world; `way_m`: what is left to it, as in `progress`;
    `straight_m`.

    ## Keywords: besides those of `KitasapEnv`

    `tolerance`: (metres, radians) within which the goal counts as reached; pi leaves the heading
    open.
    """

    OPTIONS: ClassVar[tuple[str, ...]] = ("pose", "goal", "place")
    TERMS: ClassVar[tuple[str, ...]] = ("progress", "time", "success", "collision")

    def __init__(
        self,
        render_mode: str | None = None,
        *,
        tolerance: tuple[float, float] = (0.2, 0.35),
        **keywords: Any,
    ) -> None:
        """Raises ValueError, naming the keyword, for a value that makes no sense."""
        super().__init__(render_mode, **keywords)
        within_m, within_rad = finite_numbers(tolerance, (2,), "tolerance: metres and radians")
        self._within_m = number_between(within_m, 0.01, 10.0, "tolerance, metres")
        self._within_rad = number_between(within_rad, 0.01, 4.0, "tolerance, radians")

    def _spaces(self) -> dict[str, spaces.Box]:
        return {"goal": box([-_FARTHEST_M, -_FARTHEST_M, -1.0, -1.0])}

    def _begin(self, options: dict[str, Any]) -> np.ndarray:
        pose, goal = self._checked_pose(options, "pose"), self._checked_pose(options, "goal")
        for _ in range(_TRIES):
            start = self.place.draw_free_pose(self.np_random) if pose is None else pose
            self._goal = self.place.draw_free_pose(self.np_random) if goal is None else goal
            if pose is not None and goal is not None:
                break
            if math.hypot(*(start - self._goal)[:2].tolist()) >= _LEAST_WAY_M:
                break
        else:
            raise ValueError(
                f"place {self.place.name}: {_TRIES} starts and goals drawn lie nearer than"
                f" {_LEAST_WAY_M} m to each other; give a larger place, or both as options"
            )
        self._distance = Distance(self.place, self._goal[:2])
        return start

    def _started(self) -> None:
        self._left = self._to_go()

    def _rewarded(self) -> tuple[dict[str, float], bool, bool]:
        left = self._to_go()
        progress, self._left = self._left - left, left
        is_there = self._straight_m <= self._within_m and self._off_rad <= self._within_rad
        terms = {
            "progress": progress,
            "time": -STEP_COST,
            "success": SUCCESS_REWARD if is_there and not self._collided else 0.0,
        }
        return terms, is_there, is_there

    def _to_go(self) -> float:
        """What is left to do: metres, and near the goal radians."""
        self._way_m = self._distance.at(self._pose[0], self._pose[1])
        x, y, turn_rad = seen_from(self._goal, self._pose)
        self._straight_m, self._off_rad = math.hypot(x, y), abs(turn_rad)
        nearness = max(0.0, 1.0 - self._straight_m / _FACING_M)
        return self._way_m - _FACING_WORTH * nearness * (math.pi - self._off_rad)

    def _observed(self) -> Observation:
        x, y, theta = seen_from(self._last_odometry, self._goal)
        x, y = (max(-_FARTHEST_M, min(_FARTHEST_M, value)) for value in (x, y))
        return {"goal": np.array([x, y, math.cos(theta), math.sin(theta)], dtype=np.float32)}

    def _told(self) -> dict[str, Any]:
        return {
            "goal_true": self._goal.copy(),
            "way_m": self._way_m,
            "straight_m": self._straight_m,
        }

    def _marks(self) -> list[tuple[np.ndarray, tuple[float, float, float]]]:
        return [(self._goal, (0.1, 0.65, 0.25))]

"""`Kitasap2/Explore-v0`: see as much of an unknown place as possible."""

import math
from typing import Any, ClassVar

import numpy as np

from kitasap_sim.env.base import SUCCESS_REWARD, KitasapEnv
from kitasap_sim.env.checks import number_between
from kitasap_sim.env.motors import CONTROL_S

_CELL_M = 0.1
"""Of what is counted as seen; chosen."""
_SPOTS_CELLS, _RAYS, _RAY_STEP = 3, 120, 0.5
"""Chosen: from spots 0.3 m apart, all around by 3 degrees, half a cell of the free space at a time, it
is told what can be seen at all."""
_SEEN_WORTH = 1.0
STEP_COST = 0.005


class ExploreEnv(KitasapEnv):
    """See `share` (0.95 by default) of all that the beams can reach from where the robot can drive.

    The floor is counted in cells of 0.1 m; one is seen when a beam has gone through it, each from
    where the robot was when it was fired. The robot
    is told nothing of the place: what it has seen it must remember itself.

    ## Action, keywords, observation and info: see `KitasapEnv`

    ## Reward: the sum of `reward_terms`

    | term | what |
    |---|---|
    | `seen` | floor seen for the first time [m2] |
    | `time` | -0.005 |
    | `success` | 5 once, when the share is seen |
    | `collision` | -5 once |

    ## Start, termination, truncation

    Start: at rest, anywhere; `reset(options={"pose": ..., "place": ...})` sets it. Terminated: when
    the share is seen (`is_success`) or at a collision. Truncated: after 2400 steps (2 minutes).

    ## Info: besides that of `KitasapEnv`

    `seen_share`: of the floor that can be seen; `seen_m2`.

    ## Keywords: besides those of `KitasapEnv`

    `share`: of the floor that ends an episode.
    """

    TERMS: ClassVar[tuple[str, ...]] = ("seen", "time", "success", "collision")

    def __init__(
        self, render_mode: str | None = None, *, share: float = 0.95, **keywords: Any
    ) -> None:
        """Raises ValueError, naming the keyword, for a value that makes no sense."""
        super().__init__(render_mode, **keywords)
        self._share = number_between(share, 1e-6, 1.0, "share")
        # not before somebody explores: it takes numba half a second
        from kitasap_sim.env.kernels import look_around, see

        self._see, self._look_around = see, look_around
        self._angles_rad = self.laser.angles_rad
        self._shares = self.laser.delays_s() / CONTROL_S
        self._mount_m = self.laser.mount_m[:2]

    def _begin(self, options: dict[str, Any]) -> np.ndarray:
        pose = self._checked_pose(options, "pose")
        return self.place.draw_free_pose(self.np_random) if pose is None else pose

    def _started(self) -> None:
        is_open, self._origin_m, cell_m = self.place.open_floor()
        share = cell_m / _CELL_M
        self._is_left = np.zeros(np.ceil(np.array(is_open.shape) * share).astype(int) + 1, bool)
        spots = (self.place.free_centres_m - self._origin_m) / cell_m
        _, first = np.unique((spots * share).astype(int) // _SPOTS_CELLS, axis=0, return_index=True)
        self._look_around(
            is_open, spots[first], _RAYS, self._range_m / cell_m, _RAY_STEP, share, self._is_left
        )
        self._to_see = max(int(np.count_nonzero(self._is_left)), 1)
        self._count, self._at = 0, self._laser_at()
        self._look()

    def _rewarded(self) -> tuple[dict[str, float], bool, bool]:
        before = self._count
        self._look()
        is_done = self._count >= self._share * self._to_see
        terms = {
            "seen": _SEEN_WORTH * (self._count - before) * _CELL_M**2,
            "time": -STEP_COST,
            "success": SUCCESS_REWARD if is_done and not self._collided else 0.0,
        }
        return terms, is_done, is_done

    def _look(self) -> None:
        """Counts the cells that the beams of this step went through."""
        before, self._at = self._at, self._laser_at()
        # the short way round
        self._at[2] = before[2] + math.remainder(self._at[2] - before[2], math.tau)
        self._count += self._see(
            self._is_left, before, self._at, self._shares, self._angles_rad,
            self._ranges_m / _CELL_M, self._range_m / _CELL_M,
        )  # fmt: skip

    def _laser_at(self) -> np.ndarray:
        """(3,) row and column of the laser in the cells that count, and its heading [rad]."""
        x, y, theta = self._pose.tolist()
        (mount_x, mount_y), (x0, y0) = self._mount_m, self._origin_m
        c, s = math.cos(theta), math.sin(theta)
        row, column = x + c * mount_x - s * mount_y - x0, y + s * mount_x + c * mount_y - y0
        return np.array([row / _CELL_M, column / _CELL_M, theta])

    def _told(self) -> dict[str, Any]:
        return {
            "seen_share": self._count / self._to_see,
            "seen_m2": self._count * _CELL_M**2,
        }

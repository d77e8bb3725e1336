"""`Kitasap2/Explore-v0`: see as much of an unknown place as possible."""

import math
from typing import Any, ClassVar

import numpy as np

from kitasap_sim.env.base import SUCCESS_REWARD, KitasapEnv
from kitasap_sim.env.checks import number_between
from kitasap_sim.env.kernels import see

_CELL_M = 0.1
"""Of what is counted as seen; chosen."""
_SPOTS_CELLS, _RAYS = 3, 120
"""Chosen: from spots 0.3 m apart, all around by 3 degrees, it is told what can be seen at all."""
_SEEN_WORTH = 1.0
STEP_COST = 0.005


class ExploreEnv(KitasapEnv):
    """See `share` (0.95 by default) of all that the beams can reach from where the robot can drive.

    The floor is counted in cells of 0.1 m; one is seen when a beam has gone through it. The robot
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
        self._angles_rad = self.laser.angles_rad
        self._mount_m = self.laser.mount_m[:2]

    def _begin(self, options: dict[str, Any]) -> np.ndarray:
        pose = self._checked_pose(options, "pose")
        return self.place.draw_free_pose(self.np_random) if pose is None else pose

    def _started(self) -> None:
        is_open, self._origin_m = self.place.open_cells(_CELL_M)
        spots = (self.place.free_centres_m - self._origin_m) / _CELL_M
        self._is_left = _in_view(is_open, spots, self._range_m)
        self._to_see = max(int(np.count_nonzero(self._is_left)), 1)
        self._count = 0
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
        """Counts the cells that the beams go through now."""
        x, y, theta = self._pose.tolist()
        (mount_x, mount_y), (x0, y0) = self._mount_m, self._origin_m
        c, s = math.cos(theta), math.sin(theta)
        row = (x + c * mount_x - s * mount_y - x0) / _CELL_M
        column = (y + s * mount_x + c * mount_y - y0) / _CELL_M
        self._count += see(
            self._is_left, (row, column, theta), self._angles_rad, self._ranges_m / _CELL_M,
            self._range_m / _CELL_M,
        )  # fmt: skip

    def _told(self) -> dict[str, Any]:
        return {
            "seen_share": self._count / self._to_see,
            "seen_m2": self._count * _CELL_M**2,
        }


def _in_view(is_open: np.ndarray, spots: np.ndarray, range_m: float) -> np.ndarray:
    """Mask of the open cells that beams can reach from some of the spots (K, 2) [cells].

    Open floor behind a gap through which the robot cannot drive may never come in view.
    """
    _, first = np.unique(spots.astype(int) // _SPOTS_CELLS, axis=0, return_index=True)
    angles = np.arange(_RAYS) * (2.0 * math.pi / _RAYS)
    along = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    starts = np.repeat(spots[first], _RAYS, axis=0)
    ways = np.tile(along, (len(first), 1))
    padded = np.pad(is_open, 1)
    is_seen = np.zeros_like(padded)
    for reach in range(int(range_m / _CELL_M)):
        cells = np.floor(starts + reach * ways).astype(int) + 1
        i, j = cells.clip(0, np.array(padded.shape) - 1).T
        goes_on = padded[i, j]
        is_seen[i[goes_on], j[goes_on]] = True
        starts, ways = starts[goes_on], ways[goes_on]
    return is_seen[1:-1, 1:-1]

"""The baseline of `Kitasap2/Explore-v0`: to where much that was not seen yet comes in view, soon.

Frontier-based exploration (Yamauchi, 1997) with views judged by what they show for their way
(Gonzalez-Banos and Latombe, 2002).
"""

import math

import numpy as np

from experiments.policies import kernels
from experiments.policies.goto import TOUCHING_PRICE, Navigator, prices
from experiments.policies.local_grid import CELL_M
from experiments.policies.views import unseen_from
from kitasap_sim.laser import LaserSpec
from kitasap_sim.robot import KITASAP2

_EVERY_CELLS = 3
"""Chosen: views are 0.15 m apart."""
_WALL_M = 0.08
"""Chosen: so far beside what was hit no beam passes: closes gaps between beams on a wall."""
_LOOK_STEPS = 10
_WORTH_M2 = (0.2, 0.08, 0.03, 0.01)
"""Views that show less are left for the end, and the last of these never looked for. Chosen."""
_KEEP = 0.5
"""A view is kept until it shows less than this share of what it promised. Chosen."""
_TURN_WAY_M = 1.0
"""What turning there costs, as way. Chosen."""
_GIVEN_UP_M = 0.4
_DONE_RAD = 0.15
_MOST_STEPS = 400
"""Chosen: 20 s, in which the robot crosses a room."""


class ExploreBaseline:
    """Drives from view to view until all that can be seen was seen; then it turns on the spot."""

    def __init__(self, laser: LaserSpec) -> None:
        self._navigator = Navigator(laser)
        self.reset()

    def reset(self) -> None:
        """Forgets the last episode."""
        self._navigator.reset()
        self._steps = 0
        self._kept_steps = 0
        self._view: tuple[np.ndarray, float, float] | None = None  # spot, heading, area
        self._given_up_m = np.empty((0, 2))

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """(2,) action."""
        self._navigator.see(observation)
        self._kept_steps += 1
        if self._view is not None and (
            self._is_looked_at(self._view) or self._kept_steps > _MOST_STEPS
        ):
            # nothing more is to be seen from there, or one does not get there
            self._given_up_m = np.concatenate([self._given_up_m, self._view[0][None]])
            self._view, self._steps = None, 0
            self._kept_steps = 0
        if self._steps % _LOOK_STEPS == 0:
            self._view = self._next_view()
        self._steps += 1
        if self._view is None:
            self._given_up_m = np.empty((0, 2))
            return np.array([0.0, 0.5], dtype=np.float32)
        return self._navigator.go_to(self._view[0], self._view[1])

    def _is_looked_at(self, view: tuple[np.ndarray, float, float]) -> bool:
        x, y, heading = self._navigator.grid.pose.tolist()
        is_there = math.dist(view[0], (x, y)) < 2.0 * CELL_M
        return is_there and abs(math.remainder(heading - view[1], math.tau)) < _DONE_RAD

    def _next_view(self) -> tuple[np.ndarray, float, float] | None:
        """Where to look from, to where, and how much there is to see [m2]; None: all was seen."""
        grid = self._navigator.grid
        window = i0, j0, i1, j1 = grid.window()
        clearance_m = grid.clearance_m(window)
        is_seen = _coarse(grid.is_seen[i0:i1, j0:j1])
        is_blocked = clearance_m < _WALL_M
        corner = np.array([i0, j0])
        if self._view is not None:
            spot_m, heading, promised_m2 = self._view
            found = unseen_from(is_seen, is_blocked, (grid.cell(spot_m) - corner)[None])[0]
            if found[0] * CELL_M**2 > max(_KEEP * promised_m2, _WORTH_M2[-1]):
                return spot_m, math.atan2(found[2], found[1]), promised_m2
        ways = kernels.costs_to(prices(clearance_m), (grid.cell(grid.pose[:2]) - corner)[None])
        is_spot = (ways < TOUCHING_PRICE) & (clearance_m > KITASAP2.radius_m + 0.03) & is_seen
        spots = np.argwhere(is_spot)
        spots = spots[(spots % _EVERY_CELLS == 0).all(axis=1)]
        spots_m = grid.middles_m(spots + corner)
        for given_up in self._given_up_m:
            is_near = np.hypot(*(spots_m - given_up).T) < _GIVEN_UP_M
            spots, spots_m = spots[~is_near], spots_m[~is_near]
        if not len(spots):
            return None
        found = unseen_from(is_seen, is_blocked, spots)
        areas_m2 = found[:, 0] * CELL_M**2
        ways_m = ways[tuple(spots.T)] * CELL_M
        for worth_m2 in _WORTH_M2:
            if (areas_m2 > worth_m2).any():
                worths = np.where(areas_m2 > worth_m2, areas_m2 / (ways_m + _TURN_WAY_M), 0.0)
                best = int(worths.argmax())
                heading = math.atan2(found[best, 2], found[best, 1])
                self._kept_steps = 0
                return spots_m[best], heading, float(areas_m2[best])
        return None


def _coarse(is_seen: np.ndarray) -> np.ndarray:
    """The same mask, a cell counting as seen where one of its neighbours towards +x, +y was: beams
    lie apart, and what counts is squares of twice the side."""
    seen = is_seen.copy()
    seen[:-1] |= is_seen[1:]
    seen[:, :-1] |= seen[:, 1:]
    return seen

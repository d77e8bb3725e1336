"""Keyframes of long ago in a pose graph: as many as there is map remain, and are solved for while the robot drives."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from slam.arrays import BoolArray, FloatArray, IntArray, diagonal_of
from slam.frontend.keyframes import Keyframe
from slam.frontend.remaining import Remaining
from slam.frontend.told_steps import ToldStep
from slam.kernels.condensed_graph import follow, ways_over
from slam.kernels.normal_equations import inverse_of
from slam.packed import PackedRows
from slam.pose_graph import PoseGraph, PoseGraphConfig
from slam.se2 import SE2

RECENT = 1500
"""Keyframes that are adjusted whatever they saw, some 450 m of a way. Chosen: with as many as that an update takes
some 30 ms."""

_BESIDE_M = 2.0
"""Farther off, or turned by more than that is at a metre, nothing is seen of the same. Chosen."""
_IN_ONE_PLACE_M = 1.0
"""So much to either side, and turned by as much as that is at a metre. Chosen."""
_FEWEST = 1.0 / 6.0
"""Of the keyframes that are recent; fewer others are not let go of. Chosen: that takes some 20 ms."""


class _Step(NamedTuple):
    """To a keyframe from the one before: (3,) its motion and (3, 3) the covariance of that; whether of the keyframe
    no more than the place is kept; its session."""

    motion: FloatArray
    covariance: FloatArray
    is_place_alone: bool
    session: int


class _Steps(PackedRows[_Step]):
    """Steps: 101 bytes each; beside the keyframes, which are not gone through one by one for each solution."""

    DTYPE: ClassVar[np.dtype[Any]] = np.dtype(
        [
            ("motion", "f8", 3), ("covariance", "f8", (3, 3)), ("is_place_alone", "?"),
            ("session", "i4"),
        ]
    )  # fmt: skip

    @staticmethod
    def packed(thing: _Step) -> tuple[Any, ...]:
        """See `PackedRows`."""
        return tuple(thing)

    @staticmethod
    def unpacked(row: tuple[Any, ...]) -> _Step:
        """See `PackedRows`."""
        return _Step(*row)


class Adjusted(NamedTuple):
    """Poses (N, 3) of a graph's nodes, by so much of it as was solved: edges, (E,), of which the loops among
    rejected, (R,), were not believed."""

    poses: FloatArray
    edges: IntArray
    rejected: IntArray


class OlderKeyframes:
    """Of a graph's keyframes but the last ones: which are solved for, and which are let go.

    Those to which no loop leads go along with the keyframes before and after them. Those of which the place alone is
    kept, since others saw what they saw, are let go for good: what their loops say is left to those others, and scans
    that were seen from one are seen from the nearest that remains. The step past either is the steps on the way, one
    after the other, as marginalising a chain gives. At both ends of a run that is let go the outermost that a loop
    holds remain: else what comes after would hang by all the steps alone. A robot that stays in one place, however
    long, has as many keyframes as there is place, and as scans broke off.
    """

    def __init__(self, step_sigma: tuple[float, float, float], recent: int = RECENT) -> None:
        """step_sigma: (m, m, rad) of each step beside what its covariance says; recent: the last keyframes, all of
        which are solved for. Raises ValueError where the last one is not among them."""
        if recent < 1:
            raise ValueError(f"recent must be 1 or more keyframes, not {recent}")
        self._spread, self._recent, self._steps = diagonal_of(step_sigma), recent, _Steps()
        self._at_breaks = list[int]()
        self._fewest = max(1, round(_FEWEST * recent))
        self._ask_at = recent + self._fewest

    def take(self, keyframe: Keyframe) -> None:
        """The next keyframe."""
        if keyframe.is_break:
            index = len(self._steps)
            self._at_breaks += [max(index - 1, 0), index]
        self._steps.append(
            _Step(
                keyframe.T_before.as_array(), keyframe.covariance + self._spread,
                keyframe.is_place_alone, keyframe.session,
            )
        )  # fmt: skip

    def keep_place_alone(self, index: int) -> None:
        """Of one of them no more than the place is kept from now on."""
        self._steps[index] = self._steps[index]._replace(is_place_alone=True)

    def solved_for(self, loop_ends: IntArray) -> BoolArray:
        """(K,) keyframes that are solved for, by the ends (L, 2) of loops: the first, the last ones, those that a loop
        holds, and those on both sides of a place where the scans broke off, a step of which next to nothing is
        known."""
        is_solved = np.ones(len(self._steps), np.bool_)
        is_solved[1 : max(len(is_solved) - self._recent, 0)] = False
        is_solved[self._at_breaks] = True
        is_solved[loop_ends] = True
        return is_solved

    def adjusted(self, graph: PoseGraph, is_solved: BoolArray, config: PoseGraphConfig) -> Adjusted:
        """A graph of the keyframes solved for some of them, (K,), and the others with these."""
        part, edges = graph.part(is_solved)
        numbers = np.cumsum(is_solved) - 1
        for k, way in self._ways_past_others(is_solved).items():
            node = int(numbers[k])
            part.add_edge(node - 1, node, way.motion, inverse_of(way.covariance))
        solution = part.solve(config=config)
        poses = graph.poses
        before = poses.copy()
        poses[is_solved] = solution.poses
        follow(before, is_solved, poses)
        return Adjusted(poses, edges, edges[solution.rejected_loops()])

    @property
    def may_let_go(self) -> bool:
        """Whether it is time to ask who remains."""
        return len(self._steps) >= self._ask_at

    def remaining(
        self, poses: FloatArray, loop_ends: IntArray, needed: Collection[int]
    ) -> Remaining | None:
        """Who remains of the keyframes at poses (K, 3), by the ends (L, 2) of loops; None where too few would be let
        go of for it to be worth the while. needed: who remains whatever it saw."""
        self._ask_at = len(self._steps) + self._fewest
        is_away = self._steps.column("is_place_alone")
        is_away[max(len(is_away) - self._recent, 0) :] = False
        is_away[[0, *self._at_breaks, *needed]] = False
        if np.count_nonzero(is_away) < self._fewest:
            return None
        is_kept = ~is_away
        is_outer = _outermost(is_kept, loop_ends)
        is_kept[loop_ends[is_outer[loop_ends].any(axis=1)]] = True
        anchors = self._anchored(poses, is_kept)
        is_kept |= anchors == np.arange(len(anchors))
        if np.count_nonzero(~is_kept) < self._fewest:
            return None
        ways = {
            k: ToldStep(way.motion, way.covariance - self._spread)
            for k, way in self._ways_past_others(is_kept).items()
        }
        return Remaining(is_kept, anchors, ways)

    def renumber(self, remaining: Remaining) -> None:
        """Lets go of keyframes that do not remain."""
        self._at_breaks = [remaining.number(k) for k in self._at_breaks]
        self._steps = self._steps.some(remaining.kept)
        self._ask_at = len(self._steps) + self._fewest
        for k, way in remaining.ways.items():
            at = remaining.number(k)
            covariance = way.covariance + self._spread
            self._steps[at] = self._steps[at]._replace(
                motion=way.motion.as_array(), covariance=covariance
            )

    def _ways_past_others(self, is_kept: BoolArray) -> dict[int, ToldStep]:
        """The step to each of the keyframes that are kept, (K,), from the last one before it that is, past others."""
        motions, covariances = self._steps.column("motion"), self._steps.column("covariance")
        ways, of_ways = np.empty_like(motions), np.empty_like(covariances)
        ways_over(motions, covariances, is_kept, ways, of_ways)
        kept = np.flatnonzero(is_kept)
        after_others = kept[1:][np.diff(kept) > 1].tolist()
        return {k: ToldStep(SE2.from_array(ways[k]), of_ways[k]) for k in after_others}

    def _anchored(self, poses: FloatArray, is_kept: BoolArray) -> IntArray:
        """(K,) for each keyframe at poses (K, 3) that is not kept the nearest of its session whose scan is; where none
        is near, the first of those that are in one place with it. Its own number for one that remains."""
        anchors = np.arange(len(is_kept))
        sessions = self._steps.column("session")
        has_scan = is_kept & ~self._steps.column("is_place_alone")
        for session in np.unique(sessions[~is_kept]).tolist():
            is_own = sessions == session
            seen, away = np.flatnonzero(is_own & has_scan), np.flatnonzero(is_own & ~is_kept)
            views = np.column_stack([poses[:, :2], np.cos(poses[:, 2]), np.sin(poses[:, 2])])
            found = np.full(len(away), -1)
            if len(seen):
                nearest = cKDTree(views[seen]).query(views[away], distance_upper_bound=_BESIDE_M)[1]
                found = np.append(seen, -1)[nearest]
            alone = away[found < 0]
            cells = np.floor(views[alone] / _IN_ONE_PLACE_M)
            _, first, of_cell = np.unique(cells, axis=0, return_index=True, return_inverse=True)
            found[found < 0] = alone[first][of_cell.ravel()]
            anchors[away] = found
        return anchors


def _outermost(is_kept: BoolArray, loop_ends: IntArray) -> BoolArray:
    """(K,) of each run of keyframes that are not kept, the first and the last that a loop holds."""
    is_held = np.zeros(len(is_kept), np.bool_)
    is_held[loop_ends] = True
    held = np.flatnonzero(is_held & ~is_kept)
    runs = np.cumsum(is_kept)[held]
    is_outer = np.zeros(len(is_kept), np.bool_)
    for side in ("left", "right"):
        at = np.searchsorted(runs, np.unique(runs), side=side) - (side == "right")
        is_outer[held[at]] = True
    return is_outer

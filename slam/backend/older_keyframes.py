"""Keyframes of long ago in a pose graph that is solved while the robot drives: by as many as there is map."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from slam.arrays import BoolArray, FloatArray, IntArray, diagonal_of
from slam.frontend.keyframes import Keyframe
from slam.kernels.condensed_graph import follow, go_along, ways_over
from slam.kernels.normal_equations import inverse_of
from slam.packed import PackedRows
from slam.pose_graph import PoseGraph, PoseGraphConfig
from slam.se2 import SE2

RECENT = 1500
"""Keyframes that are adjusted whatever they saw, some 450 m of a way. Chosen: with as many as that an update takes
some 30 ms."""

_BESIDE_M = 2.0
"""Farther off, or turned by more than that is at a metre, nothing is seen of the same. Chosen."""


class _Step(NamedTuple):
    """To a keyframe from the one before: (3,) its motion and (3, 3) the covariance of that; whether of the keyframe
    no more than the place is kept."""

    motion: FloatArray
    covariance: FloatArray
    is_place_alone: bool


class _Steps(PackedRows[_Step]):
    """Steps: 97 bytes each; beside the keyframes, which are not gone through one by one for each solution."""

    DTYPE: ClassVar[np.dtype[Any]] = np.dtype(
        [("motion", "f8", 3), ("covariance", "f8", (3, 3)), ("is_place_alone", "?")]
    )

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
    """Takes those of a graph's keyframes together that move with others: two kinds, but for the last ones.

    Of the first no more than the place is kept. What their loops say is left to those who saw the same before, the
    nearest of whom they go along with. To the second no loop leads; they go along with those before and after them.
    The ways past either are their steps', one after the other, as marginalising a chain gives. At both ends of such
    a way over the first kind, the outermost that a loop holds stays: else what comes after would hang by all the
    steps alone. A robot that stays in one place, however long, has a graph to be solved that is as large as the
    place, and as what is known of where its scans broke off.
    """

    def __init__(self, step_sigma: tuple[float, float, float], recent: int = RECENT) -> None:
        """step_sigma: (m, m, rad) of each step beside what its covariance says; recent: the last keyframes, which
        are none of either kind. Raises ValueError where the last one is not among them."""
        if recent < 1:
            raise ValueError(f"recent must be 1 or more keyframes, not {recent}")
        self._spread, self._recent, self._steps = diagonal_of(step_sigma), recent, _Steps()
        self._anchors: IntArray = np.empty(0, np.int64)
        self._at_breaks = list[int]()

    def take(self, keyframe: Keyframe) -> None:
        """The next keyframe."""
        if keyframe.is_break:
            index = len(self._steps)
            self._at_breaks += [max(index - 1, 0), index]
        covariance = keyframe.covariance + self._spread
        self._steps.append(_Step(keyframe.T_before.as_array(), covariance, keyframe.is_place_alone))

    def keep_place_alone(self, index: int) -> None:
        """Of one of them no more than the place is kept from now on."""
        self._steps[index] = self._steps[index]._replace(is_place_alone=True)

    def forget_anchors(self) -> None:
        """Keyframes were moved by something else: who lies beside whom is looked at once more."""
        self._anchors = np.empty(0, np.int64)

    def kept(self, loop_ends: IntArray) -> BoolArray:
        """(K,) keyframes that are solved for, by the ends (L, 2) of loops: the first, the last ones, those that a loop
        holds, see above, and those on both sides of a place where the scans broke off, a step of which next to nothing
        is known."""
        is_kept, is_away = np.ones(len(self._steps), np.bool_), self._steps.column("is_place_alone")
        old = max(len(is_kept) - self._recent, 0)
        is_away[old:] = False
        is_kept[1:old] = False
        is_kept[self._at_breaks] = True
        is_kept[loop_ends[~is_away[loop_ends].any(axis=1)]] = True
        is_outer = _outermost(is_kept, is_away, loop_ends)
        is_kept[loop_ends[is_outer[loop_ends].any(axis=1)]] = True
        return is_kept

    def adjusted(self, graph: PoseGraph, is_kept: BoolArray, config: PoseGraphConfig) -> Adjusted:
        """A graph of the keyframes solved for some of them, (K,), and the others with these."""
        part, edges = graph.part(is_kept)
        motions, covariances = self._steps.column("motion"), self._steps.column("covariance")
        ways, of_ways = np.empty_like(motions), np.empty_like(covariances)
        ways_over(motions, covariances, is_kept, ways, of_ways)
        kept = np.flatnonzero(is_kept)
        after_others = np.flatnonzero(np.diff(kept) > 1) + 1
        for node in after_others.tolist():
            k = kept[node]
            part.add_edge(node - 1, node, SE2.from_array(ways[k]), inverse_of(of_ways[k]))
        solution = part.solve(config=config)
        poses = graph.poses
        before, is_moved = poses.copy(), is_kept.copy()
        poses[is_kept] = solution.poses
        go_along(before, self._anchored(before, is_kept), is_moved, poses)
        follow(before, is_moved, poses)
        return Adjusted(poses, edges, edges[solution.rejected_loops()])

    def _anchored(self, poses: FloatArray, is_kept: BoolArray) -> IntArray:
        """(K,) for each keyframe of which the place alone is kept, the nearest whose scan is, by the poses (K, 3)
        that they had when that was looked for; -1 for others, and where none is near. Looked for once, and again
        where that one is no more solved for."""
        anchors = np.full(len(is_kept), -1)
        anchors[: len(self._anchors)] = self._anchors
        is_place_alone = self._steps.column("is_place_alone")
        seen = np.flatnonzero(is_kept & ~is_place_alone)
        is_new = (anchors < 0) | ~is_kept[anchors]
        new = np.flatnonzero(~is_kept & is_place_alone & is_new)
        if len(seen) and len(new):
            views = np.column_stack([poses[:, :2], np.cos(poses[:, 2]), np.sin(poses[:, 2])])
            found = cKDTree(views[seen]).query(views[new], distance_upper_bound=_BESIDE_M)[1]
            anchors[new] = np.append(seen, -1)[found]
        self._anchors = anchors
        return anchors


def _outermost(is_kept: BoolArray, is_away: BoolArray, loop_ends: IntArray) -> BoolArray:
    """(K,) of each run of keyframes that are not kept, the first and the last away that a loop holds."""
    is_held = np.zeros(len(is_kept), np.bool_)
    is_held[loop_ends] = True
    held = np.flatnonzero(is_held & is_away & ~is_kept)
    runs = np.cumsum(is_kept)[held]
    is_outer = np.zeros(len(is_kept), np.bool_)
    for side in ("left", "right"):
        at = np.searchsorted(runs, np.unique(runs), side=side) - (side == "right")
        is_outer[held[at]] = True
    return is_outer

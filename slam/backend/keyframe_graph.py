"""Keyframes one after the other, the loops among them, and the poses at which both agree best."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from slam.arrays import FloatArray, IntArray
from slam.backend.looseness import Looseness
from slam.backend.older_keyframes import RECENT, OlderKeyframes
from slam.frontend.kept_keyframes import Keyframes
from slam.frontend.keyframes import Keyframe
from slam.frontend.remaining import Remaining
from slam.kernels.graph_ways import ways_from
from slam.kernels.near_keyframes import alike
from slam.loop_closing import Loop, renumbered, without_ties
from slam.pose_graph import PoseGraph, PoseGraphConfig, PoseGraphSolution, Start
from slam.se2 import SE2
from slam.slam_map import add_loop, add_steps, graph_of

_TORN_M = 100.0
"""Chosen: where the scans broke off, or keyframes were let go, the pose is as uncertain as after so long a way."""

_FEW_REJECTED = 0.02
"""Share of the loops; chosen: fewer are wrong ones, of the four logs 0.6 % at most, and need no second
look that takes ten times as long."""


class KeyframeGraph:
    """The pose graph of keyframes and loops, kept beside them.

    step_sigma: (m, m, rad) of the motion between two keyframes beside what the front end says. recent: keyframes that
    are adjusted whatever they saw.
    """

    def __init__(self, step_sigma: tuple[float, float, float], recent: int = RECENT) -> None:
        self.keyframes = Keyframes()
        self.loops: list[Loop] = []
        self._step_sigma, self._recent = step_sigma, recent
        self._older = OlderKeyframes(step_sigma, recent)
        self._graph, self._loop_edges, self._torn = PoseGraph(), list[int](), list[int]()
        self._held_ends, self._tie_count = _ends_of([]), 0
        self.looseness = Looseness()

    @property
    def loop_count(self) -> int:
        """Loops at which a place is seen again: ties left out."""
        return len(self.loops) - self._tie_count

    def __len__(self) -> int:
        return len(self.keyframes)

    @property
    def poses(self) -> FloatArray:
        """(K, 3) of the keyframes, as of now."""
        return self._graph.poses

    def pose(self, index: int) -> SE2:
        """Of one keyframe, as of now."""
        return self._graph.pose(index)

    def set_poses(self, poses: FloatArray) -> None:
        """Puts the keyframes at poses (K, 3)."""
        self._graph.set_poses(poses)

    def renew(self, keyframes: Sequence[Keyframe], loops: list[Loop], poses: FloatArray) -> None:
        """All of it anew: keyframes at poses (K, 3), and loops."""
        self._graph = graph_of(keyframes, loops, poses, self._step_sigma)
        self.keyframes = keyframes if isinstance(keyframes, Keyframes) else Keyframes(keyframes)
        self.loops = loops
        self._tie_count = len(loops) - len(without_ties(loops))
        self._held_ends = _ends_of(loops)
        self._torn = [k for k, keyframe in enumerate(keyframes) if not keyframe.goes_on]
        self._older = OlderKeyframes(self._step_sigma, self._recent)
        for keyframe in keyframes:
            self._older.take(keyframe)
        edges = self._graph.edge_count
        self._loop_edges = list(range(edges - len(loops), edges))

    def add(self, keyframe: Keyframe, is_open: bool = False) -> None:
        """One keyframe more, where its step leads from the last one; is_open: it leaves open how far
        along that is."""
        index = len(self.keyframes)
        self.looseness.take(keyframe, is_open)
        self._older.take(keyframe)
        self.keyframes.append(keyframe)
        if not keyframe.goes_on:
            self._torn.append(index)
        if index == 0:
            self._graph.add_node(keyframe.T_map_base)
        else:
            self._graph.add_node(self.pose(index - 1) @ keyframe.T_before)
            add_steps(self._graph, index, [keyframe], self._step_sigma)

    def ways_m(self, index: int) -> FloatArray:
        """(K,) the shortest way from one keyframe to each [m], over steps and the loops that held when
        the poses were solved for last, and were looked at then: the longer, the less is known of how the two lie. Where scans
        broke off, or keyframes were let go, as much longer as that leaves open."""
        poses = self.poses
        steps_m = np.zeros(len(poses))
        steps_m[1:] = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        steps_m[self._torn] += _TORN_M
        ends = self._held_ends
        loops_m = np.hypot(*(poses[ends[:, 0], :2] - poses[ends[:, 1], :2]).T)
        ways_m = np.empty(len(poses))
        ways_from(index, steps_m, ends, loops_m, ways_m)
        return ways_m

    def is_crowded(self, index: int, near: tuple[float, float], most: int, by: range) -> bool:
        """Whether more scans than that are kept from so near (m, rad) to where a keyframe is, by: of these
        keyframes."""
        found = np.empty(len(self), np.int64)
        count = alike(self.poses, index, *near, found)
        near_by = (k for k in found[:count].tolist() if k in by)
        return sum(map(self.keyframes.has_scan, near_by)) > most

    def keep_place_alone(self, index: int) -> None:
        """Lets go of all but the place of a keyframe."""
        self.keyframes.keep_place_alone(index)
        self._older.keep_place_alone(index)

    def remaining(self, needed: Collection[int]) -> Remaining | None:
        """Who remains of the keyframes, see `OlderKeyframes`; needed: these in any case."""
        if not self._older.may_let_go:
            return None
        # those of a run that leaves the way open may be moved as long as it has not ended
        open_run = range(max(len(self) - 1 - self.looseness.open_count, 0), len(self))
        # by the loops that are believed: others hold nothing
        return self._older.remaining(self.poses, self._held_ends, {*needed, *open_run})

    def renumber(self, remaining: Remaining) -> None:
        """Lets go of keyframes that do not remain, and of their loops."""
        self._graph, edges = self._graph.part(remaining.is_kept)
        self.keyframes.renumber(remaining)
        for k in remaining.ways:
            at = remaining.number(k)
            add_steps(self._graph, at, [self.keyframes[at]], self._step_sigma)
        ends, of_loops = _ends_of(self.loops), np.array(self._loop_edges, np.int64)
        is_kept = remaining.is_kept[ends].all(axis=1)
        self._loop_edges = np.searchsorted(edges, of_loops[is_kept]).tolist()
        self.loops = renumbered(self.loops, remaining)
        self._tie_count = len(self.loops) - len(without_ties(self.loops))
        is_kept = remaining.is_kept[self._held_ends].all(axis=1)
        self._held_ends = remaining.numbers[self._held_ends[is_kept]]
        torn = {k for k in self._torn if remaining.is_kept[k]} | remaining.ways.keys()
        self._torn = sorted(map(remaining.number, torn))
        self.looseness.renumber(remaining)
        self._older.renumber(remaining)

    def take(self, loops: Sequence[Loop]) -> None:
        """More loops."""
        for loop in loops:
            self._loop_edges.append(add_loop(self._graph, loop))
            self._tie_count += loop.is_tie
        self.loops += loops

    def adjust(self, iterations: int) -> None:
        """Moves the poses by so many iterations on the way to where steps and loops agree best, those of long ago
        with others: see `OlderKeyframes`."""
        config = PoseGraphConfig(max_iterations=iterations)
        ends = _ends_of(self.loops)
        poses, edges, rejected = self._older.adjusted(
            self._graph, self._older.solved_for(ends), config
        )
        self._graph.set_poses(poses)
        is_held = np.isin(self._loop_edges, edges) & ~np.isin(self._loop_edges, rejected)
        self._held_ends = ends[is_held]

    def solve(self) -> PoseGraphSolution:
        """Moves the poses to where steps and loops agree best.

        Loops that are rejected get a second hearing, in stages: right ones may lie so far off that no descent from
        where the poses are leads to them.
        """
        solution = self._graph.solve()
        if len(solution.rejected_loops()) > _FEW_REJECTED * len(self.loops):
            solution = min(solution, self._in_stages(solution), key=lambda one: one.cost)
        self._graph.set_poses(solution.poses)
        kept, _ = self._sorted(solution)
        self._held_ends = _ends_of(kept)
        return solution

    def _in_stages(self, solution: PoseGraphSolution) -> PoseGraphSolution:
        """Solved once more; the same, where the edges leave a direction open by what can be computed:
        wheels that tell of kilometres at each scan."""
        try:
            return self._graph.solve(Start.STAGES)
        except ValueError:
            return solution

    def sorted_loops(self) -> tuple[list[Loop], list[Loop]]:
        """The loops that are kept once the poses are solved for, and those that others contradict."""
        return self._sorted(self.solve())

    def _sorted(self, solution: PoseGraphSolution) -> tuple[list[Loop], list[Loop]]:
        is_rejected = np.zeros(self._graph.edge_count, dtype=np.bool_)
        is_rejected[solution.rejected_loops()] = True
        of_loop = is_rejected[self._loop_edges].tolist()
        kept = [loop for loop, bad in zip(self.loops, of_loop, strict=True) if not bad]
        rejected = [loop for loop, bad in zip(self.loops, of_loop, strict=True) if bad]
        return kept, rejected


def _ends_of(loops: Sequence[Loop]) -> IntArray:
    """(L, 2) the keyframes that loops lie between."""
    return np.array([(loop.earlier, loop.later) for loop in loops], np.int64).reshape(-1, 2)

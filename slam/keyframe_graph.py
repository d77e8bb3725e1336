"""Keyframes one after the other, the loops among them, and the poses at which both agree best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slam.arrays import FloatArray
from slam.keyframes import Keyframe
from slam.loop_closing import Loop
from slam.pose_graph import PoseGraph, PoseGraphConfig, PoseGraphSolution
from slam.se2 import SE2
from slam.slam_map import add_loop, add_step, graph_of


class KeyframeGraph:
    """The pose graph of keyframes and loops, kept beside them.

    step_sigma: (m, m, rad) of the motion between two keyframes beside what the front end says.
    """

    def __init__(self, step_sigma: tuple[float, float, float]) -> None:
        self.keyframes: list[Keyframe] = []
        self.loops: list[Loop] = []
        self._step_sigma = step_sigma
        self._graph, self._loop_edges = PoseGraph(), list[int]()

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

    def renew(self, keyframes: list[Keyframe], loops: list[Loop], poses: FloatArray) -> None:
        """All of it anew: keyframes at poses (K, 3), and loops."""
        self._graph = graph_of(keyframes, loops, poses, self._step_sigma)
        steps = max(len(keyframes) - 1, 0)
        self.keyframes, self.loops = keyframes, loops
        self._loop_edges = list(range(steps, steps + len(loops)))

    def add(self, keyframe: Keyframe) -> None:
        """One keyframe more, where its step leads from the last one."""
        index = len(self.keyframes)
        self.keyframes.append(keyframe)
        if index == 0:
            self._graph.add_node(keyframe.T_map_base)
        else:
            self._graph.add_node(self.pose(index - 1) @ keyframe.T_before)
            add_step(self._graph, index, keyframe, self._step_sigma)

    def take(self, loops: Sequence[Loop]) -> None:
        """More loops."""
        for loop in loops:
            self._loop_edges.append(add_loop(self._graph, loop))
        self.loops += loops

    def solve(self, max_iterations: int = 100) -> PoseGraphSolution:
        """Moves the poses to where steps and loops agree best, or on the way there."""
        solution = self._graph.solve(config=PoseGraphConfig(max_iterations=max_iterations))
        self._graph.set_poses(solution.poses)
        return solution

    def sorted_loops(self) -> tuple[list[Loop], list[Loop]]:
        """The loops that are kept once the poses are solved for, and those that others contradict."""
        is_rejected = np.zeros(self._graph.edge_count, dtype=np.bool_)
        is_rejected[self.solve().rejected_loops()] = True
        of_loop = is_rejected[self._loop_edges]
        kept = [loop for loop, bad in zip(self.loops, of_loop, strict=True) if not bad]
        rejected = [loop for loop, bad in zip(self.loops, of_loop, strict=True) if bad]
        return kept, rejected

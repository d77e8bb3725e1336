"""Self-localisation and mapping (Fig. 3): scans placed one by one, loops closed, poses adjusted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.front_end import FrontEnd, FrontEndConfig, FrontEndStep, Keyframe, StepStatus
from slam.known_map import USUAL_LASER, KnownMap
from slam.laser_model import LaserModel
from slam.localization import Localizer
from slam.loop_closing import Loop, LoopCloser, LoopConfig
from slam.map_consistency import ConsistencyConfig, MapVerdict, judged
from slam.measurements import Measurement
from slam.occupancy_grid import OccupancyGrid
from slam.pose_graph import EdgeKernel, PoseGraph, PoseGraphConfig, PoseGraphSolution
from slam.se2 import SE2
from slam.surfaces import Surfaces, surfaces_of
from slam.trajectory import Trajectory

_TORN_M = 100.0
"""Chosen: where the scans broke off, the pose is as uncertain as after so long a way."""


@dataclass(frozen=True)
class MapperConfig:
    """How a `Mapper` works.

    drift_m, drift_rad: by which a pose may be wrong for each metre since the last loop, and
    start_m, start_rad just after one; most_drift: (m, rad) that is looked for at most. solve_every:
    keyframes after which the poses are adjusted, if there are new loops, by so many
    online_iterations at most. step_sigma: (m, m, rad) of the motion between two keyframes beside
    what the front end says. Chosen, all of these.
    """

    front_end: FrontEndConfig = field(default_factory=FrontEndConfig)
    loops: LoopConfig = field(default_factory=LoopConfig)
    consistency: ConsistencyConfig = field(default_factory=ConsistencyConfig)
    start_m: float = 0.1
    drift_m: float = 0.01
    start_rad: float = 0.02
    drift_rad: float = 0.002
    most_drift: tuple[float, float] = (2.5, 0.35)
    solve_every: int = 25
    online_iterations: int = 3
    step_sigma: tuple[float, float, float] = (0.003, 0.003, 0.001)


@dataclass(frozen=True, eq=False)
class MapperStep:
    """One scan, placed: the pose on the map as it is so far, and how it was found."""

    time_s: float
    T_map_base: SE2
    status: StepStatus
    inlier_ratio: float
    loops: int


@dataclass(frozen=True, eq=False)
class SlamMap:
    """What a drive has left: keyframes (K) with their poses (K, 3), and the loops among them.

    rejected: loops that the others contradict. graph: steps between keyframes, and loops. steps:
    every scan, as seen from its keyframe. verdict: whether the map is to be used.
    """

    keyframes: tuple[Keyframe, ...]
    poses: FloatArray
    loops: tuple[Loop, ...]
    rejected: tuple[Loop, ...]
    graph: PoseGraph
    steps: tuple[FrontEndStep, ...]
    verdict: MapVerdict

    @property
    def trajectory(self) -> Trajectory:
        """Where each scan was taken, in the order of the log."""
        poses = [self.pose_of(step).as_array() for step in self.steps]
        return Trajectory(
            np.array([step.time_s for step in self.steps]), np.array(poses).reshape(-1, 3)
        )

    def grid(self, resolution_m: float = 0.05) -> OccupancyGrid:
        """The occupancy grid of the keyframes' scans. Raises ValueError if none saw anything."""
        return OccupancyGrid.of_scans(self._scans(), resolution_m)

    def known(self, laser: LaserModel = USUAL_LASER) -> KnownMap:
        """All that localising on the map needs, for a laser.

        Raises ValueError for a map without a surface.
        """
        return KnownMap.of_surfaces(self.surfaces, laser)

    def localizer(
        self, T_base_laser: SE2, start: SE2 | None = None, laser: LaserModel = USUAL_LASER
    ) -> Localizer:
        """A localizer on the map, by `limit`, that knows when it is lost; start: None if unknown.

        Raises ValueError for a map without a surface.
        """
        return self.known(laser).localizer("limit", start, T_base_laser)

    def _scans(self) -> list[tuple[SE2, Beams]]:
        return [
            (SE2.from_array(pose), keyframe.beams)
            for keyframe, pose in zip(self.keyframes, self.poses, strict=True)
        ]

    @cached_property
    def surfaces(self) -> Surfaces:
        """What the keyframes saw, averaged; who walked by, and doors since opened, left out."""
        return surfaces_of(
            [
                (SE2.from_array(pose), keyframe.faced, keyframe.beams)
                for keyframe, pose in zip(self.keyframes, self.poses, strict=True)
            ]
        )

    @property
    def points(self) -> FloatArray:
        """(N, 2) points on the surfaces, 2 cm apart [m], map frame: the point database."""
        return self.surfaces.points()

    def pose_of(self, step: FrontEndStep) -> SE2:
        """Where a scan was taken."""
        if step.keyframe < 0:
            return step.T_keyframe_base
        return SE2.from_array(self.poses[step.keyframe]) @ step.T_keyframe_base


class Mapper:
    """Makes a map of an unknown place from scans and odometry, one scan at a time."""

    def __init__(self, T_base_laser: SE2, config: MapperConfig | None = None) -> None:
        self.config = config or MapperConfig()
        self._front_end = FrontEnd(T_base_laser, self.config.front_end)
        self._closer = LoopCloser(self.config.loops, self.config.front_end.surfaces)
        self._graph = PoseGraph()
        self._loops: list[Loop] = []
        self._loop_edges: list[int] = []
        self._steps: list[FrontEndStep] = []
        self._has_new = False
        self._since_loop_m = 0.0

    def update(self, measurement: Measurement) -> MapperStep:
        """Places one scan, and closes the loops that it shows."""
        step = self._front_end.update(measurement)  # match with what was seen last
        self._steps.append(step)
        if step.is_keyframe:
            self._add_keyframe(self._front_end.keyframes[-1])
        pose = step.T_map_base
        if step.keyframe >= 0:
            pose = self._graph.pose(step.keyframe) @ step.T_keyframe_base
        return MapperStep(step.time_s, pose, step.status, step.inlier_ratio, len(self._loops))

    def finish(self) -> SlamMap:
        """All loops once more from where the poses are now, and all poses adjusted to the end."""
        keyframes = self._front_end.keyframes
        kept, rejected = self._loops, list[Loop]()
        if self._loops:
            self._solve()
            known = {(loop.earlier, loop.later) for loop in self._loops}
            asked = range(0, len(keyframes), self.config.loops.every)
            found = self._closer.found(keyframes, self._graph.poses, asked)
            self._take([one for one in found if (one.earlier, one.later) not in known])
            is_rejected = np.zeros(self._graph.edge_count, dtype=np.bool_)
            is_rejected[self._solve().rejected_loops()] = True
            of_loop = is_rejected[self._loop_edges]
            kept = [loop for loop, bad in zip(self._loops, of_loop, strict=True) if not bad]
            rejected = [loop for loop, bad in zip(self._loops, of_loop, strict=True) if bad]
        poses = self._graph.poses
        verdict = judged(keyframes, poses, kept, rejected, self.config.consistency)
        return SlamMap(
            tuple(keyframes), poses, tuple(kept), tuple(rejected), self._graph,
            tuple(self._steps), verdict,
        )  # fmt: skip

    def _take(self, loops: list[Loop]) -> None:
        """Makes loops part of the pose graph."""
        for loop in loops:
            self._loop_edges.append(_add_loop(self._graph, loop))
        self._loops += loops

    def _add_keyframe(self, keyframe: Keyframe) -> None:
        """Notes where the keyframe is seen from the last one, and the loops that it closes."""
        config, index = self.config, self._graph.node_count
        if index == 0:
            self._graph.add_node(keyframe.T_map_base)
        else:
            self._graph.add_node(self._graph.pose(index - 1) @ keyframe.T_before)
            _add_step(self._graph, index, keyframe, config.step_sigma)
            self._since_loop_m += math.hypot(keyframe.T_before.x, keyframe.T_before.y)
        if keyframe.is_break:
            self._since_loop_m += _TORN_M
        if index % config.loops.every == 0:
            found = self._closer.found(
                self._front_end.keyframes, self._graph.poses, [index], self._drift()
            )
            if found:
                self._take(found)
                self._since_loop_m, self._has_new = 0.0, True
        if self._has_new and index % config.solve_every == 0:
            self._solve(config.online_iterations)
            self._has_new = False

    def _drift(self) -> tuple[float, float]:
        """How far the last pose may be off as seen from those before the last loop [m], [rad]."""
        config, way_m = self.config, self._since_loop_m
        return (
            min(config.start_m + config.drift_m * way_m, config.most_drift[0]),
            min(config.start_rad + config.drift_rad * way_m, config.most_drift[1]),
        )

    def _solve(self, max_iterations: int = 100) -> PoseGraphSolution:
        """Moves the poses to where steps and loops agree best, or on the way there."""
        config = PoseGraphConfig(max_iterations=max_iterations)
        solution = self._graph.solve(config=config)
        self._graph.set_poses(solution.poses)
        return solution


def graph_of(
    keyframes: Sequence[Keyframe],
    loops: Sequence[Loop],
    poses: FloatArray,
    config: MapperConfig | None = None,
) -> PoseGraph:
    """The pose graph of keyframes at poses (K, 3): the steps between them, then the loops."""
    config, graph = config or MapperConfig(), PoseGraph()
    for pose in poses:
        graph.add_node(SE2.from_array(pose))
    for index, keyframe in enumerate(keyframes[1:], start=1):
        _add_step(graph, index, keyframe, config.step_sigma)
    for loop in loops:
        _add_loop(graph, loop)
    return graph


def _add_step(
    graph: PoseGraph, index: int, keyframe: Keyframe, step_sigma: tuple[float, float, float]
) -> None:
    """The way from the keyframe before."""
    own = np.diag(np.square(step_sigma))
    information = np.linalg.inv(keyframe.covariance + own)
    graph.add_edge(index - 1, index, keyframe.T_before, information)


def _add_loop(graph: PoseGraph, loop: Loop) -> int:
    """The number of the loop's edge."""
    return graph.add_edge(
        loop.earlier, loop.later, loop.T_earlier_later, loop.information, EdgeKernel.LOOP
    )

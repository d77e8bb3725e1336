"""A map made of scans: keyframes, where they were taken, and the loops among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from slam.arrays import FloatArray, diagonal_of
from slam.frontend.keyframes import FrontEndStep, Keyframe, scan_poses
from slam.known_map import KnownMap, laser_seen
from slam.laser_model import LaserModel
from slam.localization import Localizer
from slam.loop_closing import Loop
from slam.map_checks.map_consistency import MapVerdict, unjoined_sessions
from slam.map_checks.map_drift import drift_m
from slam.occupancy_grid import OccupancyGrid
from slam.pose_graph import EdgeKernel, PoseGraph
from slam.se2 import SE2
from slam.step_factors import step_factors
from slam.surface.surfaces import Surfaces, surfaces_of
from slam.trajectory import Trajectory

STEP_SIGMA = (0.003, 0.003, 0.001)
"""(m, m, rad) of the motion between two keyframes beside what the front end says; chosen."""


@dataclass(frozen=True, eq=False)
class SlamMap:
    """What a drive has left: keyframes (K) with their poses (K, 3), and the loops among them.

    rejected: loops that the others contradict. graph: steps between keyframes, and loops. steps:
    every scan, as seen from its keyframe. verdict: whether the map is to be used. Of several
    sessions, one after the other; their stamps may overlap, or go back.
    """

    keyframes: tuple[Keyframe, ...]
    poses: FloatArray
    loops: tuple[Loop, ...]
    rejected: tuple[Loop, ...]
    graph: PoseGraph
    steps: Sequence[FrontEndStep]
    verdict: MapVerdict

    @property
    def session_count(self) -> int:
        """How many sessions it was made in."""
        return 1 + max((step.session for step in self.steps), default=-1)

    @property
    def unjoined(self) -> tuple[int, ...]:
        """Sessions, from 0, of which nobody knows where they lie on the map of those before."""
        blind = {step.session for step in self.steps if step.keyframe < 0} - {0}
        return tuple(sorted({*blind, *unjoined_sessions(self.keyframes, self.loops)}))

    def objected(self, reasons: Sequence[str]) -> SlamMap:
        """The map with more to be said against it; itself, if there is none."""
        if not reasons:
            return self
        return replace(self, verdict=self.verdict.with_reasons(reasons))

    @cached_property
    def drift_m(self) -> float:
        """By how much poses may be off as seen from one another [m], by the map's own account: see
        `slam.map_checks.map_drift`. Of sessions that were joined."""
        unjoined = self.unjoined
        joined = [k for k, one in enumerate(self.keyframes) if one.session not in unjoined]
        return drift_m(self.graph, np.array(joined, dtype=np.int64))

    @property
    def trajectory(self) -> Trajectory:
        """Where each scan was taken, in the order of the log; one session after the other."""
        return Trajectory(*scan_poses(self.steps, self.poses))

    def trajectory_of(self, session: int) -> Trajectory:
        """Where each scan of one session, counted from 0, was taken."""
        rows = [at for at, step in enumerate(self.steps) if step.session == session]
        own = self.steps[rows[0] : rows[-1] + 1] if rows else []  # one session after the other
        return Trajectory(*scan_poses(own, self.poses))

    def grid(self, resolution_m: float = 0.05) -> OccupancyGrid:
        """The occupancy grid of the keyframes' scans. Raises ValueError if none saw anything."""
        scans = [
            (pose, keyframe.beams) for pose, keyframe in _with_scans(self.keyframes, self.poses)
        ]
        return OccupancyGrid.of_scans(scans, resolution_m)

    def known(self, laser: LaserModel | None = None) -> KnownMap:
        """All that localising on the map needs, for a laser; None: as its own scans show it.

        Raises ValueError for a map without a surface.
        """
        laser = laser or laser_seen([keyframe.beams for keyframe in self.keyframes])
        return KnownMap.of_surfaces(self.surfaces, laser)

    def localizer(
        self, T_base_laser: SE2, start: SE2 | None = None, laser: LaserModel | None = None
    ) -> Localizer:
        """A localizer on the map, by `limit`, that knows when it is lost; start: None if unknown.

        Raises ValueError for a map without a surface.
        """
        return self.known(laser).localizer("limit", start, T_base_laser)

    @cached_property
    def surfaces(self) -> Surfaces:
        """What the keyframes saw, averaged; who walked by or stood, and doors since opened, left out."""
        return surfaces_seen(self.keyframes, self.poses)

    @property
    def points(self) -> FloatArray:
        """(N, 2) points on the surfaces, 2 cm apart [m], map frame: the point database."""
        return self.surfaces.points()

    def pose_of(self, step: FrontEndStep) -> SE2:
        """Where a scan was taken."""
        return step.placed(self.poses)


def surfaces_seen(keyframes: Sequence[Keyframe], poses: FloatArray) -> Surfaces:
    """The surfaces that keyframes at poses (K, 3) saw."""
    posed = _with_scans(keyframes, poses)
    return surfaces_of(
        [(T, keyframe.faced, keyframe.beams) for T, keyframe in posed],
        [[glance.view(T) for glance in keyframe.glances] for T, keyframe in posed],
    )


def points_seen(keyframes: Sequence[Keyframe], poses: FloatArray) -> FloatArray:
    """(N, 2) where the beams of keyframes at poses (K, 3) ended, each for itself [m]."""
    seen = [T @ keyframe.points for T, keyframe in _with_scans(keyframes, poses)]
    return np.concatenate([np.zeros((0, 2)), *seen])


def _with_scans(keyframes: Sequence[Keyframe], poses: FloatArray) -> list[tuple[SE2, Keyframe]]:
    """Those of which more than the place is kept."""
    return [
        (SE2.from_array(pose), keyframe)
        for keyframe, pose in zip(keyframes, poses, strict=True)
        if not keyframe.is_place_alone
    ]


def graph_of(
    keyframes: Sequence[Keyframe],
    loops: Sequence[Loop],
    poses: FloatArray,
    step_sigma: tuple[float, float, float] = STEP_SIGMA,
) -> PoseGraph:
    """The pose graph of keyframes at poses (K, 3): the steps between them, then the loops."""
    graph = PoseGraph()
    for pose in poses:
        graph.add_node(SE2.from_array(pose))
    add_steps(graph, 1, keyframes[1:], step_sigma)
    for loop in loops:
        add_loop(graph, loop)
    return graph


def add_steps(
    graph: PoseGraph,
    first: int,
    keyframes: Sequence[Keyframe],
    step_sigma: tuple[float, float, float] = STEP_SIGMA,
) -> None:
    """Adds the ways to keyframes, the first of which is that node, each from the one before: an edge of the wheels
    and one of the scans, see `slam.step_factors`."""
    for index, factors in enumerate(step_factors(keyframes, diagonal_of(step_sigma)), start=first):
        for T_before, information in factors:
            graph.add_edge(index - 1, index, T_before, information)


def add_loop(graph: PoseGraph, loop: Loop) -> int:
    """The number of the loop's edge."""
    return graph.add_edge(
        loop.earlier, loop.later, loop.T_earlier_later, loop.information, EdgeKernel.LOOP
    )

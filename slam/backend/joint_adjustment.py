"""Joint adjustment: every scan held against the surfaces that all other scans saw."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray
from slam.frontend.keyframes import Keyframe
from slam.loop_closing import Loop
from slam.pose_graph import PoseGraph
from slam.se2 import SE2
from slam.slam_map import graph_of
from slam.surface.surface_map import SurfaceMap, SurfaceMapConfig, moved

_LITTLE = 1e-6
"""Information so that none is singular: a thousand metres, as many radians."""


@dataclass(frozen=True)
class AdjustmentConfig:
    """How poses are adjusted to the surfaces.

    rounds: of surfaces made anew and poses solved. weight: of a scan's information beside that of
    steps and loops. least_inlier_ratio, least_seen_ratio, most_m: a scan that fits worse, sees
    less of what others saw, or moves farther at once is left where steps and loops have it. Chosen,
    all of these.
    """

    rounds: int = 2
    weight: float = 2.0
    least_inlier_ratio: float = 0.8
    least_seen_ratio: float = 0.6
    most_m: float = 0.1


def jointly_adjusted(
    keyframes: Sequence[Keyframe],
    loops: Sequence[Loop],
    poses: FloatArray,
    config: AdjustmentConfig | None = None,
    surfaces: SurfaceMapConfig | None = None,
) -> FloatArray:
    """(K, 3) the poses at which steps, loops, and each scan on the surfaces of all others agree.

    poses: (K, 3) on which steps and loops agree already. By turns, surfaces are learnt from the
    scans at their poses, and the poses solved for, with where each scan fits those surfaces as one
    measurement more. Surfaces and poses in one system of equations, as in bundle adjustment, would
    converge in a few rounds where these go on by little, as along the wall of a round room.
    """
    config = config or AdjustmentConfig()
    for _ in range(config.rounds if len(keyframes) > 1 else 0):
        graph = graph_of(keyframes, loops, poses)
        _add_fits(graph, keyframes, poses, config, SurfaceMap(surfaces))
        poses = graph.solve().poses[: len(keyframes)]
    return poses


def _add_fits(
    graph: PoseGraph,
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
    config: AdjustmentConfig,
    surfaces: SurfaceMap,
) -> None:
    """Adds the frame of the surfaces, and where each scan fits in it what the others saw.

    The first keyframe, where the map's own frame is, fits them too: held by its steps alone, it would
    lie as far off as the few scans next to it are.
    """
    placed = [
        moved(SE2.from_array(pose), surfaces.thinned(keyframe.faced))
        for pose, keyframe in zip(poses, keyframes, strict=True)
    ]
    for points in placed:
        surfaces.add(points)
    little = _LITTLE * np.eye(3)
    frame = graph.add_node(SE2.identity())
    graph.add_edge(0, frame, SE2.from_array(poses[0]).inverse(), little)  # where none fits
    for index in range(len(keyframes)):
        if keyframes[index].is_place_alone:
            continue
        T_now = SE2.from_array(poses[index])
        surfaces.remove(placed[index])
        match = surfaces.match_alone(keyframes[index].faced, T_now)
        surfaces.add(placed[index])
        step = T_now.inverse() @ match.T_map_base
        if (
            match.inlier_ratio >= config.least_inlier_ratio
            and match.seen_ratio >= config.least_seen_ratio
            and math.hypot(step.x, step.y) <= config.most_m
        ):
            # a direction that no surface holds tells nothing
            information = config.weight * match.information + little
            graph.add_edge(frame, index, match.T_map_base, information)

"""How far a map may be off along walls that look the same all along: there the wheels alone tell how
far the robot went, with a scale that is known so well, and a noise of their own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slam.arrays import BoolArray, FloatArray
from slam.front_end import FrontEnd
from slam.map_drift import drift_m
from slam.rescaling import chained, rescaled
from slam.slam_map import SlamMap, graph_of
from slam.wheel_scale import ScaledStep, WheelScale

_MOST_SPREAD_M = 0.15
"""Chosen: of a map's poses, as root mean square, for one standard deviation of the scale."""
_MOST_NOISE_M = 0.15
"""Chosen: of a map's poses, as root mean square, for the noise that the wheels have shown."""
_MOST_NOISE = 0.004
"""Of the distance between the corners of what was driven, where that makes more. Chosen on simulated
buildings: ways of 15 to 100 m of which wheels as noisy as they are told to be say up to 0.0035, and of
which noisier ones make wrong maps 0.0041, 0.0047 and more."""
_KNOWN = np.diag([1e-6, 1e-6, 1e-8])
_KNOWN_SIGMA = 1e-3, 1e-3, 1e-4
"""[m, m, rad] of steps of which scans tell enough. Chosen: little, beside what scans leave open."""


def unknown_ways(slam_map: SlamMap, front_end: FrontEnd, noise_ratio: float) -> list[str]:
    """In words, that a map may be too long or short, or wrong in its parts: scans left open how far
    the robot went, and the wheels tell it not well enough. front_end: of its last session; noise_ratio: see `ComparedWays`."""
    session = slam_map.session_count - 1
    is_open: BoolArray = np.zeros(len(slam_map.keyframes), dtype=np.bool_)
    is_open[
        [
            step.keyframe
            for step in slam_map.steps
            if step.session == session and step.is_keyframe and step.is_open
        ]
    ] = True
    return unknown_lengths(slam_map, front_end.scaled_steps, front_end.wheel_scale) or noisy_ways(
        slam_map, is_open, noise_ratio
    )


def unknown_lengths(
    slam_map: SlamMap, steps: Sequence[ScaledStep], wheel_scale: WheelScale
) -> list[str]:
    """What the wheels' scale leaves open, which is not known well enough for it. steps: of the last
    keyframes, from a session's first on."""
    if len(steps) < 2:
        return []
    keyframes, poses = slam_map.keyframes, slam_map.poses
    first = len(keyframes) - len(steps)
    off = [ScaledStep(wheel_scale.scale - wheel_scale.sigma, step.slope) for step in steps]
    longer = rescaled(keyframes, off, wheel_scale.scale)
    # loops but lessen it: most maps need no second look
    if _spread_m(chained(longer, poses, first) - chained(keyframes, poses, first)) < _MOST_SPREAD_M:
        return []
    before, after = (
        graph_of(one, slam_map.loops, poses).solve().poses for one in (keyframes, longer)
    )
    spread_m = _spread_m(after - before)
    if spread_m < _MOST_SPREAD_M:
        return []
    return [
        "walls along the way look the same all along, and how far the robot went between them the"
        f" wheels alone tell, whose scale is known to {100.0 * wheel_scale.sigma:.1f} %: the map may"
        f" be off by {spread_m:.1f} m"
    ]


def noisy_ways(slam_map: SlamMap, is_open: BoolArray, noise_ratio: float) -> list[str]:
    """What the wheels' noise leaves open. is_open: (K,) keyframes whose scan does not tell how far it
    was from the one before; noise_ratio: see
    `ComparedWays`."""
    keyframes, poses = slam_map.keyframes, slam_map.poses
    if not is_open.any():
        return []
    most_m = max(_MOST_NOISE_M, _MOST_NOISE * float(np.hypot(*np.ptp(poses[:, :2], axis=0))))
    told = [
        one if is_one else replace(one, covariance=_KNOWN)
        for one, is_one in zip(keyframes, is_open, strict=True)
    ]
    # one after the other they are off by no more: most maps need no second look
    chain_m = math.sqrt(sum(float(np.trace(one.covariance[:2, :2])) for one in told))
    if noise_ratio * chain_m < most_m:
        return []
    graph = graph_of(told, slam_map.loops, poses, _KNOWN_SIGMA)
    noise_m = noise_ratio * drift_m(graph, np.arange(len(keyframes)))
    if noise_m < most_m:
        return []
    return [
        "walls along the way look the same all along, so that scans do not tell how far the robot"
        " went between them, and wheels not well enough: by how they agree with scans elsewhere, the"
        f" map may be off by {noise_m:.1f} m"
    ]


def _spread_m(moved: FloatArray) -> float:
    """How far poses have moved (K, 3) against one another, as root mean square [m]."""
    return math.sqrt(float(np.var(moved[:, 0]) + np.var(moved[:, 1])))

"""A drive by the scale of its wheels that is known in the end, and how much that leaves open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray
from slam.keyframes import Keyframe
from slam.loop_closing import Loop
from slam.se2 import SE2
from slam.slam_map import graph_of
from slam.wheel_scale import ScaledStep, WheelScale

_MOST_SPREAD_M = 0.15
"""Chosen: of a map's poses, as root mean square, for one standard deviation of the scale."""


def rescaled(
    keyframes: Sequence[Keyframe], steps: Sequence[ScaledStep], scale: float
) -> list[Keyframe]:
    """Keyframes whose steps from one to the next are as by another scale; steps: of each, how the
    way to it depends on the scale. Those before the steps' first stay, as that itself does."""
    first = len(keyframes) - len(steps)
    moved = list(keyframes)
    for k, step in enumerate(steps[1:], start=first + 1):
        T_before = moved[k].T_before @ SE2.exp((scale - step.scale) * step.slope)
        moved[k] = replace(moved[k], T_before=T_before)
    return moved


def chained(keyframes: Sequence[Keyframe], poses: FloatArray, first: int) -> FloatArray:
    """Poses (K, 3), from the first on each as its keyframe's step leads from the one before."""
    poses = poses.copy()
    for k in range(first + 1, len(keyframes)):
        poses[k] = (SE2.from_array(poses[k - 1]) @ keyframes[k].T_before).as_array()
    return poses


def unknown_lengths(
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
    loops: Sequence[Loop],
    steps: Sequence[ScaledStep],
    wheel_scale: WheelScale,
) -> list[str]:
    """In words, that a map (K keyframes at poses (K, 3), with its loops) may be too long or short:
    scans left open how far the robot went, and the wheels' scale is not known well enough for it."""
    if len(steps) < 2:
        return []
    first = len(keyframes) - len(steps)
    off = [ScaledStep(wheel_scale.scale - wheel_scale.sigma, step.slope) for step in steps]
    longer = rescaled(keyframes, off, wheel_scale.scale)
    # loops but lessen it: most maps need no second look
    if _spread_m(chained(longer, poses, first) - chained(keyframes, poses, first)) < _MOST_SPREAD_M:
        return []
    before, after = (graph_of(one, loops, poses).solve().poses for one in (keyframes, longer))
    spread_m = _spread_m(after - before)
    if spread_m < _MOST_SPREAD_M:
        return []
    return [
        "walls along the way look the same all along, and how far the robot went between them the"
        f" wheels alone tell, whose scale is known to {100.0 * wheel_scale.sigma:.1f} %: the map may"
        f" be off by {spread_m:.1f} m"
    ]


def _spread_m(moved: FloatArray) -> float:
    """How far poses have moved (K, 3) against one another, as root mean square [m]."""
    return math.sqrt(float(np.var(moved[:, 0]) + np.var(moved[:, 1])))

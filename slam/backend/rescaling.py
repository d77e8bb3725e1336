"""A drive by the scale of its wheels that is known in the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from slam.arrays import FloatArray
from slam.frontend.keyframes import Keyframe
from slam.frontend.wheel_scale import ScaledStep
from slam.se2 import SE2


def rescaled(
    keyframes: Sequence[Keyframe], steps: Sequence[ScaledStep], scale: float
) -> list[Keyframe]:
    """Keyframes whose steps from one to the next are as by another scale of the wheels; steps: of each, how the
    way to it depends on the scale. Those before the steps' first stay, as that itself does."""
    first = len(keyframes) - len(steps)
    moved = list(keyframes)
    for k, step in enumerate(steps[1:], start=first + 1):
        T_before = moved[k].T_before @ SE2.exp((scale - step.scale) * step.slope)
        told = moved[k].told.longer(scale / step.scale)
        moved[k] = replace(moved[k], T_before=T_before, told=told)
    return moved


def chained(keyframes: Sequence[Keyframe], poses: FloatArray, first: int) -> FloatArray:
    """Poses (K, 3), from the first on each as its keyframe's step leads from the one before."""
    poses = poses.copy()
    for k in range(first + 1, len(keyframes)):
        poses[k] = (SE2.from_array(poses[k - 1]) @ keyframes[k].T_before).as_array()
    return poses

"""Scans that are seen from a keyframe which is put back: whoever drew that aside may not have drawn them.

They were matched each by itself. Of a keyframe that was 0.3 m off, the next scans, which were right, were 0.3 m
off the other way once it was right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

from slam.arrays import FloatArray
from slam.frontend.keyframes import FrontEndStep, Steps, keyframe_ways
from slam.frontend.strays import apart_m
from slam.frontend.told_steps import ToldStep
from slam.se2 import SE2


def with_followers_left(
    steps: Steps,
    first_step: int,
    told: Sequence[ToldStep],
    poses: FloatArray,
    moved: Mapping[int, SE2],
) -> Steps:
    """All steps, those of the last session left where they were whose keyframe has moved, if they lie nearer
    there to the way to the next one than if they go with it.

    first_step: with which the session begins; told: the motion by the wheels to each of its scans, from the one
    before. poses: (K, 3) of the keyframes [m, rad]; moved: where each of those that were was before, as seen
    from where it is.
    """
    found = copy(steps)
    for start, end in keyframe_ways(steps, first_step):
        k = steps[start].keyframe
        if k not in moved:
            continue
        T_end = SE2.from_array(poses[k]).between(SE2.from_array(poses[steps[end].keyframe]))
        for at in range(start + 1, end):
            step = steps[at]
            way = told[start + 1 - first_step : at + 1 - first_step]
            if any(one.is_guess for one in way):
                T_way = SE2.exp(share_of_way(steps, start, at, end) * T_end.log())
            else:
                T_way = ToldStep.of(way).motion
            T_left = moved[k] @ step.T_keyframe_base
            if apart_m(T_way, T_left) < apart_m(T_way, step.T_keyframe_base):
                found[at] = replace(step, T_keyframe_base=T_left)
    return found


def share_of_way(steps: Sequence[FrontEndStep], start: int, at: int, end: int) -> float:
    """Of the way from one scan to another, after which a scan between them lies; stamps may stand, or go back."""
    start_s, at_s, end_s = (steps[index].time_s for index in (start, at, end))
    if start_s <= at_s <= end_s and start_s < end_s:
        return (at_s - start_s) / (end_s - start_s)
    return (at - start) / (end - start)

"""Scans between two keyframes that lie aside of where the wheels went from one to the other.

No loop ties such a scan, and no check of the map asks it: if it once fits beside where it was taken,
between walls that look the same or in open ground, the next one is placed right, and it stays there.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from slam.arrays import FloatArray
from slam.frontend.keyframes import Steps, keyframe_ways
from slam.frontend.open_runs import EXACTLY, tied
from slam.frontend.told_steps import ToldStep
from slam.frontend.wheel_scale import WheelScale
from slam.kernels.normal_equations import inverse_of
from slam.packed import each
from slam.se2 import SE2, wrap_angle

_TRUST = 20.0
"""Of normalised errors squared, as in `FrontEndConfig`: the wheels' from one keyframe to the next, up to
which they say where the robot was between them, and a scan's beside that, beyond which it strayed."""
_FAR_TRUST, _FAR_M = 11.3, 0.3
"""The same of a scan that far off the way: 1 % of right ones are, and those then lie as well where wheels led. Chosen:
of five real logs none is; by wheels 12 % off one that people drew was 0.52 m off, by 13.6."""
_LEAST_M = 0.1
"""Off the way; nearer scans are as good as they are. Chosen: in the door of place_fig6, beside people, nine scans
in a row were up to 0.21 m off and looked through what stands there."""
_LEAST_NOISE = 0.1
"""Of wheels; chosen: over a short way they are hardly as good as over a long one."""
_HALF_WAY = 0.25
"""Share of the square of what wheels were off at the end of a way, by which half of it is less sure."""
_TURNED, _STEADY = 0.5, 0.15
"""[rad] by which odometry turned otherwise than scans at one step and no more than at all others, if it jumped there.
Chosen: of what else may be wrong with a scan, its heading is hardly ever."""


def with_scans_put_back(
    steps: Steps,
    first_step: int,
    told: Sequence[ToldStep],
    wheel_scale: WheelScale,
    poses: FloatArray,
    is_doubted: bool = False,
    noise: float | None = None,
) -> Steps:
    """All steps, those of the last session that had strayed on the way between their keyframes.

    is_doubted: scans that do not say where they were taken had been placed without the wheels; they are
    put there as well.

    first_step: with which the session begins; told: the motion by the wheels to each of its scans,
    from the one before. poses: (K, 3) of the keyframes [m, rad]. noise: variance of the wheels, as a
    multiple of what was told; None: as `WheelScale` learnt it.
    """
    noise = wheel_scale.noise if noise is None else max(noise, _LEAST_NOISE)
    moved = copy(steps)
    for start, end in keyframe_ways(steps, first_step):
        if end == start + 1:
            continue
        before, after = (SE2.from_array(poses[steps[at].keyframe]) for at in (start, end))
        step_told = told[start + 1 - first_step : end + 1 - first_step]
        seen: list[SE2] = [steps[at].T_keyframe_base for at in range(start + 1, end)]
        way = _Way.told(step_told, wheel_scale, noise, [*seen, before.inverse() @ after])
        if way is None:
            continue
        for at, T_way in enumerate(way.poses, start=start + 1):
            step = steps[at]
            is_to_move = step.is_seen and way.is_off(T_way, step.T_keyframe_base)
            is_to_move |= is_doubted and (step.is_open or not step.is_seen)
            if is_to_move and not T_way.is_near(step.T_keyframe_base, _LEAST_M, math.inf):
                T_map_base = steps[start].T_map_base @ T_way
                moved[at] = replace(step, T_map_base=T_map_base, T_keyframe_base=T_way)
    return moved


@dataclass(frozen=True, eq=False)
class _Way:
    """Of the wheels from one keyframe to the next, but for these; as seen from the first of them.

    covariance: (3, 3) of where it leads, half-way between its ends.
    """

    poses: list[SE2]
    covariance: FloatArray

    @staticmethod
    def told(
        steps: Sequence[ToldStep], wheel_scale: WheelScale, noise: float, seen: Sequence[SE2]
    ) -> _Way | None:
        """Ends where it should, the last of where its scans were seen, by as much as it gets less sure on the
        way; None where wheels are off by more than they should be, or told nothing. They may have jumped, once."""
        if sum(step.is_guess for step in steps) > 1:
            return None
        scaled = each(steps, wheel_scale.scaled_step)
        way, T_end = ToldStep.of(scaled), seen[-1]
        off = (way.motion.inverse() @ T_end).log()
        loosely = max(noise, wheel_scale.noise)
        if off @ inverse_of(loosely * way.covariance) @ off > _TRUST:
            return _Way._jumped(scaled, noise, seen)
        covariance = noise * way.covariance + _HALF_WAY * np.outer(off, off)
        motions = tied(scaled, T_end, EXACTLY)
        poses = list(accumulate(motions[:-1], operator.matmul))
        return _Way(poses, covariance)

    @staticmethod
    def _jumped(steps: Sequence[ToldStep], noise: float, seen: Sequence[SE2]) -> _Way | None:
        """From the start up to the one step at which odometry turned at once, and back from the end to it."""
        turns = [
            step.motion.theta - (one.inverse() @ other).theta
            for step, one, other in zip(steps, [SE2.identity(), *seen], seen, strict=False)
        ]
        turned = np.abs(wrap_angle(np.array(turns)))
        jump = int(np.argmax(turned))
        if turned[jump] < _TURNED or np.delete(turned, jump).max(initial=0.0) > _STEADY:
            return None
        before, after = steps[:jump], steps[jump + 1 :]
        there = accumulate((step.motion for step in before), operator.matmul)
        back = accumulate(
            (step.motion.inverse() for step in reversed(after)), operator.matmul, initial=seen[-1]
        )
        poses = [*there, *list(back)[:0:-1]]
        return _Way(poses, noise * ToldStep.of((*before, *after)).covariance)

    def is_off(self, T_way: SE2, T_seen: SE2) -> bool:
        """Whether a scan seen at one pose was rather taken at the one on the way."""
        off = (T_way.inverse() @ T_seen).log()
        most = _FAR_TRUST if math.hypot(off[0], off[1]) > _FAR_M else _TRUST
        return bool(off @ inverse_of(self.covariance) @ off > most)

"""Steps to scans that fit badly, where wheels led elsewhere: nobody knows which of the two is right."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray
from slam.front_end import FrontEnd
from slam.kernels.normal_equations import inverse_of
from slam.keyframe_graph import KeyframeGraph
from slam.keyframes import FrontEndStep, Keyframe
from slam.strays import ToldStep
from slam.wheels_borne_out import shown_noise

_WEAK = (0.8, 8.0), (0.9, 80.0)
"""Share of a scan that fits, below which it may be where it seems, or not; and the wheels' normalised error
squared, by as noisy as they show elsewhere, beyond which one of the two is wrong: the first is 0.95 of chi2
with three degrees of freedom. Chosen: of scans 2 to 3 m apart in the corridors of aces, some that fit by
0.66 to 0.77 were 0.3 to 0.5 m off; beside people in the door of place_fig6, where wheels are a tenth as
noisy as they say, one that fits by 0.87 was 7 cm off."""
_STAYED, _LOST_M = (math.inf, 80.0), 0.15
"""The same of scans that have the robot go less far than wheels drove it, by more than so much [m]: somebody may
have walked ahead."""

_NO_WAY_M = 1e-6
_LEAST_NOISE = 0.01
"""Variance of wheels, as a share of what they are told to have. Chosen: none are as good as their ticks."""


class WeakSteps:
    """Steps that are less sure than the front end said, as found last; whoever asks again begins with
    what it said."""

    def __init__(self) -> None:
        self._said = dict[int, tuple[FloatArray, FloatArray]]()

    def loosen(
        self, graph: KeyframeGraph, front_end: FrontEnd, steps: Sequence[FrontEndStep]
    ) -> None:
        """Has loops say where the steps of a graph's last session led to scans that fit badly, and where
        the wheels did not lead. steps: of all scans."""
        told, before = front_end.told_steps, self._tightened(graph.keyframes)
        noise = shown_noise(before, graph.poses, told, least=_LEAST_NOISE)
        if noise is None:
            return
        fits = {step.keyframe: step.inlier_ratio for step in steps if step.is_keyframe}
        keyframes = loosened(before, told, fits, noise)
        self._said = {
            k: (one.covariance, other.covariance)
            for k, (one, other) in enumerate(zip(keyframes, before, strict=True))
            if one is not other
        }
        graph.renew(keyframes, graph.loops, graph.poses)

    def _tightened(self, keyframes: Sequence[Keyframe]) -> list[Keyframe]:
        """Keyframes as sure as they were, but those of which something else is known by now."""
        found = list(keyframes)
        for k, (loose, said) in self._said.items():
            if found[k].covariance is loose:
                found[k] = replace(found[k], covariance=said)
        return found


def loosened(
    keyframes: Sequence[Keyframe],
    told: Sequence[ToldStep],
    inlier_ratios: Mapping[int, float],
    noise: float,
) -> list[Keyframe]:
    """Keyframes, those that fit badly and against the wheels as unsure as the two are apart: then loops say.

    told: of the last keyframes, from a session's first on, what the wheels say of the way to each;
    inlier_ratios: of these, by their number; noise: variance of the wheels as other scans show it, as a
    multiple of what was told, be it less.
    """
    found, first = list(keyframes), len(keyframes) - len(told)
    for k in range(first + 1, len(keyframes)):
        one, by_wheels = keyframes[k], told[k - first]
        if one.is_break or by_wheels.is_guess:
            continue
        apart = (one.T_before.inverse() @ by_wheels.motion).log()
        squared = apart @ inverse_of(noise * by_wheels.covariance) @ apart
        limits = (*_WEAK, _STAYED) if _way_lost_m(one, by_wheels) > _LOST_M else _WEAK
        if any(inlier_ratios[k] < fit and squared > most for fit, most in limits):
            found[k] = replace(one, covariance=one.covariance + np.outer(apart, apart))
    return found


def _way_lost_m(keyframe: Keyframe, by_wheels: ToldStep) -> float:
    """How much less far the robot went to a keyframe than wheels drove it."""
    way, made = by_wheels.motion, keyframe.T_before
    way_m = math.hypot(way.x, way.y)
    return way_m - (made.x * way.x + made.y * way.y) / max(way_m, _NO_WAY_M)

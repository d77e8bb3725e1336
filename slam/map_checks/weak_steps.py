"""Steps to scans that fit badly, or stayed behind, where wheels led elsewhere: nobody knows which of the two is
right, but loops may."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray
from slam.backend.keyframe_graph import KeyframeGraph
from slam.frontend.keyframes import FrontEndStep, Keyframe, as_sure_as_before, said_of
from slam.frontend.remaining import Remaining
from slam.frontend.told_steps import ToldStep
from slam.kernels.normal_equations import inverse_of
from slam.loop_closing import Loop, LoopCloser
from slam.map_checks.wheels_borne_out import shown_noise
from slam.se2 import SE2

_WEAK = (0.8, 8.0), (0.9, 80.0)
"""Share of a scan that fits, below which it may be where it seems, or not; and the wheels' normalised error
squared, by as noisy as they show elsewhere, beyond which one of the two is wrong: the first is 0.95 of chi2
with three degrees of freedom. Chosen: of scans 2 to 3 m apart in the corridors of aces, some that fit by
0.66 to 0.77 were 0.3 to 0.5 m off; beside people in the door of place_fig6, where wheels are a tenth as
noisy as they say, one that fits by 0.87 was 7 cm off."""
_STAYED, _LOST_M = 80.0, 0.15
"""Normalised error squared of wheels, and how much farther they drove a robot than scans have it [m], beyond which
either they spun, or somebody walked ahead. Chosen."""
_BORNE_OUT = 0.5, 1.5
"""Shares of what such a step is short of the wheels, between which loops lengthen it, if these are right. Chosen: a
loosened step takes some of what else a loop finds wrong on its way, and a right one was 0.6 m less sure for it."""
_NO_WAY_M = 1e-6
_LEAST_NOISE = 0.01
"""Variance of wheels, as a share of what they are told to have. Chosen: none are as good as their ticks."""


class WeakSteps:
    """Steps that are less sure than the front end said, as found last; whoever asks again begins with
    what it said."""

    def __init__(self) -> None:
        self._said = dict[int, tuple[FloatArray, FloatArray]]()

    def renumber(self, remaining: Remaining) -> None:
        """Keyframes were let go."""
        said = said_of(self._said, remaining)
        self._said.clear()  # not another one: who closes loops looks at it as well
        self._said.update(said)

    def loosen(
        self,
        graph: KeyframeGraph,
        told: Sequence[ToldStep],
        steps: Sequence[FrontEndStep],
        closer: LoopCloser,
    ) -> None:
        """Has loops say where the steps of a graph's last session led to scans that fit badly, or stayed behind,
        and where the wheels did not lead. told: by these to each of its keyframes; steps: of all scans; closer: of the loops, that looks no more at what was
        seen on both sides of such a step, and whose loops with that are let go."""
        before = as_sure_as_before(graph.keyframes, self._said)
        noise = shown_noise(before, graph.poses, told, least=_LEAST_NOISE)
        if noise is None:
            return
        fits = {step.keyframe: step.inlier_ratio for step in steps if step.is_keyframe}
        keyframes = loosened(before, told, fits, noise)
        if graph.loops:
            stayed = stayed_behind(before, told, noise)
            stayed = {k: apart for k, apart in stayed.items() if keyframes[k] is before[k]}
            loops = closer.undoubted(before, graph.loops, stayed.keys())
            keyframes = _loosened(keyframes, _borne_out(graph, keyframes, loops, stayed))
        self._said = {
            k: (one.covariance, other.covariance)
            for k, (one, other) in enumerate(zip(keyframes, before, strict=True))
            if one is not other
        }
        closer.doubted = self._said.keys()
        loops = closer.undoubted(keyframes, graph.loops, closer.doubted)
        graph.renew(keyframes, loops, graph.poses)


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
    weak = {
        k: apart
        for k, apart, squared in _denied(keyframes, told, noise)
        if any(inlier_ratios[k] < fit and squared > most for fit, most in _WEAK)
    }
    return _loosened(keyframes, weak)


def stayed_behind(
    keyframes: Sequence[Keyframe], told: Sequence[ToldStep], noise: float
) -> dict[int, FloatArray]:
    """Keyframes to which the robot went less far than wheels drove it, however well they fit, and where these
    are from there: (3,) in the Lie algebra [m, m, rad]. told, noise: as in `loosened`."""
    first = len(keyframes) - len(told)
    return {
        k: apart
        for k, apart, squared in _denied(keyframes, told, noise)
        if squared > _STAYED and _way_lost_m(keyframes[k], told[k - first]) > _LOST_M
    }


def _borne_out(
    graph: KeyframeGraph,
    keyframes: list[Keyframe],
    loops: list[Loop],
    stayed: Mapping[int, FloatArray],
) -> dict[int, FloatArray]:
    """Those of keyframes that stayed behind, and how far (3,), which loops put where wheels led as soon as
    they may; the graph stays."""
    if not stayed:
        return {}
    known, poses = graph.loops, graph.poses.copy()
    graph.renew(_loosened(keyframes, stayed), loops, poses)
    solved = graph.solve().poses
    graph.renew(keyframes, known, poses)
    shares = {k: _share(keyframes[k], solved[k - 1 : k + 1], apart) for k, apart in stayed.items()}
    least, most = _BORNE_OUT
    return {k: apart for k, apart in stayed.items() if least < shares[k] < most}


def _denied(
    keyframes: Sequence[Keyframe], told: Sequence[ToldStep], noise: float
) -> Iterator[tuple[int, FloatArray, float]]:
    """Keyframes of which wheels tell something, where these are from there (3,), and their normalised error
    squared."""
    first = len(keyframes) - len(told)
    for k in range(first + 1, len(keyframes)):
        one, by_wheels = keyframes[k], told[k - first]
        if not (one.is_break or by_wheels.is_guess):
            apart = (one.T_before.inverse() @ by_wheels.motion).log()
            yield k, apart, float(apart @ inverse_of(noise * by_wheels.covariance) @ apart)


def _loosened(keyframes: Sequence[Keyframe], apart: Mapping[int, FloatArray]) -> list[Keyframe]:
    """Keyframes, some of them less sure by how far (3,) something else has them."""
    found = list(keyframes)
    for k, off in apart.items():
        found[k] = replace(found[k], covariance=found[k].covariance + np.outer(off, off))
    return found


def _share(keyframe: Keyframe, poses: FloatArray, apart: FloatArray) -> float:
    """Share of where the wheels are from a keyframe (3,), by which it lies there at poses (2, 3), of the one before
    and itself."""
    T_before, T_there = (SE2.from_array(pose) for pose in poses)
    moved = (keyframe.T_before.inverse() @ T_before.inverse() @ T_there).log()
    return float(moved[:2] @ apart[:2] / (apart[:2] @ apart[:2]))


def _way_lost_m(keyframe: Keyframe, by_wheels: ToldStep) -> float:
    """How much less far the robot went to a keyframe than wheels drove it."""
    way, made = by_wheels.motion, keyframe.T_before
    way_m = math.hypot(way.x, way.y)
    return way_m - (made.x * way.x + made.y * way.y) / max(way_m, _NO_WAY_M)

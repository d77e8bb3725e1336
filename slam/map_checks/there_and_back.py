"""Keyframes that lie aside for a moment, while wheels that lead on to the next ones say nothing of it.

Somebody walks by, and one, two or three scans fit beside where they were taken, and hardly where they
were: no look at surfaces puts them back. But a robot does not jump aside and back.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate, pairwise

import numpy as np

from slam.arrays import FloatArray
from slam.backend.keyframe_graph import KeyframeGraph
from slam.frontend.keyframes import Keyframe
from slam.frontend.open_runs import EXACTLY, tied
from slam.frontend.strays import StrayConfig, apart_m, without_strays
from slam.frontend.told_steps import ToldStep
from slam.loop_closing import Loop
from slam.map_checks.wheels_borne_out import shown_noise
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMapConfig

_RUNS = 1, 2, 3
"""So many keyframes in a row. Chosen, as all of these, on two simulated logs of 64 on which single scans
were half a metre off and more."""
_LEAST_M = 0.3
"""Off the way of the wheels; nearer ones do a map no harm."""
_TRUST = 20.0
"""Of the wheels' normalised error squared over all of a run, up to which they are believed; and of that to
the keyframes in it, beyond which these are elsewhere. As in `FrontEndConfig`."""
_TOGETHER, _DETOUR_M = 40.0, 0.6
"""The same of all steps of a run, none of which wheels are sure of, and by how much longer the way is by scans: then
some went back that wheels had go on. Chosen: three keyframes that lay up to 0.9 m ahead came to 67 and 1.5 m; of
76 maps of four logs, most of them damaged, no other run was more than 0.3 m longer."""
_LATER, _LATE_M = 4, 0.15
"""Steps after a run in which wheels may not tell of other ways than scans, and by how much: those that are
late show then where the robot had been."""
_SILENT_M = 1e-3
"""A step of which wheels tell nothing: they may be silent while the robot drives."""
_SMOOTHER = 0.3
"""Share of the unevenness of the way as scans have it, that wheels may show: those that tell of a way late
stop where scans go on."""


def put_strays_back(
    graph: KeyframeGraph,
    told: Sequence[ToldStep],
    by_wheels: Sequence[ToldStep],
    config: StrayConfig,
    surfaces: SurfaceMapConfig,
) -> dict[int, SE2]:
    """Which keyframes of a graph lay aside of the way, now that they are put back, where they fit as well and
    where the wheels lead; and where each was before, as seen from where it is.

    told: what is believed of the way to each of the last keyframes; by_wheels: what these say of it,
    believed or not.
    """
    if graph.loops:
        graph.solve()
    keyframes, loops, poses, fitting = without_strays(
        graph.keyframes, graph.loops, graph.poses, told, config, surfaces
    )
    keyframes, loops, poses, aside = put_on_the_way(keyframes, loops, poses, by_wheels)
    strays = sorted({*fitting, *aside})
    before, now = ([SE2.from_array(pose) for pose in of[strays]] for of in (graph.poses, poses))
    if strays:
        graph.renew(keyframes, loops, poses)
    return {k: T.between(T_was) for k, T, T_was in zip(strays, now, before, strict=True)}


def put_on_the_way(
    keyframes: Sequence[Keyframe],
    loops: Sequence[Loop],
    poses: FloatArray,
    told: Sequence[ToldStep],
) -> tuple[list[Keyframe], list[Loop], FloatArray, list[int]]:
    """Keyframes at poses (K, 3) [m, rad], those that lie aside for a moment where the wheels lead.

    told: of the last keyframes, what the wheels say of the way to each. Of those that are moved the
    place alone is kept: what they saw is not where it seemed to be. Also the loops but theirs, the
    poses, and which they are.
    """
    found, moved, strays = list(keyframes), poses.copy(), list[int]()
    first, noise = len(keyframes) - len(told), shown_noise(keyframes, poses, told)
    if noise is None:
        return found, list(loops), moved, strays
    for k in range(first + 2, len(keyframes) - 1):
        for run in (one for one in _RUNS if k + one < len(keyframes)):
            steps = [
                replace(one, covariance=noise * one.covariance)
                for one in told[k - 1 - first : k + run + 1 - first]
            ]
            is_broken = any(keyframes[at].is_break for at in range(k, k + run))
            is_broken |= any(keyframes[at].is_after_gap for at in range(k - 1, k + run + 1))
            later = slice(k + run - first + 1, k + run - first + 1 + _LATER)
            is_late = _disagree(moved[k + run : k + run + 1 + _LATER], told[later])
            near = slice(k - 2, k + run + 1)
            times_s = [one.time_s for one in keyframes[near]]
            way = None if is_broken or is_late else _way(moved[near], steps, times_s)
            if way is None:
                continue
            for at, (motion, step) in enumerate(zip(way, steps[1:], strict=True), start=k):
                # over a break nobody knows the way better than before
                known = found[at].covariance if found[at].is_break else step.covariance
                found[at] = replace(found[at], T_before=motion, covariance=known)
            for at, motion in enumerate(way[:-1], start=k):
                moved[at] = (SE2.from_array(moved[at - 1]) @ motion).as_array()
                found[at] = found[at].place_alone()
                strays.append(at)
    gone = set(strays)
    kept = [loop for loop in loops if loop.earlier not in gone and loop.later not in gone]
    return found, kept, moved, strays


def _way(
    poses: FloatArray, steps: Sequence[ToldStep], times_s: Sequence[float]
) -> list[SE2] | None:
    """The motions of all steps but the first, as wheels tell them, each changed by its share so that they
    end at the last pose; None if wheels lead elsewhere, or not aside of all poses in between, or are no
    smoother than these. poses, times_s: (N + 1, 3) and (N + 1), of which steps (N) lead from one to the next."""
    if any(
        step.is_guess or step.motion.is_near(SE2.identity(), _SILENT_M, math.inf) for step in steps
    ):
        return None
    placed = [SE2.from_array(pose) for pose in poses]
    _, T_before, *aside, T_after = placed
    if ToldStep.of(steps[1:]).squared(T_before, T_after) > _TRUST:
        return None
    motions = tied(steps[1:], T_before.inverse() @ T_after, EXACTLY)
    way = [replace(step, motion=one) for step, one in zip(steps[1:], motions, strict=True)]
    T_way = list(accumulate(motions, operator.matmul, initial=T_before))[1:-1]
    if any(apart_m(one, other) < _LEAST_M for one, other in zip(T_way, aside, strict=True)):
        return None
    is_aside = _is_detour(steps[1:], placed[1:]) or all(
        ToldStep.of(way[: count + 1]).squared(T_before, other) > _TRUST
        for count, other in enumerate(aside)
    )
    by_wheels = [step.motion for step in steps]
    is_smoother = any(
        _unevenness_m(by_wheels, durations_s)
        < _SMOOTHER * _unevenness_m(_motions(poses), durations_s)
        for durations_s in (np.ones(len(steps)), np.diff(times_s))
    )
    return motions if is_aside and is_smoother else None


def _is_detour(steps: Sequence[ToldStep], placed: Sequence[SE2]) -> bool:
    """Whether poses (N + 1) lead there and back, and all together not where steps (N) do, each of which may."""
    ways = list(zip(steps, pairwise(placed), strict=True))
    longer_m = sum(apart_m(*ends) - math.hypot(one.motion.x, one.motion.y) for one, ends in ways)
    return longer_m > _DETOUR_M and sum(one.squared(*ends) for one, ends in ways) > _TOGETHER


def _disagree(poses: FloatArray, told: Sequence[ToldStep]) -> bool:
    """Whether wheels tell of another way than poses (N + 1, 3) in any of the steps between these."""
    return any(
        apart_m(one, step.motion) > _LATE_M for one, step in zip(_motions(poses), told, strict=True)
    )


def _motions(poses: FloatArray) -> list[SE2]:
    """(N) from each of poses (N + 1, 3) to the next."""
    placed = [SE2.from_array(pose) for pose in poses]
    return [one.inverse() @ other for one, other in pairwise(placed)]


def _unevenness_m(motions: Sequence[SE2], durations_s: FloatArray) -> float:
    """By how much motions (N) differ, each from the one before, added up, had each taken as long as they do in
    the mean. durations_s: (N) that they took; of stamps that stand or go back nothing is known."""
    if not (durations_s > 0.0).all():
        return math.inf
    shares = (durations_s / durations_s.mean()).tolist()
    even = [
        SE2(one.x / share, one.y / share, one.theta)
        for one, share in zip(motions, shares, strict=True)
    ]
    return sum(apart_m(one, other) for one, other in pairwise(even))

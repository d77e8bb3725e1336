"""Wheels that are not believed, where what scans show from before to after bears them out.

Whoever doubts all of a drive's odometry, since some of it was wrong, loses the rest of it as well: a scan
that leaves the way open then lies where it slid to, and nothing says otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray
from slam.backend.keyframe_graph import KeyframeGraph
from slam.frontend.front_end import FrontEnd
from slam.frontend.keyframes import FrontEndStep, Keyframe
from slam.frontend.open_runs import EXACTLY, tied
from slam.frontend.told_steps import GUESS_M, ToldStep
from slam.frontend.wheel_scale import MEDIAN_NIS
from slam.odometry import place_sigma_m
from slam.pose_graph.solution import PoseGraphSolution
from slam.se2 import SE2

_TRUST = 20.0
"""Of the wheels' normalised error squared from before keyframes that leave the way open to after them, up
to which they are believed in between, as in `FrontEndConfig`."""
_SURE_M = 0.1
"""Standard deviation of steps that show how noisy the wheels are. Chosen."""
_LEAST = 10
"""Of these, before anything is believed. Chosen."""
_BESIDE = (0, 0), (1, 0), (0, 1), (1, 1)
"""Steps before and after, that may be wrong with those that leave the way open: a scan just beside these
that seems to be sure of its place has slid along as well. Chosen."""


def told_to_keyframes(steps: Sequence[FrontEndStep], told: Sequence[ToldStep]) -> list[ToldStep]:
    """By the wheels to each keyframe of a session from the one before; steps: of its scans, and told:
    the motion to each of these from the one before."""
    sums, so_far = list[ToldStep](), ToldStep.none()
    for step, one in zip(steps, told, strict=True):
        so_far = so_far.then(one.motion, one.covariance)
        if step.is_keyframe:
            sums.append(so_far if sums else ToldStep.none())
            so_far = ToldStep.none()
    return sums


def believe_where_borne_out(
    graph: KeyframeGraph,
    front_end: FrontEnd,
    steps: Sequence[FrontEndStep],
    told: Sequence[ToldStep],
) -> None:
    """Takes the steps of a graph's last session by the wheels, where what loops show of a stretch agrees
    with these. steps: of the session's scans; told: the motion to each of these from the one before."""
    if not graph.loops:
        return
    to_keyframes, keyframes = told_to_keyframes(steps, told), list(graph.keyframes)
    first = len(keyframes) - len(to_keyframes)
    for k, step in borne_out(keyframes, graph.solve(), to_keyframes).items():
        own = k - first
        front_end.scaled_steps[own] = replace(front_end.scaled_steps[own], slope=np.zeros(3))
        keyframes[k] = replace(
            keyframes[k], T_before=step.motion, covariance=step.covariance, told=step
        )
    graph.renew(keyframes, graph.loops, graph.poses)


def borne_out(
    keyframes: Sequence[Keyframe], solution: PoseGraphSolution, told: Sequence[ToldStep]
) -> dict[int, ToldStep]:
    """The steps to keyframes that wheels tell better than the scans do, as sure as these wheels are
    elsewhere. told: of the last keyframes, from a session's first on, the step to each.

    It is loops that bear them out: a chain of scans that leave the way open goes where wheels lead.
    """
    first, noise = len(keyframes) - len(told), shown_noise(keyframes, solution.poses, told)
    if noise is None:
        return {}
    found = dict[int, ToldStep]()
    for start, end in _loose(keyframes, first):
        for before, after in _BESIDE:
            low, high = max(start - before, first + 1), min(end + after, len(keyframes) - 1)
            run = range(low, high + 1)
            if any(not keyframes[k].goes_on or told[k - first].is_guess for k in run):
                continue
            steps = [
                replace(told[k - first], covariance=noise * told[k - first].covariance) for k in run
            ]
            way = _way(steps, solution, low - 1, high)
            if way:
                found |= dict(zip(run, way, strict=True))
                break
    return found


def _way(
    steps: Sequence[ToldStep], solution: PoseGraphSolution, start: int, end: int
) -> list[ToldStep]:
    """Steps from one keyframe to another, each changed by its share so that together they end there; none
    where wheels lead elsewhere, or nothing tells where that is."""
    try:
        (known,) = solution.relative_covariances(np.array([(start, end)]))
    except ValueError:  # all that the solver says of a direction without bounds
        return []
    if place_sigma_m(known) > GUESS_M:
        return []
    T_start, T_end = (SE2.from_array(solution.poses[k]) for k in (start, end))
    T_seen, way = T_start.inverse() @ T_end, ToldStep.of(steps)
    if replace(way, covariance=way.covariance + known).squared(SE2.identity(), T_seen) > _TRUST:
        return []
    motions = tied(steps, T_seen, EXACTLY)
    return [replace(step, motion=one) for step, one in zip(steps, motions, strict=True)]


def shown_noise(
    keyframes: Sequence[Keyframe], poses: FloatArray, told: Sequence[ToldStep], least: float = 1.0
) -> float | None:
    """Variance of the wheels as steps show it of which scans are sure, as a multiple of what they were
    told to have; some at least, None where there are not enough. poses: (K, 3) of the keyframes [m, rad];
    told: of the last of them, the step to each."""
    first = len(keyframes) - len(told)
    squared = [
        told[k - first].squared(*(SE2.from_array(pose) for pose in poses[k - 1 : k + 1]))
        for k in showing(keyframes, told)
    ]
    return max(least, float(np.median(squared)) / MEDIAN_NIS) if len(squared) >= _LEAST else None


def showing(keyframes: Sequence[Keyframe], told: Sequence[ToldStep]) -> list[int]:
    """The keyframes of whose step scans are sure, so that it shows what wheels are like; told: of the last keyframes,
    the step to each."""
    first = len(keyframes) - len(told)
    return [
        k
        for k in range(first + 1, len(keyframes))
        if place_sigma_m(keyframes[k].covariance) < _SURE_M and keyframes[k].goes_on
        if not told[k - first].is_guess
    ]


def _loose(keyframes: Sequence[Keyframe], first: int) -> Iterator[tuple[int, int]]:
    """The first and last of steps one after the other of which scans hardly tell how far they went."""
    start = None
    for k in range(first + 1, len(keyframes)):
        # nobody knows the way over a break, and many scans tell it over a gap
        is_loose = place_sigma_m(keyframes[k].covariance) > GUESS_M and keyframes[k].goes_on
        if is_loose and start is None:
            start = k
        if not is_loose and start is not None:
            yield start, k - 1
            start = None
    if start is not None:
        yield start, len(keyframes) - 1

"""Scans that tell nothing: how well the wheels tell where these were taken, once it is known where they led.

Between what was seen before and after, a robot was somewhere: wheels that end half a metre off were off
on the way too, by less, and nobody knows where.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from slam.arrays import FloatArray
from slam.frontend.constant_velocity import coasting_covariance
from slam.frontend.keyframes import FrontEndStep, StepStatus
from slam.frontend.told_steps import ToldStep
from slam.frontend.wheel_scale import MEDIAN_NIS
from slam.kernels.normal_equations import inverse_of
from slam.odometry import place_sigma_m
from slam.se2 import SE2

_MOST_M = 0.2
"""Standard deviation of a place. Chosen: 2.5 times as much is what a pose may be off in a map that is
right, so that one of a hundred is off by more."""
_VAGUE_M = 0.1
"""Of a step by wheels, up to which a scan that leaves open how far the robot went is placed by them. Chosen: of
scans of aces, a metre apart, it is 0.06 m."""
_JUMPS = 1
"""Steps that nobody measured, up to which the others say from both sides where the robot was."""
_STANDS, _STANDING = 1e-6, 1e-3
"""[m], [rad]: wheels that tell of less tell of a robot that stands; and what is left of the variance of
such a step: standing before a blocked laser for a minute, nobody goes anywhere. Chosen."""
_EVEN_RAD = 0.1
"""Standard deviation of a turn that goes on as it did. Chosen."""


def unknown_blind_poses(
    steps: Sequence[FrontEndStep],
    first_step: int,
    told: Sequence[ToldStep],
    poses: FloatArray,
    noise: float,
    is_whole: bool = True,
) -> list[str]:
    """In words, that nobody knows where scans were taken that tell nothing, though both ends are known.

    first_step: with which the last session begins; told: the motion by the wheels to each of its scans,
    from the one before, by their scale. poses: (K, 3) of the keyframes [m, rad]. noise: variance of the
    wheels as scans show it, as a multiple of what was told. is_whole: the map holds together; else nobody
    knows yet where what broke off lies.
    """
    worst_m, said = _MOST_M, list[str]()
    for start, end in _blind(steps, first_step, told):
        if steps[end].status is StepStatus.BROKEN and not is_whole:
            continue
        before, after = (steps[at].placed(poses) for at in (start, end))
        T_end = before.inverse() @ after
        way = told[start + 1 - first_step : end + 1 - first_step]
        if sum(one.is_guess for one in way) > _JUMPS:
            way = _even_way(T_end, [step.time_s for step in steps[start : end + 1]])
        else:
            way = [_by_wheels(one, noise) for one in way]
        sigma_m = max(place_sigma_m(one) for one in _known(way, T_end))
        if sigma_m > worst_m:
            worst_m = sigma_m
            said = [
                f"from {steps[start].time_s:.2f} to {steps[end].time_s:.2f} s no scan tells where the robot"
                f" is, and the wheels leave open {sigma_m:.1f} m of where it was between the two"
            ]
    return said


def _blind(
    steps: Sequence[FrontEndStep], first_step: int, told: Sequence[ToldStep]
) -> Iterator[tuple[int, int]]:
    """The steps just before and after each run of those that tell nothing; nor do those that leave open how far
    the robot went, keyframes or not, where wheels that measure it otherwise hardly did."""
    has_wheels = not all(one.is_guess for one in told[1:])
    start: int | None = None
    told_at = first_step
    for at in range(first_step, len(steps)):
        step, way = steps[at], told[at - first_step]
        is_blind = step.status is StepStatus.CARRIED and not step.is_keyframe
        is_loose = has_wheels and step.is_open
        if not is_blind and not (is_loose and place_sigma_m(way.covariance) > _VAGUE_M):
            if start is not None and at > start + 1:
                yield start, at
            start = at
        told_at = told_at if is_blind else at
    # a log may end before a scan tells all of it: nobody knows better than by the last that tells some
    if start is not None and told_at > start + 1:
        yield start, told_at


def _by_wheels(step: ToldStep, noise: float) -> ToldStep:
    if step.is_guess:
        return step
    stands = step.motion.is_near(SE2.identity(), _STANDS, _STANDS)
    return ToldStep(step.motion, (_STANDING if stands else noise) * step.covariance)


def _even_way(T_end: SE2, times_s: Sequence[float]) -> list[ToldStep]:
    """Of a robot that nobody measured, and which goes on as it did: hardly twice as far, or stops."""
    count = len(times_s) - 1
    motion = SE2.exp(T_end.log() / count)
    way_m = math.hypot(motion.x, motion.y)
    return [
        ToldStep(motion, coasting_covariance(way_m, end_s - start_s, _EVEN_RAD**2))
        for start_s, end_s in pairwise(times_s)
    ]


def _known(steps: Sequence[ToldStep], T_end: SE2) -> Iterator[FloatArray]:
    """(3, 3) of the pose after each step but the last, each in its own frame, once it is known where all
    of them led: the smoother of Rauch, Tung and Striebel (1965). By wheels as noisy as that shows: off by
    more than usual, they are noisier than they say."""
    way, on_the_way = ToldStep.none(), list[ToldStep]()
    for step in steps:
        way = way.then(step.motion, step.covariance)
        on_the_way.append(way)
    off = (way.motion.inverse() @ T_end).log()
    information = inverse_of(way.covariance)
    noise = max(1.0, float(off @ information @ off) / MEDIAN_NIS)
    for one in on_the_way[:-1]:
        to_end = (one.motion.inverse() @ way.motion).inverse().adjoint()
        across = one.covariance @ to_end.T
        yield noise * (one.covariance - across @ information @ across.T)

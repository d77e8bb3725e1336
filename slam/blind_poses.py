"""Scans that tell nothing: how well the wheels tell where these were taken, once it is known where they led.

Between what was seen before and after, a robot was somewhere: wheels that end half a metre off were off
on the way too, by less, and nobody knows where.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from slam.arrays import FloatArray
from slam.kernels.normal_equations import inverse_of
from slam.keyframes import FrontEndStep, StepStatus
from slam.odometry import place_sigma_m
from slam.se2 import SE2
from slam.strays import ToldStep
from slam.wheel_scale import WheelScale

_MEDIAN_NIS = 2.37
"""Chi2 with three degrees of freedom: wheels off by more show that they are noisier than they say."""
_MOST_M = 0.2
"""Standard deviation of a place. Chosen: 2.5 times as much is what a pose may be off in a map that is
right, so that one of a hundred is off by more."""


def unknown_blind_poses(
    steps: Sequence[FrontEndStep],
    first_step: int,
    told: Sequence[ToldStep],
    wheel_scale: WheelScale,
    poses: FloatArray,
) -> list[str]:
    """In words, that nobody knows where scans were taken that tell nothing, though both ends are known.

    first_step: with which the last session begins; told: the motion by the wheels to each of its scans,
    from the one before. poses: (K, 3) of the keyframes [m, rad].
    """
    worst_m, said = _MOST_M, list[str]()
    for start, end in _blind(steps, first_step):
        own = [
            ToldStep(wheel_scale.scaled(one.motion), wheel_scale.noise * one.covariance)
            for one in told[start + 1 - first_step : end + 1 - first_step]
        ]
        if any(one.is_guess for one in own):
            continue
        before, after = (_pose(steps[at], poses) for at in (start, end))
        sigma_m = max(place_sigma_m(one) for one in _known(own, before.inverse() @ after))
        if sigma_m > worst_m:
            worst_m = sigma_m
            said = [
                f"from {steps[start].time_s:.2f} to {steps[end].time_s:.2f} s no scan tells where the robot"
                f" is, and the wheels leave open {sigma_m:.1f} m of where it was between the two"
            ]
    return said


def _blind(steps: Sequence[FrontEndStep], first_step: int) -> Iterator[tuple[int, int]]:
    """The steps just before and after each run of those that tell nothing."""
    start: int | None = None
    for at in range(first_step, len(steps)):
        if steps[at].status is not StepStatus.CARRIED or steps[at].is_keyframe:
            if start is not None and at > start + 1:
                yield start, at
            start = at


def _pose(step: FrontEndStep, poses: FloatArray) -> SE2:
    return SE2.from_array(poses[step.keyframe]) @ step.T_keyframe_base


def _known(steps: Sequence[ToldStep], T_end: SE2) -> Iterator[FloatArray]:
    """(3, 3) of the pose after each step but the last, each in its own frame, once it is known where all
    of them led: the smoother of Rauch, Tung and Striebel (1965). By wheels as noisy as that shows."""
    way, on_the_way = ToldStep.none(), list[ToldStep]()
    for step in steps:
        way = way.then(step.motion, step.covariance)
        on_the_way.append(way)
    off = (way.motion.inverse() @ T_end).log()
    information = inverse_of(way.covariance)
    noise = max(1.0, float(off @ information @ off) / _MEDIAN_NIS)
    for one in on_the_way[:-1]:
        to_end = (one.motion.inverse() @ way.motion).inverse().adjoint()
        across = one.covariance @ to_end.T
        yield noise * (one.covariance - across @ information @ across.T)

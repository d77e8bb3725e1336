"""Scans alone that jump, and robots that do."""

from dataclasses import replace

import numpy as np
import pytest

from slam import SE2
from slam.keyframes import FrontEndStep, StepStatus
from slam.scan_jumps import scan_jumps
from slam.strays import ToldStep

COUNT, FIRST, STEP_M, STEP_S = 60, 3, 0.1, 0.3
AT = 40
POSES = np.array([[1.0, 2.0, np.pi / 2.0]])
GUESS, TOLD = np.eye(3) * 100.0, np.eye(3) * 1e-4


def driven(step_m: np.ndarray | None = None) -> list[FrontEndStep]:
    """A session of some scans, and one of many, each a step ahead of the one before; all seen from one
    keyframe."""
    ahead_m = np.cumsum(np.full(COUNT, STEP_M) if step_m is None else step_m)
    before = [step_of(float(k), 10.0 * k, 0) for k in range(FIRST)]
    return before + [step_of(5.0 + STEP_S * k, x, 1) for k, x in enumerate(ahead_m)]


def step_of(time_s: float, x: float, session: int) -> FrontEndStep:
    T = SE2(x, 0.0, 0.0)
    return FrontEndStep(time_s, 0, T, T, StepStatus.MATCHED, 1.0, False, session)


def said_of(steps: list[FrontEndStep], covariance: np.ndarray = GUESS) -> list[str]:
    return scan_jumps(steps, FIRST, [ToldStep(SE2.identity(), covariance)] * COUNT, POSES)


def steps_with(jump_m: float, back_m: float = 0.0) -> np.ndarray:
    step_m = np.full(COUNT, STEP_M)
    step_m[AT] += jump_m
    step_m[AT + 1] += back_m
    return step_m


@pytest.mark.parametrize(("jump_m", "back_m"), [(0.5, -0.5), (-0.5, 0.5), (-0.7, 0.0), (0.5, 0.0)])
def test_scan_that_jumps_fails_the_map(jump_m, back_m):
    (said,) = said_of(driven(steps_with(jump_m, back_m)))
    assert "by scans alone, and neither before nor after" in said
    # there, or back
    assert said.startswith(f"at {5.0 + STEP_S * AT:.2f} s") or back_m
    assert "m in 0.30 s" in said


def test_drive_as_it_is_has_no_jumps():
    assert said_of(driven()) == []
    assert said_of(driven(steps_with(0.15, -0.15))) == []


def test_robot_that_speeds_up_for_a_while_does_not_jump():
    step_m = np.full(COUNT, STEP_M)
    step_m[AT : AT + 3] = 0.4  # 1.3 m/s
    assert said_of(driven(step_m)) == []
    # nor one that mostly stands
    step_m = np.zeros(COUNT)
    step_m[10:34] = 0.5
    assert said_of(driven(step_m)) == []


def test_scans_that_come_rarely_tell_of_long_ways():
    late = [
        replace(one, time_s=one.time_s + (5.0 if at > FIRST + AT - 1 else 0.0))
        for at, one in enumerate(driven(steps_with(0.5)))
    ]
    assert said_of(late) == []
    assert said_of(driven(steps_with(0.5)))


def test_stamps_that_stand_are_no_infinite_speed():
    stamped = driven()
    stamped[FIRST + AT] = replace(stamped[FIRST + AT], time_s=stamped[FIRST + AT - 1].time_s)
    assert said_of(stamped) == []
    assert said_of([replace(one, time_s=7.0) for one in driven()]) == []


def test_wheels_and_breaks_are_asked_elsewhere():
    jumped = driven(steps_with(0.5, -0.5))
    assert said_of(jumped, TOLD) == []
    jumped[FIRST + AT] = replace(jumped[FIRST + AT], status=StepStatus.BROKEN)
    assert said_of(jumped) == []
    assert said_of(driven()[: FIRST + 2]) == []

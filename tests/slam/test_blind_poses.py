"""Where scans were taken that tell nothing, the wheels have to tell."""

from dataclasses import replace

import numpy as np
import pytest

from slam import SE2
from slam.blind_poses import unknown_blind_poses
from slam.keyframes import FrontEndStep, StepStatus
from slam.strays import ToldStep
from slam.wheel_scale import WheelScale

BLIND, STEP = 16, SE2(0.3, 0.0, 0.0)
FIRST = 2
"""Scans of a session before."""
POSES = np.array([[5.0, 5.0, 0.0], [0.0, 0.0, 0.0], [STEP.x * BLIND, 0.0, 0.0]])


def steps_of(seen: StepStatus = StepStatus.BROKEN) -> list[FrontEndStep]:
    """A session before, and one: seen, blind all along but for the last scan."""
    T = SE2.identity()
    before = [FrontEndStep(float(k), 0, T, T, StepStatus.CARRIED, 0.0, False) for k in range(FIRST)]
    first = FrontEndStep(2.0, 1, T, T, StepStatus.MATCHED, 1.0, True, session=1)
    blind = [
        FrontEndStep(3.0 + k, 1, T, T, StepStatus.CARRIED, 0.0, False, session=1)
        for k in range(BLIND - 1)
    ]
    last = FrontEndStep(3.0 + BLIND, 2, T, T, seen, 1.0, True, session=1)
    return [*before, first, *blind, last]


def told_by(sigma_m: float, step: SE2 = STEP, sigma_rad: float = 1e-6) -> list[ToldStep]:
    covariance = np.diag(np.square([sigma_m, sigma_m, sigma_rad]))
    return [ToldStep(step, covariance)] * (BLIND + 1)


def said_of(
    told: list[ToldStep], steps: list[FrontEndStep] | None = None, poses: np.ndarray = POSES
) -> list[str]:
    return unknown_blind_poses(steps or steps_of(), FIRST, told, WheelScale(), poses)


@pytest.mark.parametrize(("middle_m", "is_known"), [(0.19, True), (0.21, False)])
def test_middle_of_a_blind_way_is_known_as_well_as_a_bridge_is(middle_m, is_known):
    # Brownian bridge: a quarter of the variance of the end is left in the middle
    sigma_m = 2.0 * middle_m / np.sqrt(BLIND)
    said = said_of(told_by(sigma_m))
    assert (said == []) is is_known
    if not is_known:
        assert said[0].startswith("from 2.00 to 19.00 s no scan tells where the robot is")
        assert "leave open 0.2 m of where" in said[0]


def test_heading_that_is_unsure_is_a_way_aside_that_is():
    # of an integrated bridge, held at both ends, 1/192 of T^3 is left: sigma 0.25 m
    way_m, middle_m = STEP.x * BLIND, 0.25
    sigma_rad = middle_m * np.sqrt(192.0 / BLIND) / way_m
    assert said_of(told_by(1e-6, sigma_rad=sigma_rad))
    assert said_of(told_by(1e-6, sigma_rad=0.5 * sigma_rad)) == []


def test_wheels_that_end_elsewhere_are_noisier_than_they_say():
    assert said_of(told_by(0.05)) == []
    moved = POSES + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert said_of(told_by(0.05), poses=moved)


def test_only_scans_that_tell_nothing_of_this_session_are_asked():
    told = told_by(0.25)
    assert said_of(told)
    seen = [
        replace(one, status=StepStatus.MATCHED if at % 2 else one.status)
        for at, one in enumerate(steps_of())
    ]
    assert said_of(told, seen) == []
    # where nothing measured the way there is another matter
    assert said_of([replace(one, covariance=100.0 * np.eye(3)) for one in told]) == []
    # nor is a way known without its end
    assert said_of(told, steps_of()[:-1]) == []


def test_wheels_are_taken_by_their_scale():
    wheels = WheelScale()
    wheels.scale = 0.5
    steps, told = steps_of(), told_by(0.05, step=SE2(2.0 * STEP.x, 0.0, 0.0))
    assert unknown_blind_poses(steps, FIRST, told, wheels, POSES) == []
    assert said_of(told)

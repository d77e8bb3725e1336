"""Odometry that a localizer puts right now and then: it jumps where nobody sees it, too."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from slam import SE2
from slam.frontend.keyframes import Keyframe
from slam.frontend.told_steps import ToldStep
from slam.map_checks.shown_jumps import shown_jumps
from tests.slam.map_checks.test_wheels_borne_out import BY_WHEELS, STEP, drive, told


def said(keyframes: Sequence[Keyframe], steps: Sequence[ToldStep]) -> list[str]:
    poses = np.array([keyframe.T_map_base.as_array() for keyframe in keyframes])
    return shown_jumps(keyframes, poses, steps)


def jumping(ks: Sequence[int], by_m: float) -> list[ToldStep]:
    """By the wheels, some steps of which lead aside."""
    steps = told()
    for k in ks:
        steps[k] = replace(steps[k], motion=STEP @ SE2(0.0, by_m, 0.0))
    return steps


SEEN = (3, 7, 11, 24, 28, 32, 36)


@pytest.mark.parametrize(
    ("ks", "by_m", "is_objected"),
    [
        (SEEN, 0.5, True),
        (SEEN, 0.18, False),  # wheels that slip a little, though they were said to be better
        (SEEN[:5], 0.5, False),  # a few of a whole drive
        ((16, 17, 18, 19), 0.5, False),  # where scans tell nothing, nobody knows
    ],
)
def test_odometry_that_jumps_where_scans_see_is_not_believed_where_they_do_not(
    ks, by_m, is_objected
):
    reasons = said(drive()[0], jumping(ks, by_m))
    assert len(reasons) == is_objected
    if is_objected:
        assert "at 7 of 35 scans" in reasons[0]


def test_odometry_that_is_known_to_be_noisy_does_not_jump():
    noisy = [replace(step, covariance=100.0 * BY_WHEELS) for step in jumping(SEEN, 0.5)]
    assert said(drive()[0], noisy) == []


def test_nobody_jumps_where_there_is_no_odometry():
    assert said(drive()[0], [ToldStep(SE2.identity(), 1e4 * np.eye(3))] * len(told())) == []

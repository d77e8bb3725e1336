"""Odometry that jumps is doubted for as far as it jumped; robots that speed up or turn back are not."""

from __future__ import annotations

import numpy as np
import pytest

from slam import SE2, LaserScan, Measurement
from slam.odometry_jumps import OdometryJumps

SCAN = LaserScan(0.0, np.radians([-1.0, 0.0, 1.0]), np.ones(3))
STEP = SE2(0.2, 0.0, 0.02)


def judged_each(motions: list[SE2], elapsed_s: float = 0.5) -> list[Measurement]:
    """Of each motion, once it was judged; told as 1 cm."""
    jumps, told = OdometryJumps(), np.diag([0.01**2] * 3)
    return [
        jumps.doubted(Measurement(elapsed_s * k, motion, SCAN, told))
        for k, motion in enumerate(motions)
    ]


def sigmas_m(motions: list[SE2], elapsed_s: float = 0.5) -> list[float]:
    """Of each motion along its way, once it was judged."""
    judged = judged_each(motions, elapsed_s)
    return [float(np.sqrt(one.motion_covariance[0, 0])) for one in judged]


@pytest.mark.parametrize("jump", [SE2(2.2, 0.0, 0.0), SE2(0.2, -1.5, 0.0), SE2(-0.8, 0.1, 0.0)])
def test_way_much_faster_than_before_or_back_is_as_unsure_as_it_is_long(jump):
    sigma_m = sigmas_m([STEP] * 20 + [jump] + [STEP] * 5)
    assert sigma_m[20] == pytest.approx(np.hypot(jump.x, jump.y), rel=0.01)
    assert sigma_m[:20] + sigma_m[21:] == pytest.approx([0.01] * 25)


@pytest.mark.parametrize("jump", [SE2(2.2, 0.0, 0.3), SE2(-0.8, 0.1, -0.1)])
def test_where_odometry_jumps_the_robot_goes_on_as_it_did_and_turns_as_told(jump):
    judged = judged_each([STEP] * 20 + [jump, STEP])
    expected = SE2(STEP.x, STEP.y, jump.theta)
    assert judged[20].motion.is_near(expected, 1e-12, 1e-12)
    assert [one.motion for one in (*judged[:20], judged[21])] == [STEP] * 21


def test_how_a_robot_drives_is_known_after_a_few_steps():
    # a corridor with a scan each 0.7 m, back by 1.7 m at the seventh
    assert sigmas_m([SE2(0.7, 0.0, 0.0)] * 6 + [SE2(-1.7, 0.3, 0.0)], 2.0)[-1] > 1.7


@pytest.mark.parametrize(
    "motions",
    [
        # how it drives is not known yet
        [STEP] * 4 + [SE2(2.0, 0.0, 0.0)],
        # slips of wheels, which scans bear
        [STEP] * 20 + [SE2(0.45, 0.0, 0.0), SE2(-0.25, 0.0, 0.0)],
        # twice as fast as ever
        [STEP] * 15 + [SE2(0.39, 0.0, 0.0)] * 5 + [SE2(0.7, 0.0, 0.0)],
        # it has gone backwards before
        [STEP] * 15 + [SE2(-0.2, 0.0, 0.0), STEP, SE2(-0.39, 0.0, 0.0)],
        # it stood
        [STEP] * 15 + [SE2.identity()] * 20,
    ],
)
def test_robot_that_drives_as_robots_do_is_believed(motions):
    assert sigmas_m(motions) == pytest.approx([0.01] * len(motions))


def test_what_lasts_is_how_the_robot_drives_now():
    sigma_m = sigmas_m([STEP] * 20 + [SE2(1.0, 0.0, 0.0)] * 10)
    assert [one > 0.5 for one in sigma_m[20:]] == [True] * 2 + [False] * 8


def test_stamps_that_stand_or_go_back_tell_no_speed():
    assert sigmas_m([STEP] * 20 + [SE2(2.0, 0.0, 0.0)], elapsed_s=0.0)[-1] == pytest.approx(0.01)

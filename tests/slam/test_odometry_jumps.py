"""Odometry that jumps is doubted for as far as it jumped; robots that speed up or turn back are not."""

from __future__ import annotations

import numpy as np
import pytest

from slam import SE2, LaserScan, Measurement
from slam.odometry_jumps import JudgedMotion, OdometryJumps

SCAN = LaserScan(0.0, np.radians([-1.0, 0.0, 1.0]), np.ones(3))
STEP = SE2(0.2, 0.0, 0.02)


def judged_each(
    motions: list[SE2], elapsed_s: float | list[float] = 0.5, is_blind: bool = False
) -> list[JudgedMotion]:
    """Of each motion, once it was judged; told as 1 cm. elapsed_s: before each."""
    jumps, told = OdometryJumps(), np.diag([0.01**2] * 3)
    times_s = np.cumsum(np.broadcast_to(elapsed_s, len(motions)))
    return [
        jumps.judged(Measurement(float(time_s), motion, SCAN, told), is_blind)
        for time_s, motion in zip(times_s, motions, strict=True)
    ]


def sigmas_m(
    motions: list[SE2], elapsed_s: float | list[float] = 0.5, is_blind: bool = False
) -> list[float]:
    """Of each motion along its way, once it was judged."""
    judged = judged_each(motions, elapsed_s, is_blind)
    return [float(np.sqrt(one.measurement.motion_covariance[0, 0])) for one in judged]


@pytest.mark.parametrize("jump", [SE2(2.2, 0.0, 0.0), SE2(0.2, -1.5, 0.0), SE2(-0.8, 0.1, 0.0)])
def test_way_much_faster_than_before_or_back_is_as_unsure_as_it_is_far_from_the_usual(jump):
    sigma_m = sigmas_m([STEP] * 20 + [jump] + [STEP] * 5)
    assert sigma_m[20] == pytest.approx(np.hypot(jump.x - STEP.x, jump.y), rel=0.01)
    assert sigma_m[:20] + sigma_m[21:] == pytest.approx([0.01] * 25)


def test_where_odometry_tells_of_far_more_the_robot_goes_on_as_it_did_and_turns_as_told():
    jump = SE2(2.2, 0.0, 0.3)
    judged = judged_each([STEP] * 20 + [jump, STEP])
    assert judged[20].measurement.motion.is_near(SE2(STEP.x, STEP.y, 0.3), 1e-12, 1e-12)
    assert judged[20].other == jump
    assert [one.has_jumped for one in judged] == [False] * 20 + [True, False]
    assert [one.other for one in (*judged[:20], judged[21])] == [None] * 21


def test_a_way_back_for_the_first_time_is_believed_and_doubted():
    # in a corridor nothing told that a robot which backed up had not driven on
    back = SE2(-0.7, 0.0, 0.0)
    judged = judged_each([SE2(0.7, 0.0, 0.0)] * 10 + [back], 2.0)
    assert judged[-1].measurement.motion == back
    assert judged[-1].other is not None
    assert judged[-1].other.is_near(SE2(0.7, 0.0, 0.0), 1e-9, 1e-9)


@pytest.mark.parametrize(
    "turned_round",
    [
        SE2(0.0, 0.0, -2.35) @ SE2(3.5, 0.0, 0.0),  # and drove on
        SE2(3.5, 0.0, 0.0) @ SE2(0.0, 0.0, 2.35),
        SE2(1.0, 0.0, 0.0) @ SE2(0.0, 0.0, 2.8) @ SE2(3.0, 0.0, 0.0),
    ],
)
def test_a_robot_that_turned_round_between_two_scans_has_not_gone_back(turned_round):
    """aces, every third scan lost: seen from before it was led 2.5 m back, and nothing of it believed."""
    sigma_m = sigmas_m([SE2(0.7, 0.0, 0.0)] * 20 + [turned_round], [1.0] * 20 + [20.0])
    assert sigma_m == pytest.approx([0.01] * 21)


@pytest.mark.parametrize(
    ("after", "has_jumped"),
    [
        ([SE2(-0.7, 0.0, 0.0)] * 4, False),  # it backs up
        ([SE2.identity(), SE2(-0.4, 0.0, 0.1)], False),
        ([SE2(0.7, 0.0, 0.0)] * 4, True),
        ([SE2.identity(), SE2(0.7, 0.0, 0.0)], True),
    ],
)
def test_who_goes_on_backwards_has_backed_up_and_odometry_not_jumped(after, has_jumped):
    judged = judged_each([SE2(0.7, 0.0, 0.0)] * 10 + [SE2(-0.7, 0.0, 0.0), *after], 2.0)
    assert any(one.has_jumped for one in judged) is has_jumped
    assert not judged[10].has_jumped


def test_a_robot_that_backed_off_its_dock_has_not_gone_back():
    assert sigmas_m([SE2(-0.05, 0.0, 0.0)] + [STEP] * 10 + [SE2(-1.2, 0.0, 0.0)])[-1] > 1.0


def test_after_a_pause_nobody_goes_on_for_as_long():
    motions = [STEP] * 10 + [SE2(45.0, 0.0, 0.0)]
    judged = judged_each(motions, [0.5] * 10 + [20.0])
    assert judged[-1].measurement.motion.x == pytest.approx(2.0 * STEP.x)


def test_one_jump_that_nobody_noticed_hides_no_other():
    motions = [STEP, SE2(3.0, 0.0, 0.0)] + [STEP] * 20 + [SE2(1.5, 0.0, 0.0)]
    assert sigmas_m(motions)[-1] > 1.0


@pytest.mark.parametrize(
    ("motions", "time_s"),
    [
        ([STEP, SE2(3.0, 0.0, 0.0)] + [STEP] * 8, 1.0),
        ([STEP] * 4 + [SE2(-1.0, 0.0, 0.0)] + [STEP] * 8, 2.5),
        ([STEP, SE2(3.0, 0.0, 0.0)] + [STEP] * 2, None),  # how it drives is not known yet
        ([STEP, SE2(0.35, 0.0, 0.0)] + [STEP] * 8, None),
        ([SE2(-0.4, 0.0, 0.0)] * 3 + [STEP] * 8, None),  # it backs off
    ],
)
def test_a_jump_at_the_very_beginning_is_known_later(motions, time_s):
    jumps = OdometryJumps()
    for k, motion in enumerate(motions):
        jumps.judged(Measurement(0.5 * (k + 1), motion, SCAN, np.eye(3)))
    assert jumps.begun_with_s == time_s


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
        [STEP] * 15 + [SE2(-0.2, 0.0, 0.0)] * 2 + [STEP, SE2(-0.39, 0.0, 0.0)],
        # it stood
        [STEP] * 15 + [SE2.identity()] * 20,
    ],
)
def test_robot_that_drives_as_robots_do_is_believed(motions):
    assert sigmas_m(motions) == pytest.approx([0.01] * len(motions))


def test_what_lasts_is_how_the_robot_drives_now():
    sigma_m = sigmas_m([STEP] * 20 + [SE2(1.0, 0.0, 0.0)] * 10)
    assert [one > 0.5 for one in sigma_m[20:]] == [True] * 2 + [False] * 8


def test_where_stamps_stand_as_much_time_has_passed_as_before():
    # ten equal stamps, a jump among them
    motions, elapsed_s = [STEP] * 20 + [SE2(2.0, 0.0, 0.0)], [0.5] * 15 + [0.0] * 6
    assert sigmas_m(motions, elapsed_s)[-1] > 1.7
    assert sigmas_m(motions[:-1], elapsed_s[:-1]) == pytest.approx([0.01] * 20)


def test_stamps_that_never_move_tell_no_speed():
    assert sigmas_m([STEP] * 20 + [SE2(2.0, 0.0, 0.0)], elapsed_s=0.0)[-1] == pytest.approx(0.01)


@pytest.mark.parametrize("silent", [1, 3, 6])
def test_late_odometry_that_makes_up_for_its_silence_has_not_jumped(silent):
    """As of mit-csail: three records tell of nothing, the fourth of all four."""
    made_up = SE2(0.2 * (silent + 1), 0.01, 0.05)
    motions = [STEP] * 10 + [SE2.identity()] * silent + [made_up, STEP]
    assert sigmas_m(motions, is_blind=True) == pytest.approx([0.01] * len(motions))
    judged = judged_each(motions, is_blind=True)
    assert judged[10 + silent].measurement.motion == made_up
    # but may have, and between walls that look the same nobody would know
    assert [one.has_jumped for one in judged] == [k == 10 + silent for k in range(12 + silent)]
    # what is far more than it makes up for is a jump still
    jump = SE2(made_up.x + 1.5, 0.0, 0.0)
    assert sigmas_m([*motions[: 10 + silent], jump], is_blind=True)[-1] > 1.0
    # and of what scans have shown already it tells once more
    if silent > 1:
        assert sigmas_m(motions)[10 + silent] > 0.3


def test_a_robot_that_has_stood_for_long_makes_up_for_nothing():
    motions = [STEP] * 10 + [SE2.identity()] * 8 + [SE2(1.8, 0.0, 0.0)]
    assert sigmas_m(motions, is_blind=True)[-1] > 1.0


def test_late_odometry_makes_up_for_its_silence_by_the_usual_speed():
    assert STEP.x < 0.25  # the last steps count, not those before
    motions_before = [SE2(0.5, 0.0, 0.0)] * 10
    hiccup = [SE2(0.05, 0.0, 0.0), SE2(0.3, 0.0, 0.0), SE2(0.09, 0.0, 0.0)]
    motions = motions_before + [STEP] * 5 + hiccup + [SE2.identity()] * 4 + [SE2(1.0, 0.0, 0.0)]
    assert sigmas_m(motions, is_blind=True)[-1] == pytest.approx(0.01)

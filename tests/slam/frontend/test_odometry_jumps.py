"""Odometry that jumps is doubted for as far as it jumped; robots that speed up or turn back are not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slam import SE2, LaserScan, Measurement
from slam.frontend.odometry_jumps import JudgedMotion, OdometryJumps

SCAN = LaserScan(0.0, np.radians([-1.0, 0.0, 1.0]), np.ones(3))
STEP = SE2(0.2, 0.0, 0.02)
LONG = SE2(0.7, 0.0, 0.0)


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


def jumps_of(motions: list[SE2], elapsed_s: float | list[float]) -> list[int]:
    """Which are known to be jumps."""
    judged = judged_each(motions, elapsed_s)
    return [k for k, one in enumerate(judged) if one.has_jumped]


def begun_with_s(motions: list[SE2], elapsed_s: float | list[float] = 0.5) -> float | None:
    jumps = OdometryJumps()
    times_s = np.cumsum(np.broadcast_to(elapsed_s, len(motions)))
    for time_s, motion in zip(times_s, motions, strict=True):
        jumps.judged(Measurement(float(time_s), motion, SCAN, np.eye(3)))
    return jumps.begun_with_s


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


@pytest.mark.parametrize(
    ("longest_m", "is_doubted"), [(0.25, False), (1.0, True), (math.inf, True)]
)
@pytest.mark.parametrize("long", [SE2(2.2, 0.0, 0.0), SE2(-0.8, 0.1, 0.0)])
def test_way_that_many_records_told_of_is_none_that_odometry_jumped(long, longest_m, is_doubted):
    """Every second scan of aces lost: 4.4 m in 10 s, told in 60 records, were believed to be 0.4 m."""
    jumps, told = OdometryJumps(), np.diag([0.01**2] * 3)
    for k in range(20):
        jumps.judged(Measurement(0.5 * k, STEP, SCAN, told))
    judged = jumps.judged(Measurement(10.0, long, SCAN, told, longest_m))
    assert (judged.other is not None) is is_doubted


def test_where_odometry_tells_of_far_more_the_robot_goes_on_as_it_did_and_turns_as_told():
    jump = SE2(2.2, 0.0, 0.3)
    judged = judged_each([STEP] * 20 + [jump, STEP])
    assert judged[20].measurement.motion.is_near(SE2(STEP.x, STEP.y, 0.3), 1e-12, 1e-12)
    assert judged[20].other == jump
    assert [one.has_jumped for one in judged] == [False] * 20 + [True, False]
    assert [one.other for one in (*judged[:20], judged[21])] == [None] * 21


def test_a_jump_is_as_unsure_as_told_and_by_how_far_it_may_have_led():
    (*_, judged) = judged_each([STEP] * 20 + [SE2(2.2, 0.0, 0.3)])
    variance = [0.01**2 + 2.0**2, 0.01**2 + 2.0**2, 0.01**2 + 0.3**2]
    assert np.diag(judged.measurement.motion_covariance) == pytest.approx(variance, rel=1e-6)


def test_each_of_many_jumps_is_told():
    motions = ([LONG] * 6 + [SE2(5.0, 0.0, 0.0)]) * 5
    assert jumps_of(motions, 1.0) == [6, 13, 20, 27, 34]


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
        SE2(0.0, 0.0, -2.0) @ SE2(3.5, 0.0, 0.0),
        SE2(0.0, 0.0, np.pi) @ SE2(4.0, 0.0, 0.0) @ SE2(0.0, 0.0, -0.64),
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
        ([SE2(0.0, 0.0, np.pi) @ SE2(0.7, 0.0, 0.0)], True),  # it turns round, and drives on
        ([SE2(0.0, 0.0, 0.5) @ SE2(-0.7, 0.0, 0.0)], False),  # it turns, and backs on
    ],
)
def test_who_goes_on_backwards_has_backed_up_and_odometry_not_jumped(after, has_jumped):
    judged = judged_each([SE2(0.7, 0.0, 0.0)] * 10 + [SE2(-0.7, 0.0, 0.0), *after], 2.0)
    assert any(one.has_jumped for one in judged) is has_jumped
    assert not judged[10].has_jumped


def test_who_was_not_believed_to_go_back_has_not_jumped_once_more_as_it_drives_on():
    motions = [STEP] * 10 + [SE2(-2.5, 0.0, 0.0), STEP]
    assert jumps_of(motions, 0.5) == [10]


def test_a_robot_that_backed_off_its_dock_has_not_gone_back():
    # one such step might have been a jump that nobody noticed
    assert sigmas_m([SE2(-0.05, 0.0, 0.0)] * 3 + [STEP] * 10 + [SE2(-0.35, 0.0, 0.0)])[-1] > 0.5


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
        ([SE2.identity()] * 3, None),
        ([SE2(-0.4, 0.0, 0.0)] * 3 + [STEP] * 8, None),  # it backs off
        ([STEP, SE2(0.8, 0.0, 0.0)] + [STEP] * 9 + [SE2(0.6, 0.0, 0.0)] * 20, 1.0),
    ],
)
def test_a_jump_at_the_very_beginning_is_known_later(motions, time_s):
    assert begun_with_s(motions) == time_s


def test_how_a_robot_drives_is_known_after_a_few_steps():
    # a corridor with a scan each 0.7 m, back by 1.7 m at the seventh
    assert sigmas_m([SE2(0.7, 0.0, 0.0)] * 6 + [SE2(-1.7, 0.3, 0.0)], 2.0)[-1] > 1.7


@pytest.mark.parametrize(
    "motions",
    [
        # how it drives is not known yet
        [STEP] * 4 + [SE2(2.0, 0.0, 0.0)],
        [SE2(0.01, 0.0, 0.0)] * 20 + [SE2(0.6, 0.0, 0.0)],
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


def test_how_it_drove_long_ago_does_not_tell():
    motions = [LONG] * 20 + [STEP] * 60 + [SE2(0.6, 0.0, 0.0)]
    assert jumps_of(motions, 0.5) == [80]
    # nor how often records came
    motions = [LONG] * 100 + [SE2(0.07, 0.0, 0.0)] * 60 + [SE2(0.6, 0.0, 0.0)]
    assert jumps_of(motions, [0.5] * 100 + [0.05] * 61) == [160]


def test_records_that_come_early_tell_how_fast_the_robot_is():
    motions = [SE2(0.42, 0.0, 0.0), SE2(0.28, 0.0, 0.0)] * 10
    motions[-1] = SE2(0.7, 0.0, 0.0)
    assert jumps_of(motions, [0.6, 0.4] * 10) == [19]


def test_where_stamps_stand_as_much_time_has_passed_as_before():
    # ten equal stamps, a jump among them
    motions, elapsed_s = [STEP] * 20 + [SE2(2.0, 0.0, 0.0)], [0.5] * 15 + [0.0] * 6
    assert sigmas_m(motions, elapsed_s)[-1] > 1.7
    assert sigmas_m(motions[:-1], elapsed_s[:-1]) == pytest.approx([0.01] * 20)


def test_a_step_whose_stamp_stands_does_not_tell_how_fast_the_robot_is():
    motions = [LONG] * 10 + [SE2(1.3, 0.0, 0.0)] * 2 + [SE2(2.0, 0.0, 0.0)]
    assert jumps_of(motions, [0.5] * 10 + [0.0] * 2 + [0.5]) == [12]


def test_stamps_that_come_close_tell_no_speed():
    """Steps of 0.7 m, one 1 ms after the one before: it was believed to be 1.4 mm."""
    elapsed_s = [0.5] * 12 + [1e-3, 0.999] + [0.5] * 6
    assert sigmas_m([LONG] * 20, elapsed_s) == pytest.approx([0.01] * 20)
    # nor do two of them hide a jump
    elapsed_s = [0.5] * 8 + [1e-3, 0.999] * 2 + [0.5] * 9
    assert jumps_of([LONG] * 20 + [SE2(9.0, 0.0, 0.0)], elapsed_s) == [20]


@pytest.mark.parametrize("at_once", [2, 3, 4])
@pytest.mark.parametrize("jump_at", [30, 31])
def test_records_that_come_some_at_once_show_jumps_and_none_where_there_are_none(at_once, jump_at):
    elapsed_s = ([1e-3] * (at_once - 1) + [0.5 * at_once]) * 20
    motions = [LONG] * jump_at + [SE2(9.0, 0.0, 0.0)] + [LONG] * 8
    assert jumps_of(motions, elapsed_s[: len(motions)]) == [jump_at]


@pytest.mark.parametrize("close_at", [1, 2, 4])
def test_a_close_stamp_at_the_very_beginning_is_no_jump(close_at):
    elapsed_s = [0.5] * 12
    elapsed_s[close_at : close_at + 2] = [1e-3, 0.999]
    assert begun_with_s([LONG] * 12, elapsed_s) is None


def test_after_a_close_stamp_nobody_goes_on_faster():
    """A robot that stands, and whose odometry jumps by 3 m, was believed to be hundreds of metres off."""
    motions = [STEP] * 21 + [SE2.identity()] * 2 + [SE2(3.0, 0.0, 0.0)]
    judged = judged_each(motions, [0.5] * 20 + [1e-4, 0.5, 0.5, 0.5])
    assert judged[-1].measurement.motion.is_near(SE2(STEP.x, 0.0, 0.0), 1e-9, 1e-9)


@pytest.mark.parametrize(("standing", "believed_m"), [(5, STEP.x), (20, 0.0)])
def test_a_robot_that_has_stood_does_not_go_on(standing, believed_m):
    motions = [STEP] * 20 + [SE2.identity()] * standing + [SE2(3.0, 0.0, 0.0)]
    (*_, judged) = judged_each(motions)
    assert judged.has_jumped
    assert judged.measurement.motion.x == pytest.approx(believed_m)


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
    # or the same way in another direction, or half as much again
    if silent > 1:
        for other in (SE2(0.0, made_up.x, 0.0), SE2(1.6 * made_up.x, 0.0, 0.0)):
            assert sigmas_m([*motions[: 10 + silent], other], is_blind=True)[-1] > 0.5
    # and of what scans have shown already it tells once more
    if silent > 1:
        assert sigmas_m(motions)[10 + silent] > 0.3


@pytest.mark.parametrize(("turn_rad", "is_silent"), [(0.3, False), (-0.3, False), (0.01, True)])
def test_a_robot_that_turned_on_the_spot_makes_up_for_nothing_as_it_drives_on(turn_rad, is_silent):
    # among trees and houses it was said that odometry jumped, and the map failed: it had turned once, unseen
    motions = [STEP] * 10 + [SE2(0.0, 0.0, turn_rad), STEP]
    # scans are as far apart as the ways between are long
    judged = judged_each(motions, [0.5] * 10 + [0.05, 0.5], is_blind=True)
    assert [one.has_jumped for one in judged] == [False] * 11 + [is_silent]
    assert judged[-1].measurement.motion == STEP


def test_a_robot_that_turns_on_the_spot_for_long_does_not_drive_on():
    turn = SE2(0.0, 0.0, 0.3)
    for count, x in ((4, STEP.x), (12, 0.0)):
        motions = [STEP] * 10 + [turn] * count + [SE2(3.0, 0.0, 0.0)]
        assert judged_each(motions)[-1].measurement.motion.x == pytest.approx(x)


def test_a_robot_that_has_stood_for_long_makes_up_for_nothing():
    motions = [STEP] * 10 + [SE2.identity()] * 8 + [SE2(1.8, 0.0, 0.0)]
    assert sigmas_m(motions, is_blind=True)[-1] > 1.0


def test_late_odometry_is_no_jump_while_nobody_knows_how_the_robot_drives():
    motions = [STEP] * 4 + [SE2.identity()] * 3 + [SE2(4.0 * STEP.x, 0.0, 0.0)]
    assert not any(one.has_jumped for one in judged_each(motions, is_blind=True))


def test_late_odometry_makes_up_for_its_silence_by_the_usual_speed():
    assert STEP.x < 0.25  # the last steps count, not those before
    motions_before = [SE2(0.45, 0.0, 0.0)] * 10
    hiccup = [SE2(0.05, 0.0, 0.0), SE2(0.3, 0.0, 0.0), SE2(0.09, 0.0, 0.0)]
    motions = motions_before + [STEP] * 5 + hiccup + [SE2.identity()] * 4 + [SE2(1.0, 0.0, 0.0)]
    assert sigmas_m(motions, is_blind=True)[-1] == pytest.approx(0.01)

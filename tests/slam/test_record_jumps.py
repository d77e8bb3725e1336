"""Odometry that jumps between two records: no robot went there, and it goes on as it did."""

import math

import numpy as np
import pytest

from slam.readers.log import MotionSinceScan
from slam.readers.log_odometry import USUAL_NOISE
from slam.readers.log_record import LogRecord
from slam.readers.record_jumps import RecordJumps
from slam.se2 import SE2

STEP, STILL = SE2(0.08, 0.0, 0.01), SE2.identity()
RIGHT_ANGLE = SE2(0.0, 0.0, math.pi / 2.0)
INTERVAL_S = 0.2


def believed(told: list[SE2], interval_s: float = INTERVAL_S) -> list[tuple[SE2, bool]]:
    """What is believed of motions told at even times, and whether more is said to be unsure."""
    jumps = RecordJumps()
    pairs = [jumps.believed(interval_s * k, motion) for k, motion in enumerate(told)]
    return [(motion, more is not None) for motion, more in pairs]


@pytest.mark.parametrize("jump", [RIGHT_ANGLE, SE2(-7.0, 2.0, 0.3)])
@pytest.mark.parametrize("before", [STEP, STILL])
def test_robot_goes_on_as_it_did_where_odometry_jumps(before, jump):
    drive = [STEP] * 30 + [before] * 12
    found = believed([*drive, before @ jump, STEP])
    assert found[-2] == (before, True)
    assert found[-1] == (STEP, False)


def test_heading_that_jumped_alone_leads_no_robot_aside():
    c, s = math.cos(-math.pi / 2.0), math.sin(-math.pi / 2.0)
    aside = SE2(c * STEP.x - s * STEP.y, s * STEP.x + c * STEP.y, STEP.theta)
    jump = SE2(aside.x, aside.y, STEP.theta + math.pi / 2.0)
    found = believed([STEP] * 30 + [jump] + [aside] * 5)
    for motion, _ in found[30:]:
        np.testing.assert_allclose(motion.as_array(), STEP.as_array(), atol=1e-12)
    # and where all jumped the robot drives ahead as before, in a curve that leads it aside as well
    curve = SE2(0.05, 0.06, 0.5)
    turned = believed([STEP] * 30 + [STEP @ RIGHT_ANGLE] + [STEP] * 5 + [curve])
    assert turned[-1] == (curve, False)


def test_robot_that_drives_aside_did_so_before_it_jumped():
    # fr101 with its base turned by 90 degrees, odometry that jumped by as much: 2.4 m off, and failed
    aside = SE2(0.0, 0.08, 0.01)
    assert (
        believed([aside] * 30 + [aside @ RIGHT_ANGLE] + [aside] * 20)[31:] == [(aside, False)] * 20
    )
    # nor does one that drives ahead after it jumped, and aside later
    drive = [STEP] * 30 + [STEP @ RIGHT_ANGLE] + [STEP] * 20 + [aside] * 60
    assert believed(drive)[-60:] == [(aside, False)] * 60


def test_heading_may_jump_alone_after_all_has_jumped():
    c, s = math.cos(-math.pi / 2.0), math.sin(-math.pi / 2.0)
    aside = SE2(c * STEP.x - s * STEP.y, s * STEP.x + c * STEP.y, STEP.theta)
    jump = SE2(aside.x, aside.y, STEP.theta + math.pi / 2.0)
    found = believed([STEP] * 30 + [STEP @ RIGHT_ANGLE] + [STEP] * 30 + [jump] + [aside] * 5)
    for motion, _ in found[30:]:
        np.testing.assert_allclose(motion.as_array(), STEP.as_array(), atol=1e-12)


def test_stall_of_half_a_second_at_50_hz_is_no_jump():
    step, late = SE2(0.03, 0.0, 0.0), SE2(0.78, 0.0, 0.0)
    drive = [step] * 60 + [STILL] * 25 + [late] + [step] * 5
    assert not any(has_jumped for _, has_jumped in believed(drive, interval_s=0.02))


def test_records_that_come_at_once_with_others_are_as_fast_as_all_of_them():
    jumps, turn = (
        RecordJumps(),
        SE2(0.0, 0.0, 0.75),
    )  # 3 rad/s, told each quarter of a second, two at once
    for k in range(60):
        assert jumps.believed(0.5 * (k // 2) + 0.001 * (k % 2), turn) == (turn, None)


def test_what_was_kept_back_for_a_moment_is_no_jump():
    late = SE2(0.47, 0.0, 1.49)  # as mit-csail tells it, after four records of nothing
    drive = [SE2(0.1, 0.0, 0.3)] * 30
    assert believed(drive + [STILL] * 4 + [late])[-1] == (late, False)
    assert believed(drive + [STILL] * 40 + [late])[-1] == (STILL, True)
    # nor does a robot that never turned as fast do so unseen
    assert believed([STEP] * 30 + [STILL] * 4 + [late])[-1] == (STILL, True)


def test_fast_robots_and_slow_logs_do_not_jump():
    fast = SE2(2.0, 0.0, 0.02)  # 10 m/s, from the first record on
    assert believed([fast] * 60) == [(fast, False)] * 60
    assert believed([fast] * 30 + [SE2(4.0, 0.0, 0.04), fast])[30:] == [
        (SE2(4.0, 0.0, 0.04), False),  # over a record that is missing
        (fast, False),
    ]
    turn = SE2(0.0, 0.0, math.pi / 2.0)
    assert believed([STEP] * 30 + [turn], interval_s=1.0)[-1] == (turn, False)


def test_stamps_that_stand_make_no_jump_of_a_step():
    jumps = RecordJumps()
    for k in range(60):
        assert jumps.believed(float(k // 6), STEP) == (STEP, None)


def test_who_jumps_again_and_again_drives_so():
    jump = STEP @ SE2(0.0, 0.0, 1.2)
    found = believed([STEP] * 30 + [jump] * 5)
    assert [has_jumped for _, has_jumped in found[30:]] == [True] * 3 + [False] * 2


def test_first_records_are_believed():
    assert believed([STEP] * 10 + [RIGHT_ANGLE])[-1] == (RIGHT_ANGLE, False)


def test_motion_and_poses_of_a_log_are_those_without_the_jump():
    since, T, true = MotionSinceScan(USUAL_NOISE.covariance), SE2.identity(), SE2.identity()
    for k in range(40):
        T, true = T @ STEP, true @ STEP
        T = T @ RIGHT_ANGLE if k == 30 else T
        since.add(LogRecord(INTERVAL_S * k, T, None))
        if k == 29:
            sure = since._covariance.copy()
    np.testing.assert_allclose(since.T_odom_base.as_array(), true.as_array(), atol=1e-9)
    np.testing.assert_allclose(
        since.motion.as_array(), (STEP.inverse() @ true).as_array(), atol=1e-9
    )
    # it may have turned in the tenth of a second that nobody knows of
    assert since._covariance[2, 2] > sure[2, 2] + 0.02


def test_what_a_robot_never_did_in_a_thousand_records_is_a_jump_or_told_late():
    # aces, 1 m off within 0.25 s: 0.164 m RMS, 0.77 m at one scan, and good
    fast = SE2(0.75, 0.0, 0.0)
    assert believed([*[STEP] * 990, fast])[-1] == (fast, False)
    jumps, drive = RecordJumps(), [*[STEP] * 1100, fast, STEP]
    pairs = [jumps.believed(INTERVAL_S * k, motion) for k, motion in enumerate(drive)]
    motion, more = pairs[-2]
    assert motion == STEP
    assert more is not None
    sigma_m, _, sigma_rad = np.sqrt(np.diag(more))
    assert sigma_m == pytest.approx(fast.x - STEP.x, abs=0.02)
    assert sigma_rad > 0.04
    assert pairs[-1] == (STEP, None)


@pytest.mark.parametrize("between", [[], [STEP] * 20])
def test_what_it_does_three_times_is_what_it_does(between):
    fast = SE2(0.75, 0.0, 0.0)
    found = believed([*[STEP] * 1100, *[fast, *between] * 6])
    told = [(motion, is_unsure) for motion, is_unsure in found[1100:] if motion in (fast, STEP)]
    assert [is_unsure for motion, is_unsure in told if motion == fast] == [False] * 3
    assert sum(is_unsure for _, is_unsure in found) == 3


@pytest.mark.parametrize(
    ("drive", "motion"),
    [
        ([STEP] * 1100, SE2(0.0, 0.0, 0.7)),
        ([STILL] * 1100 + [STEP], SE2(0.75, 0.0, 0.0)),
        # told late, each half a minute: aces 13 m off, and failed, where nothing was known of the way
        ([STEP] * 1100 + [STILL] * 12, SE2(0.75, 0.0, 0.0)),
    ],
)
def test_turns_the_first_ways_and_those_told_late_are_believed_as_ever(drive, motion):
    assert believed([*drive, motion])[-1] == (motion, False)

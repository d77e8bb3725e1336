"""Odometry that is told by a record or a few too late or too early, and made up for."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from slam.measurements import LaserScan
from slam.readers.log import MotionSinceScan
from slam.readers.log_odometry import USUAL_NOISE
from slam.readers.log_record import LogRecord
from slam.readers.uneven_odometry import UnevenOdometry
from slam.se2 import SE2

INTERVAL_S, STEP_M = 0.2, 0.25
STILL = SE2.identity()


def records_of(
    ways_m: Sequence[float], intervals_s: Sequence[float] | None = None, turn_rad_per_m: float = 0.0
) -> list[LogRecord]:
    """Of ways one after the other, along an arc."""
    intervals_s = [INTERVAL_S] * len(ways_m) if intervals_s is None else intervals_s
    gone_m = np.cumsum([0.0, *ways_m])
    times_s = np.cumsum([0.0, *intervals_s])
    return [
        LogRecord(float(time_s), SE2.exp(np.array([way_m, 0.0, turn_rad_per_m * way_m])), None)
        for time_s, way_m in zip(times_s, gone_m, strict=True)
    ]


def given_by(records: Sequence[LogRecord]) -> list[list[LogRecord]]:
    """What is given at each record, and at the end."""
    odometry = UnevenOdometry()
    return [*(odometry.take(record) for record in records), odometry.rest()]


def told(records: Sequence[LogRecord]) -> list[LogRecord]:
    return [record for given in given_by(records) for record in given]


def ways_m(records: Sequence[LogRecord]) -> list[float]:
    poses = [record.T_odom_base for record in records]
    return [math.hypot((a := one.between(other)).x, a.y) for one, other in pairwise(poses)]


def driven(*uneven_m: float) -> list[float]:
    return [STEP_M] * 20 + list(uneven_m) + [STEP_M] * 10


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("turn_rad_per_m", [0.0, 0.6])
@pytest.mark.parametrize(
    "uneven_m",
    [
        (0.0, 0.5),  # late by a record
        (0.5, 0.0),  # early by one
        (0.1, 0.0, 0.4, 0.5),  # of mit-csail, which goes on at 0.26 before and after
        (0.0, 0.0, 0.0, 1.0),
        (0.75, 0.0, 0.0),
    ],
)
def test_ways_that_make_up_for_each_other_were_driven_evenly(uneven_m, turn_rad_per_m, sign):
    uneven = [sign * one for one in driven(*uneven_m)]
    even = [sign * STEP_M] * len(uneven)
    found = told(records_of(uneven, turn_rad_per_m=turn_rad_per_m))
    true = records_of(even, turn_rad_per_m=turn_rad_per_m)
    assert len(found) == len(true)
    for one, other in zip(found, true, strict=True):
        assert one.time_s == other.time_s
        assert one.T_odom_base.is_near(other.T_odom_base, 1e-9, 1e-9)
    doubted = [record.late_sigma[0] for record in found]
    assert all(one > 0.0 for one in doubted[21 : 21 + len(uneven_m)])
    assert sum(one > 0.0 for one in doubted) == len(uneven_m)


@pytest.mark.parametrize(
    ("ways", "intervals_s"),
    [
        # stamps that tremble: the ways are even
        ([STEP_M] * 30, [INTERVAL_S, 0.05, 0.35, 0.1, 0.3] * 6),
        # scans that were left out: the ways are as long as the stamps say
        ([*[STEP_M] * 20, 2 * STEP_M, STEP_M, *[STEP_M] * 8], [*[0.2] * 20, 0.4, *[0.2] * 9]),
        ([*[STEP_M] * 20, 0.2, 0.13, 0.06, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], None),  # a stop
        ([*[STEP_M] * 20, 0.3, 0.35, 0.4, 0.4, 0.4, 0.4, 0.4], None),  # and going faster
        # a slow robot does as it likes
        ([*[0.03] * 20, 0.0, 0.06, *[0.03] * 10], None),
        ([0.0, 0.5] * 10, None),  # odometry that is told half as often as scans are taken
        (driven(0.2, 0.3), None),  # scans bear so much
        ([*[0.2] * 20, 0.132, 0.0, 0.0, 0.0], None),  # 3.4 m/s2: as mines-exp2 brakes
    ],
)
def test_what_robots_do_is_as_told(ways, intervals_s):
    records = records_of(ways, intervals_s)
    found = told(records)
    assert found == records


def test_leap_that_nothing_makes_up_for_is_unsure_by_as_much_as_no_robot_does():
    records = records_of(driven(2 * STEP_M))
    found = told(records)
    assert [one.T_odom_base for one in found] == [one.T_odom_base for one in records]
    sigmas_m = [one.late_sigma[0] for one in found]
    assert sigmas_m[21] == pytest.approx(STEP_M - 4.0 * INTERVAL_S**2)
    assert sum(sigmas_m) == sigmas_m[21]


@pytest.mark.parametrize("uneven_m", [(10.25, -9.75), (0.85, 0.25, -0.35), (-0.55, 0.25, 1.05)])
def test_pose_that_is_wrong_for_a_moment_is_not_spread_over_the_way(uneven_m):
    records = records_of(driven(*uneven_m))
    assert [one.T_odom_base for one in told(records)] == [one.T_odom_base for one in records]


def test_jump_that_is_not_believed_is_as_unsure_as_what_the_robot_did_instead():
    records = records_of([*[STEP_M] * 40, 10.0, *[STEP_M] * 30])
    seen = [
        replace(one, scan=LaserScan(one.time_s, np.zeros(1), np.ones(1))) for one in told(records)
    ]
    assert max(one.late_sigma[0] for one in seen) > 9.0
    motion = MotionSinceScan(USUAL_NOISE.covariance)
    found = [one for record in seen if (one := motion.add(record)) is not None]
    assert max(one.motion.x for one in found) == pytest.approx(STEP_M)
    assert max(one.motion_covariance[0, 0] for one in found) < 0.5**2


def test_robot_that_speeds_up_is_not_doubted_for_going_faster_since():
    speeds_mps = [1.0] * 20 + [1.0 + 2.0 * INTERVAL_S * k for k in range(1, 11)]
    records = records_of([INTERVAL_S * one for one in speeds_mps])
    assert told(records) == records


def test_records_wait_no_longer_than_needed():
    for ways in ([STEP_M] * 40, driven(0.0, 0.5), driven(0.0), driven(*[0.0] * 40)):
        records = records_of(ways)
        given = given_by(records)
        assert sum(len(one) for one in given) == len(records)
        times_s, most_s = [record.time_s for record in records], 0.0
        for time_s, one in zip(times_s, given, strict=False):
            most_s = max(most_s, *(time_s - record.time_s for record in one), 0.0)
        assert most_s <= 1.5 + INTERVAL_S


def test_record_that_says_the_same_again_is_where_the_other_is():
    records = records_of(driven(0.0, 0.5))
    doubled = [one for record in records for one in (record, record)]
    found = told(doubled)
    assert len(found) == len(doubled)
    for one, other in zip(found[::2], found[1::2], strict=True):
        assert one.T_odom_base.is_near(other.T_odom_base, 1e-9, 1e-9)
    assert ways_m(found[::2]) == pytest.approx([STEP_M] * (len(records) - 1))


def test_records_that_say_the_same_for_ever_do_not_wait_for_ever():
    first = records_of([*[STEP_M] * 20, 0.0])
    given = given_by([*first, *[first[-1]] * 2000])
    waiting = np.cumsum([1 - len(one) for one in given])
    assert waiting.max() <= 258


@pytest.mark.parametrize("stamps", ["stand", "go back"])
def test_stamps_that_tell_nothing_change_nothing(stamps):
    records = records_of(
        driven(0.0, 0.5), [*[INTERVAL_S] * 20, *[0.0 if stamps == "stand" else -0.1] * 12]
    )
    assert [one.T_odom_base for one in told(records)] == [one.T_odom_base for one in records]

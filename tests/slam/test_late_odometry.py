"""Odometry that stands while the robot drives on, and makes up for it in one record."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from slam.measurements import LaserScan
from slam.readers.late_odometry import LateOdometry
from slam.readers.log import Log, LogRecords, MotionSinceScan
from slam.readers.log_odometry import USUAL_NOISE
from slam.readers.log_record import LogRecord
from slam.se2 import SE2

INTERVAL_S = 0.2
STEP, STILL = SE2(0.08, 0.0, 0.02), SE2.identity()
DRIVE = [STEP] * 30


def scan(time_s: float, range_m: float) -> LaserScan:
    return LaserScan(time_s, np.linspace(-1.0, 1.0, 20), np.full(20, 1.0 + range_m))


def records_of(
    told: Sequence[SE2],
    ranges_m: Callable[[int], float | None] = float,
    interval_s: float = INTERVAL_S,
) -> list[LogRecord]:
    """Of motions at even times, with a scan of ranges each, if not None; each scan looks otherwise, if not said."""
    found, T_odom_base = [], STILL
    for k, motion in enumerate([STILL, *told]):
        T_odom_base, range_m, time_s = T_odom_base @ motion, ranges_m(k), interval_s * k
        found.append(
            LogRecord(time_s, T_odom_base, None if range_m is None else scan(time_s, range_m))
        )
    return found


def given_by(records: Sequence[LogRecord]) -> list[list[LogRecord]]:
    """What is given at each record, and at the end."""
    odometry = LateOdometry()
    return [*(odometry.take(record) for record in records), odometry.rest()]


def in_time(records: Sequence[LogRecord]) -> list[LogRecord]:
    return [record for given in given_by(records) for record in given]


def log_of(records: list[LogRecord], *, has_odometry: bool = True) -> Log:
    count = len(records)
    read = LogRecords(count, lambda: iter(records))
    return Log("late", STILL, count, read, USUAL_NOISE.covariance, has_odometry)


def late_by(count: int) -> list[SE2]:
    """A drive on one arc of which so many records and the one after them are told in that."""
    whole = SE2.exp((count + 1) * STEP.log())
    return [*DRIVE, *[STILL] * count, whole, *DRIVE]


@pytest.mark.parametrize("count", [2, 10, 40])
def test_way_that_is_told_late_was_driven_while_odometry_stood(count):
    true = records_of([STEP] * len(late_by(count)))
    found = in_time(records_of(late_by(count)))
    assert len(found) == len(true)
    for one, other in zip(found, true, strict=True):
        assert one.time_s == other.time_s
        assert one.T_odom_base.is_near(other.T_odom_base, 1e-9, 1e-9)
        assert (one.scan is None) == (other.scan is None)


def test_robot_that_had_slowed_down_may_have_turned_on_the_spot():
    slow, turned = SE2(0.02, 0.0, 0.0), SE2(0.0, 0.0, 1.2)
    records = records_of([*DRIVE, slow, slow, *[STILL] * 9, turned, *DRIVE])
    told_rad = [one.T_odom_base.theta for one in in_time(records)[32:43]]
    np.testing.assert_allclose(np.diff(told_rad), 0.12, atol=1e-9)


def test_it_is_the_less_sure_the_longer_odometry_stood():
    def of_whole(count: int) -> np.ndarray:
        sigmas = [one.late_sigma for one in in_time(records_of(late_by(count)))]
        assert not np.any(sigmas[:31])
        assert not np.any(sigmas[-30:])
        assert np.all(np.ptp(sigmas[31:-30], axis=0) < 1e-9)  # evenly
        return np.sqrt(np.square(sigmas).sum(axis=0)) / count

    (short_m, short_rad), (long_m, long_rad) = of_whole(4), of_whole(20)
    assert 0.0 < short_m < long_m
    assert 0.0 < short_rad < long_rad


def test_motion_since_the_scan_before_is_told_and_as_unsure():
    records = records_of(late_by(10))
    told = list(log_of(records).measurements())
    for one in told[1:]:
        assert one.motion.is_near(STEP, 1e-9, 1e-9)
    sure, late = told[20].motion_covariance, told[35].motion_covariance
    late_m, late_rad = in_time(records)[35].late_sigma
    np.testing.assert_allclose(np.diag(late - sure), np.square([late_m, late_m, late_rad]))


def test_log_of_scans_alone_is_told_as_it_is():
    records = records_of(late_by(10))
    told = log_of(records, has_odometry=False).records_in_time()
    assert all(a is b for a, b in zip(told, records, strict=True))


@pytest.mark.parametrize(
    ("told", "ranges_m"),
    [
        # a robot that stands, as its scans show, and odometry that jumps
        ([*DRIVE, *[STILL] * 10, SE2(0.5, 0.0, 1.0), *DRIVE], lambda k: min(k, 30)),
        # encoders that dropped out: what they tell then is the way of a record
        (DRIVE + [STILL] * 10 + DRIVE, float),
        # and be it that of a fast one, or a heading that jumped: it drove on
        ([*DRIVE, *[STILL] * 40, SE2(0.2, 0.0, 0.0), *DRIVE], float),
        ([*DRIVE, *[STILL] * 20, SE2(0.08, 0.0, math.pi / 2.0), *DRIVE], float),
        # a jump by more than it can have driven
        ([*DRIVE, *[STILL] * 10, SE2(7.0, 0.0, 0.0), *DRIVE], float),
        # or turned
        ([*DRIVE, *[STILL] * 3, SE2(0.0, 0.0, math.pi / 2.0), *DRIVE], float),
        # no scan lies between: for those before and after, it is one way
        ([*DRIVE, *[STILL] * 10, SE2(0.5, 0.0, 0.0), *DRIVE], lambda k: k if k < 30 or k > 40 else None),
        # none has been driven from which it would be known how fast the robot goes
        ([*DRIVE[:10], *[STILL] * 10, SE2(0.8, 0.0, 0.0), *DRIVE], float),
    ],
)  # fmt: skip
def test_records_that_need_not_be_late_are_told_as_they_are(told, ranges_m):
    records = records_of(told, ranges_m)
    assert [replace(one, is_denied=False) for one in in_time(records)] == records


@pytest.mark.parametrize(
    ("still", "ranges_m", "is_denied"),
    [
        (10, float, True),
        (70, float, True),  # more than wait
        (5, float, False),  # less than a second: drivers tell the same several times
        (40, lambda k: min(k, 31), False),
        # who was seen once: a robot stands no two seconds
        (12, lambda k: k if k < 30 or k == 36 else None, True),
        (8, lambda k: k if k < 30 or k == 36 else None, False),
        # nor was seen at all: logs that tell scans while the robot drives
        (40, lambda k: k if k < 30 else None, False),
    ],
)
def test_stand_that_scans_deny_is_told_as_such(still, ranges_m, is_denied):
    given = in_time(records_of([*DRIVE, *[STILL] * still, *DRIVE], ranges_m))
    told = [one.is_denied for one in given]
    assert told == [False] * 31 + [is_denied] * still + [False] * 30


def test_robot_that_stood_and_went_on_unseen_by_its_odometry_left_where_it_stood_last():
    # scans alike until the 36th, then other ones; odometry tells of it at the 46th
    records = records_of(
        [*DRIVE, *[STILL] * 15, SE2(0.8, 0.0, 0.0)], lambda k: k if k < 31 or k > 36 else 30
    )
    told = in_time(records)
    assert all(a is b for a, b in zip(told[:37], records[:37], strict=True))
    moved_m = [
        math.hypot(*(one.T_odom_base.as_array() - records[36].T_odom_base.as_array())[:2])
        for one in told[36:]
    ]
    np.testing.assert_allclose(moved_m, 0.08 * np.arange(11), atol=1e-9)


def test_odometry_that_stood_unseen_before_it_was_late_is_late_by_ten_seconds_at_most():
    # a log that tells scans of a robot that drives alone: a minute without, and none of it was believed to be late
    late = 20
    told = [*DRIVE, *[STILL] * 300, *[STILL] * late, SE2((late + 1) * STEP.x, 0.0, 0.0)]
    records = records_of(told, lambda k: k if k <= len(DRIVE) or k > len(DRIVE) + 300 else None)
    given = in_time(records)
    assert [one.time_s for one in given] == [one.time_s for one in records]
    moved_m = [
        math.hypot(*(one.T_odom_base.as_array() - records[31].T_odom_base.as_array())[:2])
        for one in given
    ]
    assert max(moved_m[31:-53]) == 0.0
    np.testing.assert_allclose(np.diff(moved_m[-50:]), (late + 1) * STEP.x / 51, rtol=0.05)
    assert min(one.late_sigma[0] for one in given[-50:]) > 0.0


def test_records_wait_only_while_it_is_open_whether_the_robot_stands():
    # a scan at the stamp of the odometry's own record, as most drivers write it, waits for nothing
    records = records_of(DRIVE, lambda k: None)
    twice = [
        one for r in records for one in (r, LogRecord(r.time_s, r.T_odom_base, scan(0.0, 1.0)))
    ]
    assert [len(given) for given in given_by(twice)] == [1] * len(twice) + [0]
    # nor one that shows that the robot stands
    stands = records_of([*DRIVE, *[STILL] * 100], lambda k: min(k, 30))
    assert [len(given) for given in given_by(stands)] == [1] * len(stands) + [0]
    # all others for ten seconds
    dead = records_of([*DRIVE, *[STILL] * 100])
    *given, rest = given_by(dead)
    waited_s = [
        now.time_s - one.time_s for now, told in zip(dead, given, strict=True) for one in told
    ]
    np.testing.assert_allclose(waited_s[31:], 10.0 + INTERVAL_S, atol=INTERVAL_S + 1e-6)
    assert len(waited_s) + len(rest) == len(dead)
    assert len(rest) == pytest.approx(10.0 / INTERVAL_S, abs=1)
    # and what waits at the end is told
    assert [len(given) for given in given_by(dead[:40])] == [1] * 31 + [0] * 9 + [9]


@pytest.mark.parametrize("interval_s", [0.0, -0.2])
def test_stamps_that_stand_or_go_back_are_borne(interval_s):
    records = records_of(late_by(10), interval_s=interval_s)
    assert all(a is b for a, b in zip(in_time(records), records, strict=True))
    stands = records_of([STILL] * 90, lambda k: None, interval_s=interval_s)
    assert [len(given) for given in given_by(stands)] == [1] * len(stands) + [0]


def test_whoever_stood_before_the_laser_as_the_robot_stopped_does_not_make_it_drive():
    # half a minute, of which the first scans look otherwise, and then a jump of odometry
    told = [*DRIVE, *[STILL] * 150, SE2(0.8, 0.0, 0.0), *DRIVE]
    records = records_of(told, lambda k: 40 if 34 < k <= 181 else k)
    assert not any(any(one.late_sigma) for one in in_time(records))


def test_clock_that_is_set_back_while_odometry_stands_lets_all_go():
    stands = records_of([*DRIVE, *[STILL] * 40])
    later = [replace(one, time_s=one.time_s - 3600.0) for one in stands[60:]]
    given = [len(one) for one in given_by([*stands[:60], *later])]
    assert given[60] == 30
    assert sum(given) == len(stands)


def test_no_more_records_wait_than_memory_bears():
    fast = records_of([STEP, *[STILL] * 9000], lambda k: None, interval_s=0.001)
    given = [len(given) for given in given_by(fast)]
    assert max(given) == 2048
    assert sum(given) == len(fast)


def test_pose_by_odometry_goes_on_between_the_scans_as_well():
    records, motion = records_of(late_by(10)), MotionSinceScan(USUAL_NOISE.covariance)
    for k, record in enumerate(in_time(records)):
        motion.add(record)
        expected = SE2.exp(k * STEP.log())
        assert motion.T_odom_base.is_near(expected, 1e-9, 1e-9)

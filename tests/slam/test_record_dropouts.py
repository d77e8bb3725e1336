"""Odometry that stands still at full pace, or where scans deny it: how far the robot went on nobody knows."""

from collections.abc import Callable

import numpy as np
import pytest

from slam.measurements import LaserScan
from slam.readers.record_dropouts import RecordDropouts
from slam.se2 import SE2

STEP, STILL = SE2(0.08, 0.0, 0.04), SE2.identity()
INTERVAL_S = 0.2


def sigmas(
    told: list[SE2], interval_s: float = INTERVAL_S, ranges_m: Callable[[int], float | None] = float
) -> list[tuple[float, float]]:
    """How unsure motions are, told at even times with a scan each [m], [rad]; of each added up with those
    before. ranges_m: of the scan after so many, if not that each looks otherwise; None without."""
    dropouts, total, found = RecordDropouts(), np.zeros((3, 3)), []
    for k, motion in enumerate(told):
        dropouts.take(interval_s * k, motion)
        range_m = ranges_m(k)
        more = None if range_m is None else dropouts.covariance(scan(interval_s * k, range_m))
        total = total if more is None else total + more
        found.append((float(np.sqrt(total[0, 0])), float(np.sqrt(total[2, 2]))))
    return found


def scan(time_s: float, ranges_m: float) -> LaserScan:
    return LaserScan(time_s, np.linspace(-1.0, 1.0, 20), np.full(20, 1.0 + ranges_m))


def once(at: int) -> Callable[[int], float | None]:
    """Scans while the robot drives, and one while odometry stands: it has none to be like."""
    return lambda k: k if k < 30 or k == at else None


@pytest.mark.parametrize("at", [33, 35, 39])
def test_robot_whose_odometry_stops_at_full_pace_may_have_gone_on(at):
    found = sigmas([STEP] * 30 + [STILL] * 10, ranges_m=once(at))
    # less than a second: drivers tell the same several times
    steps = 0 if at == 33 else at - 29
    assert found[at] == pytest.approx((steps * STEP.x, steps * STEP.theta))


def test_where_it_starts_again_it_may_tell_of_a_part_or_of_all():
    dropped = [STEP] * 30 + [STILL] * 10
    part, whole = SE2(0.03, 0.0, 0.0), SE2(0.8, 0.0, 0.0)
    before = sigmas(dropped)[-1][0]
    assert sigmas([*dropped, part])[-1][0] == pytest.approx(np.hypot(before, 0.03))
    assert sigmas([*dropped, whole])[-1][0] == pytest.approx(np.hypot(before, 0.8))
    assert sigmas([*dropped, STEP, STEP])[-1] == sigmas([*dropped, STEP])[-1]


@pytest.mark.parametrize("count", [3, 5, 20])
def test_odometry_that_is_told_several_times_never_drops_out(count):
    # aces, each record told three times: a right map was failed
    told = [motion for _ in range(60) for motion in (STEP, *[STILL] * (count - 1))]
    assert sigmas(told, interval_s=0.02)[-1] == (0.0, 0.0)


@pytest.mark.parametrize(
    "stop",
    [
        [SE2(0.05, 0.0, 0.0), SE2(0.03, 0.0, 0.0)],  # a robot that brakes
        [SE2(0.0, 0.0, 0.05)],  # that turned a little at last
    ],
)
def test_robot_that_brakes_stands(stop):
    told = [STEP] * 30 + stop + [STILL] * 10
    assert sigmas(told, ranges_m=once(len(told) - 1))[-1] == (0.0, 0.0)
    # unless scans deny it: as far on as robots usually go
    found = sigmas(told)
    assert found[len(told) - 7] == (0.0, 0.0)
    assert found[-1][0] == pytest.approx(10 * STEP.x)
    assert found[-1][1] >= 10 * STEP.theta


def test_slow_records_and_whoever_stands_for_long_tell_nothing_of_it():
    # half a metre a second may be braked away in a second
    slow = [SE2(0.4, 0.0, 0.0)] * 30 + [STILL] * 10
    assert sigmas(slow, interval_s=1.0, ranges_m=once(39))[-1] == (0.0, 0.0)
    # who knows how it drives
    assert sigmas([STEP] * 10 + [STILL] * 10, ranges_m=lambda k: k if k == 19 else None)[-1] == (
        0.0,
        0.0,
    )
    # nobody drives on for as long
    dropouts = RecordDropouts()
    for k in range(30 + 200):
        dropouts.take(INTERVAL_S * k, STEP if k < 30 else STILL)
    assert dropouts.covariance(scan(46.0, 9.0)) is None


def test_stamps_that_stand_are_no_dropout():
    dropouts = RecordDropouts()
    for k in range(40):
        dropouts.take(INTERVAL_S * k, STEP)
        dropouts.take(INTERVAL_S * k, STILL)  # its scan's record
        assert dropouts.covariance(scan(INTERVAL_S * k, k)) is None


def test_stand_that_scans_to_come_deny_is_none_from_its_first_record_on():
    def sigma_m(is_denied: bool) -> float:
        dropouts = RecordDropouts()
        for k in range(30):
            dropouts.take(INTERVAL_S * k, SE2(0.02, 0.0, 0.0))
        dropouts.covariance(scan(INTERVAL_S * 29, 29.0))
        dropouts.take(INTERVAL_S * 30, STILL, is_denied)
        more = dropouts.covariance(scan(INTERVAL_S * 30, 30.0))
        return 0.0 if more is None else float(np.sqrt(more[0, 0]))

    assert sigma_m(is_denied=False) == 0.0
    assert sigma_m(is_denied=True) == pytest.approx(0.02)


def test_scan_that_looks_as_before_the_stop_sees_that_the_robot_stands():
    drive = [STEP] * 30 + [STILL] * 10
    assert sigmas(drive, ranges_m=lambda k: min(k, 29))[-1] == (0.0, 0.0)
    # nor does it become unsure when it drives on
    assert sigmas([*drive, STEP, STEP], ranges_m=lambda k: min(k, 29) if k < 40 else k)[-1][0] < 0.1
    # scans after a second tell, and not those before
    assert sigmas(drive, ranges_m=lambda k: min(k, 29) if k < 33 else k)[-1][0] > 0.5


def test_cheap_laser_that_loses_beams_sees_that_the_robot_stands():
    rng, dropouts = np.random.default_rng(5), RecordDropouts()

    def lossy(k: int) -> LaserScan:
        ranges_m = np.where(rng.random(360) < 0.06, np.inf, 1.0 + min(k, 29))
        return LaserScan(INTERVAL_S * k, np.linspace(-3.0, 3.0, 360), ranges_m)

    for k in range(60):
        dropouts.take(INTERVAL_S * k, STEP if k < 30 else STILL)
        assert dropouts.covariance(lossy(k)) is None


def test_stop_between_two_scans_is_seen_by_the_next_ones():
    dropouts = RecordDropouts()
    for k in range(60):
        dropouts.take(INTERVAL_S * k, STEP if k < 30 else STILL)
        if k in (25, 36, 50):  # a metre before, and twice where it stands
            more = dropouts.covariance(scan(INTERVAL_S * k, min(k, 30)))
            assert (more is not None) is (k == 36)

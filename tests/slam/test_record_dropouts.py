"""Odometry that stands still at full pace: how far the robot went on nobody knows."""

from collections.abc import Callable

import numpy as np
import pytest

from slam.measurements import LaserScan
from slam.readers.record_dropouts import RecordDropouts
from slam.se2 import SE2

STEP, STILL = SE2(0.08, 0.0, 0.04), SE2.identity()
INTERVAL_S = 0.2


def sigmas(
    told: list[SE2], interval_s: float = INTERVAL_S, ranges_m: Callable[[int], float] = float
) -> list[tuple[float, float]]:
    """How unsure motions are, told at even times with a scan each [m], [rad]; of each added up with those
    before. ranges_m: of the scan after so many, if not that each looks otherwise."""
    dropouts, total, found = RecordDropouts(), np.zeros((3, 3)), []
    for k, motion in enumerate(told):
        dropouts.take(interval_s * k, motion)
        more = dropouts.covariance(scan(interval_s * k, ranges_m(k)))
        total = total if more is None else total + more
        found.append((float(np.sqrt(total[0, 0])), float(np.sqrt(total[2, 2]))))
    return found


def scan(time_s: float, ranges_m: float) -> LaserScan:
    return LaserScan(time_s, np.linspace(-1.0, 1.0, 20), np.full(20, 1.0 + ranges_m))


def test_robot_whose_odometry_stops_at_full_pace_may_have_gone_on():
    found = sigmas([STEP] * 30 + [STILL] * 10)
    assert found[33] == (0.0, 0.0)  # less than a second: drivers tell the same several times
    assert found[35] == pytest.approx((6 * STEP.x, 6 * STEP.theta))
    assert found[39] == pytest.approx((10 * STEP.x, 10 * STEP.theta))


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
    assert sigmas([STEP] * 30 + stop + [STILL] * 10)[-1] == (0.0, 0.0)


def test_slow_records_and_whoever_stands_for_long_tell_nothing_of_it():
    # half a metre a second may be braked away in a second
    assert sigmas([SE2(0.4, 0.0, 0.0)] * 30 + [STILL] * 10, interval_s=1.0)[-1] == (0.0, 0.0)
    assert sigmas([STEP] * 10 + [STILL] * 10)[-1] == (0.0, 0.0)  # who knows how it drives
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

"""Scans and measurements: what is a hit, and what is refused at the border."""

import math

import numpy as np
import pytest

from slam.measurements import LaserScan, Measurement
from slam.se2 import SE2


def test_points_are_the_hits_alone_seen_from_the_base():
    scan = LaserScan(0.0, [-math.pi / 2, 0.0, 1.0, 1.2, 1.4], [1.0, 2.0, np.inf, -np.inf, np.nan])
    points = scan.points(SE2(0.1, 0.0, math.pi / 2))
    # a laser 10 cm ahead that looks to the left: its right is the robot's front
    np.testing.assert_allclose(points, [[1.1, 0.0], [0.1, 2.0]], atol=1e-12)
    assert scan.is_hit.tolist() == [True, True, False, False, False]


def test_cut_scan_calls_far_hits_no_return():
    scan = LaserScan(0.0, [0.0, 1.0, 2.0], [5.0, 12.0, 12.1]).cut(12.0)
    assert scan.ranges_m.tolist() == [5.0, 12.0, np.inf]


def test_arrays_are_copied_and_cannot_be_written():
    ranges_m = np.array([1.0, 2.0])
    scan = LaserScan(0.0, [0.0, 1.0], ranges_m)
    ranges_m[0] = 9.0
    assert scan.ranges_m[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        scan.ranges_m[0] = 9.0


@pytest.mark.parametrize(
    ("angles", "ranges", "message"),
    [
        ([0.0, 1.0], [1.0], r"ranges_m must have shape \(2\), not \(1,\)"),
        ([1.0, 0.0], [1.0, 1.0], "increase"),
        ([0.0, 0.0], [1.0, 1.0], "increase"),
        ([0.0, 1.0], [1.0, -0.5], "negative"),
        ([[0.0, 1.0]], [[1.0, 1.0]], "angles_rad must have shape"),
    ],
)
def test_malformed_scan_is_refused(angles, ranges, message):
    with pytest.raises(ValueError, match=message):
        LaserScan(0.0, angles, ranges)


@pytest.mark.parametrize("bad_s", [math.nan, math.inf, -math.inf, 1e300, 50.0])
def test_beam_without_a_time_is_one_of_which_nothing_is_known(bad_s):
    times_s = [5.00, 5.01, bad_s, 5.03, bad_s]
    scan = LaserScan(5.04, np.arange(5.0), np.full(5, 2.0), times_s)
    np.testing.assert_array_equal(scan.ranges_m, [2.0, 2.0, np.nan, 2.0, np.nan])
    # between its neighbours', or that of the last
    np.testing.assert_allclose(scan.beam_times_s, [5.00, 5.01, 5.02, 5.03, 5.03])
    assert not scan.beam_times_s.flags.writeable
    assert not scan.ranges_m.flags.writeable


def test_nan_that_signals_is_one_that_does_not():
    signal = np.frombuffer(b"\x01\x00\x00\x00\x00\x00\xf0\x7f", dtype=np.float64)[0]
    ranges_m = np.array([1.0, signal, math.inf])
    scan = LaserScan(0.0, np.arange(3.0), ranges_m, np.array([0.0, 0.0, signal]))
    with np.errstate(invalid="raise"):
        assert np.isnan(scan.ranges_m - 1.0).tolist() == [False, True, True]


def test_times_of_which_none_is_one_are_not_known():
    scan = LaserScan(5.0, [0.0, 1.0], [2.0, 3.0], [np.nan, np.inf])
    assert scan.beam_times_s is None
    assert scan.ranges_m.tolist() == [2.0, 3.0]
    assert scan.cut(2.5).ranges_m.tolist() == [2.0, np.inf]


SCAN = LaserScan(0.0, [0.0], [1.0])


def test_measurement_without_covariance_gets_that_of_wheels_of_which_nothing_is_known():
    # closed form of OdometryNoise: a straight metre, 0.3 m between the wheels
    metre = Measurement(0.0, SE2(1.0, 0.0, 0.0), SCAN).motion_covariance
    np.testing.assert_allclose(
        np.diag(metre), [0.003**2 / 2 + 1e-8, 0.003**2 + 1e-8, 2 * (0.003 / 0.3) ** 2 + 1e-8]
    )
    back = Measurement(0.0, SE2(-1.0, 0.0, 0.0), SCAN).motion_covariance
    np.testing.assert_allclose(back, metre)
    # a turn on the spot: each wheel rolls 0.15 m a radian
    turn = Measurement(0.0, SE2(0.0, 0.0, math.pi), SCAN).motion_covariance
    rolled_m = 0.15 * math.pi
    heading = 2 * 0.01**2 * rolled_m + 0.035**2 / 2 + 1e-8
    assert turn[2, 2] == pytest.approx(heading)
    # zeros said that a robot at rest is exactly where it was: 60 scans, NEES 33; with this 4
    still = Measurement(0.0, SE2.identity(), SCAN).motion_covariance
    np.testing.assert_allclose(still, 1e-8 * np.eye(3))


def test_covariance_may_be_zero_and_a_rounding_off():
    assert not Measurement(0.0, SE2.identity(), SCAN, np.zeros((3, 3))).motion_covariance.any()
    ones = np.ones((3, 3)) * 1e-4
    ones[0, 1] += 1e-16
    Measurement(0.0, SE2.identity(), SCAN, ones)


@pytest.mark.parametrize(
    ("time_s", "motion", "covariance", "message"),
    [
        (0.0, SE2.identity(), np.eye(2), r"motion_covariance must have shape \(3, 3\)"),
        (0.0, SE2.identity(), np.full((3, 3), np.nan), "motion_covariance must be finite"),
        (0.0, SE2.identity(), np.diag([1.0, np.inf, 1.0]), "motion_covariance must be finite"),
        (0.0, SE2.identity(), np.eye(3) + np.eye(3, k=1), "must be symmetric"),
        (0.0, SE2.identity(), np.diag([1.0, 1.0, -1e-3]), "eigenvalue.* is -0.001"),
        (0.0, SE2(math.nan, 0.0, 0.0), np.eye(3), r"motion must be finite, not SE2\(x=nan"),
        (0.0, SE2(0.0, 0.0, math.inf), None, "motion must be finite"),
        (math.nan, SE2.identity(), None, "time_s must be finite, not nan"),
    ],
)
def test_malformed_measurement_is_refused_in_one_line(time_s, motion, covariance, message):
    with pytest.raises(ValueError, match=message) as caught:
        Measurement(time_s, motion, SCAN, covariance)
    assert "\n" not in str(caught.value)

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


def test_measurement_without_covariance_claims_a_perfect_motion():
    scan = LaserScan(0.0, [0.0], [1.0])
    assert not Measurement(0.0, SE2.identity(), scan).motion_covariance.any()
    with pytest.raises(ValueError, match="motion_covariance"):
        Measurement(0.0, SE2.identity(), scan, np.eye(2))

"""Wheels calibrated from a drive in an unknown place."""

from dataclasses import replace

import numpy as np
import pytest

from slam.measurements import LaserScan, Measurement
from slam.odometry import DifferentialDrive, OdometryNoise, WheelModel
from slam.se2 import SE2
from slam.sharpness import wall_spread_m
from slam.wheel_calibration import SeenMotions, calibrated_wheels
from tests.slam.synthetic import box, room, scan_of

TRUE = WheelModel(DifferentialDrive((0.0754, 0.0760), 0.295, 2000), SE2(0.15, 0.0, 0.02), -0.1)
ASSUMED = WheelModel(DifferentialDrive((0.077, 0.077), 0.33, 2000), SE2(0.15, 0.0, 0.0), 0.0)
WALLS = np.concatenate([room(0.0, 0.0, 7.0, 5.0), box(3.0, 2.2, 3.8, 2.9), box(0.0, 3.9, 0.7, 5.0)])
INTERVAL_S = 0.1


def ticks_of_drive(count: int, rng: np.random.Generator) -> np.ndarray:
    """(N, 2) between scans: arcs to both sides at up to 1 m/s and 1 rad/s, speed that changes."""
    t = INTERVAL_S * np.arange(count)
    speed = 0.6 + 0.4 * np.sin(0.9 * t)
    turn = 1.1 * np.sin(0.5 * t) + 0.15
    half = turn * 0.295 / 2.0
    travel = INTERVAL_S * np.column_stack([speed - half, speed + half])
    return np.round(travel / (2.0 * np.pi * 0.0757) * 2000 + rng.normal(0.0, 1.0, travel.shape))


def seen(ticks: np.ndarray, rng: np.random.Generator, sigma: float) -> SeenMotions:
    """What perfect matching, but for noise, would tell of a drive by the true wheels."""
    T_base_seen = TRUE.T_base_laser @ ASSUMED.T_base_laser.inverse()
    true = [T_base_seen.inverse() @ TRUE.motion(one, INTERVAL_S) @ T_base_seen for one in ticks]
    by_scans = np.array([motion.log() for motion in true]) + rng.normal(0.0, sigma, (len(ticks), 3))
    by_wheels = np.array([ASSUMED.motion(one, INTERVAL_S).log() for one in ticks])
    return SeenMotions(by_scans, by_wheels, np.full(len(ticks), INTERVAL_S))


def test_wheels_are_found_within_their_sigmas_though_one_match_in_ten_is_wrong():
    rng = np.random.default_rng(0)
    told = seen(ticks_of_drive(600, rng), rng, 0.004)
    told.by_scans[::10] += rng.normal(0.0, 0.2, (60, 3))
    found = calibrated_wheels(told, ASSUMED)
    true = np.array([0.0754 / 0.077, 0.0760 / 0.077, 0.295 / 0.33, 0.15, 0.0, 0.02, -0.1])
    assert (np.abs(found.values[:7] - true) < 3.5 * found.sigmas[:7]).all()
    # the sigmas are about that large
    np.testing.assert_allclose(found.wheels.drive.wheel_radius_m, (0.0754, 0.0760), rtol=0.015)
    assert found.wheels.drive.track_m == pytest.approx(0.295, rel=0.015)
    assert found.scatter[2] < 0.6 * found.scatter_before[2]


def test_too_short_a_drive_is_refused():
    rng = np.random.default_rng(1)
    with pytest.raises(ValueError, match="50 motions, not 20"):
        calibrated_wheels(seen(ticks_of_drive(20, rng), rng, 0.004), ASSUMED)


def test_motions_are_seen_by_the_scans_whatever_the_wheels_say():
    rng = np.random.default_rng(2)
    pose, measurements = SE2(1.5, 1.2, 0.3), []
    for k in range(70):
        motion = SE2.exp([0.04, 0.0, 0.05]) if k else SE2.identity()
        pose = pose @ motion
        scan = scan_of(WALLS, pose @ TRUE.T_base_laser, rng, 0.01)
        told = SE2.exp([0.03, 0.0, 0.04]) if k else SE2.identity()
        scan = LaserScan(INTERVAL_S * k, scan.angles_rad, scan.ranges_m)
        covariance = OdometryNoise().covariance(TRUE.drive, [160.0, 220.0])
        measurements.append(Measurement(scan.time_s, told, scan, covariance))
    found = SeenMotions.of(measurements, TRUE.T_base_laser)
    assert len(found) > 60
    np.testing.assert_allclose(np.median(found.by_scans, axis=0), [0.04, 0.0, 0.05], atol=0.002)


@pytest.mark.parametrize("off_m", [0.0, 0.1])
def test_walls_seen_twice_spread_by_how_far_they_are_off(off_m):
    rng = np.random.default_rng(3)
    wall = np.column_stack([np.linspace(0.0, 5.0, 400), np.zeros(400)])
    visits = [[wall + rng.normal(0.0, 0.01, wall.shape) for _ in range(5)] for _ in range(2)]
    elsewhere = [np.zeros((0, 2))] * 5
    views = [*visits[0], *elsewhere, *(view + np.array([0.0, off_m]) for view in visits[1])]
    assert wall_spread_m(views, (4, np.inf)) == pytest.approx(np.hypot(0.01, off_m), rel=0.05)
    assert wall_spread_m(views[:4], (4, np.inf)) is None


def test_side_slip_leaves_a_straight_way_straight():
    straight, arc = np.array([400.0, 400.0]), np.array([300.0, 400.0])
    assert TRUE.motion(straight, 0.1).y == pytest.approx(0.0, abs=1e-3)
    without = replace(TRUE, side_slip_s=0.0).motion(arc, 0.1).log()
    ahead_m, aside_m, turn_rad = TRUE.motion(arc, 0.1).log()
    assert (ahead_m, turn_rad) == (without[0], without[2])
    assert aside_m == pytest.approx(-0.1 * ahead_m * turn_rad / 0.1)

"""Odometry against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest

from slam.odometry import DifferentialDrive, OdometryNoise, compose_covariance
from slam.se2 import SE2

DRIVE = DifferentialDrive(wheel_radius_m=(0.05, 0.05), track_m=0.3, ticks_per_turn=2000)
ONE_TURN_M = 2.0 * math.pi * 0.05


def test_equal_ticks_drive_straight():
    motion = DRIVE.motion([2000, 2000])
    assert (motion.x, motion.y, motion.theta) == pytest.approx((ONE_TURN_M, 0.0, 0.0), abs=1e-12)


def test_opposite_ticks_turn_on_the_spot():
    motion = DRIVE.motion([-500, 500])
    expected_rad = 2.0 * (ONE_TURN_M / 4.0) / 0.3
    assert (motion.x, motion.y, motion.theta) == pytest.approx((0.0, 0.0, expected_rad), abs=1e-12)


def test_arc_is_exact_for_a_large_angle():
    # left still, right rolls: a circle of half the track about the left wheel
    motion = DRIVE.motion([0, 4000])
    angle = 2.0 * ONE_TURN_M / 0.3
    assert motion.x == pytest.approx(0.15 * math.sin(angle), abs=1e-12)
    assert motion.y == pytest.approx(0.15 * (1.0 - math.cos(angle)), abs=1e-12)


def test_one_arc_equals_a_thousand_pieces_of_it():
    # the half-angle approximation is off by millimetres here
    pose = SE2.identity()
    for _ in range(1000):
        pose = pose @ DRIVE.motion([3, 7])
    whole = DRIVE.motion([3000, 7000])
    np.testing.assert_allclose(pose.as_array(), whole.as_array(), atol=1e-10)


def test_unequal_wheels_bend_a_straight_track():
    drive = DifferentialDrive((0.05, 0.051), 0.3, 2000)
    assert drive.motion([2000, 2000]).theta == pytest.approx(2.0 * math.pi * 0.001 / 0.3)


def test_covariance_of_two_halves_is_that_of_the_whole_straight_way():
    # standing still adds only the floor; along and heading variances grow with the distance
    noise = OdometryNoise(floor_m=0.0, floor_rad=0.0)
    half, whole = noise.covariance(DRIVE, [2000, 2000]), noise.covariance(DRIVE, [4000, 4000])
    both = compose_covariance(half, DRIVE.motion([2000, 2000]), half)
    np.testing.assert_allclose(both[[0, 2], [0, 2]], whole[[0, 2], [0, 2]], rtol=1e-12)


def test_composed_covariance_agrees_with_many_drawn_motions():
    rng = np.random.default_rng(0)
    first, second = SE2(1.0, 0.2, 0.7), SE2(0.8, -0.1, -0.4)
    covariance_a = np.diag([1e-2, 2e-2, 3e-2]) ** 2
    covariance_b = np.diag([2e-2, 1e-2, 1e-2]) ** 2
    draws = 20_000
    noise_a = rng.multivariate_normal(np.zeros(3), covariance_a, draws)
    noise_b = rng.multivariate_normal(np.zeros(3), covariance_b, draws)
    ideal = (first @ second).inverse()
    errors = [
        (ideal @ first @ SE2.exp(a) @ second @ SE2.exp(b)).log()
        for a, b in zip(noise_a, noise_b, strict=True)
    ]
    composed = compose_covariance(covariance_a, second, covariance_b)
    # 20 000 draws estimate a variance to 1 %; five of these, relative to the largest
    np.testing.assert_allclose(np.cov(np.array(errors).T), composed, atol=0.05 * composed.max())


def test_drive_without_track_is_refused():
    with pytest.raises(ValueError, match="above 0"):
        DifferentialDrive((0.05, 0.05), 0.0, 2000)
    with pytest.raises(ValueError, match=r"shape \(2,\)"):
        DRIVE.motion([1, 2, 3])


def test_tires_scrub_as_far_as_the_wheels_turn_against_each_other():
    plain = OdometryNoise()
    scrubbing = replace(plain, pivot_m_per_sqrt_turn=0.01)

    def more(left: float, right: float) -> np.ndarray:
        return scrubbing.covariance(DRIVE, [left, right]) - plain.covariance(DRIVE, [left, right])

    turn = DRIVE.ticks_per_turn * DRIVE.track_m / (2.0 * DRIVE.wheel_radius_m[0])
    # a turn on the spot; a bend about a point beside both wheels; about one of them
    np.testing.assert_allclose(more(-turn, turn), np.diag([1e-4, 1e-4, 0.0]), atol=1e-12)
    np.testing.assert_allclose(more(turn, 2.0 * turn), 0.0, atol=1e-12)
    np.testing.assert_allclose(more(0.0, turn), 0.0, atol=1e-12)

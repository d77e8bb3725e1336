"""Poses at times that are not a trajectory's own; many poses at once."""

import math

import numpy as np
import pytest

from slam.pose_arrays import between, composed
from slam.pose_lookup import PoseLookup
from slam.se2 import SE2, wrap_angle
from slam.trajectory import Trajectory


def drive(times_s: np.ndarray) -> np.ndarray:
    """Poses (N, 3) on a circle of 2 m at 1 m/s, from the origin to the left."""
    return np.array([SE2.exp([t, 0.0, t / 2.0]).as_array() for t in times_s])


def test_many_poses_at_once_are_what_each_is_alone():
    rng = np.random.default_rng(0)
    first, second = rng.uniform(-3.0, 3.0, (2, 50, 3))
    for row, (a, b) in enumerate(zip(first, second, strict=True)):
        A, B = SE2.from_array(a), SE2.from_array(b)
        np.testing.assert_allclose(composed(first, second)[row], (A @ B).as_array(), atol=1e-12)
        np.testing.assert_allclose(
            between(first, second)[row], (A.inverse() @ B).as_array(), atol=1e-12
        )


def test_pose_of_the_same_stamp_is_found_whatever_the_gaps():
    trajectory = Trajectory([0.0, 100.0, 200.0], [[1, 2, 3], [4, 5, 6], [7, 8, 9]])
    found = PoseLookup(trajectory).at([0.0, 99.99995, 200.00005, 50.0])
    np.testing.assert_allclose(found[:3], trajectory.poses)
    assert np.isnan(found[3]).all()


def test_between_near_neighbours_it_goes_straight_and_turns_the_short_way():
    trajectory = Trajectory([0.0, 1.0], [[0.0, 0.0, 3.0], [1.0, 2.0, -3.0]])
    x, y, theta = PoseLookup(trajectory).at([0.5])[0]
    assert (x, y, abs(theta)) == pytest.approx((0.5, 1.0, math.pi))


def test_without_odometry_nothing_is_known_beyond_the_ends():
    found = PoseLookup(Trajectory([0.0, 1.0], np.zeros((2, 3)))).at([-0.01, 1.01])
    assert np.isnan(found).all()


def test_odometry_in_another_frame_leads_through_gaps_and_a_little_beyond_the_ends():
    times_s = np.linspace(0.0, 60.0, 601)
    T_odom_map = np.array([[5.0, -3.0, 2.0]])
    odometry = Trajectory(times_s, composed(T_odom_map, drive(times_s)))
    own_s = np.array([10.0, 13.7, 50.0])
    lookup = PoseLookup(Trajectory(own_s, drive(own_s)), odometry)
    asked_s = np.array([8.5, 12.0, 30.0, 51.9])
    np.testing.assert_allclose(lookup.at(asked_s), drive(asked_s), atol=1e-9)
    # a trajectory that ends early must not be filled up by the wheels
    assert np.isnan(lookup.at([7.0, 53.0])).all()


def test_between_two_poses_the_error_of_the_wheels_is_shared_by_time():
    times_s = np.linspace(0.0, 10.0, 101)
    way = np.column_stack([times_s, np.zeros_like(times_s), np.zeros_like(times_s)])
    odometry = Trajectory(times_s, way * [1.1, 1.0, 1.0])
    lookup = PoseLookup(Trajectory(times_s[[0, -1]], way[[0, -1]]), odometry)
    np.testing.assert_allclose(lookup.at(times_s), way, atol=1e-12)


def test_stamps_may_go_back_and_the_later_line_of_one_counts():
    trajectory = Trajectory([0.0, 2.0, 1.0, 1.0], [[0, 0, 0], [2, 0, 0], [9, 0, 0], [1, 0, 0]])
    np.testing.assert_allclose(PoseLookup(trajectory).at([0.5, 1.0, 1.5])[:, 0], [0.5, 1.0, 1.5])


def test_empty_trajectory_and_gap_in_the_odometry_know_nothing():
    empty = Trajectory(np.empty(0), np.empty((0, 3)))
    assert np.isnan(PoseLookup(empty).at([1.0])).all()
    odometry = Trajectory([0.0, 100.0], np.zeros((2, 3)))
    lookup = PoseLookup(Trajectory([0.0, 100.0], np.zeros((2, 3))), odometry)
    assert np.isnan(lookup.at([50.0])).all()
    assert np.isnan(PoseLookup(lookup.trajectory, empty).at([50.0])).all()


@pytest.mark.parametrize(
    ("jump", "is_jumping"),
    [
        ((3000.0, -2000.0, 0.0), lambda t: t > 3.42),
        ((0.0, 0.0, np.pi / 2), lambda t: t > 3.42),
        ((5000.0, 0.0, 0.0), lambda t: (t > 3.42) & (t < 6.18)),
        ((5000.0, 0.0, 1.0), lambda t: np.abs(t - 3.5) < 0.01),
    ],
    ids=["set anew", "turned", "away for a while", "one line"],
)
def test_wheels_that_jump_between_two_poses_carry_nothing_away(jump, is_jumping):
    # the records of a log between scans lay up to kilometres off, on a good map
    times_s, asked_s = np.arange(10.0), np.arange(0.0, 9.05, 0.1)
    wheels = drive(asked_s)
    wheels[is_jumping(asked_s)] = composed(np.array([jump]), wheels)[is_jumping(asked_s)]
    lookup = PoseLookup(
        Trajectory(times_s, drive(times_s)), Trajectory(asked_s, wheels), max_gap_s=2.0
    )
    off = lookup.at(asked_s) - drive(asked_s)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.3
    assert np.abs(wrap_angle(off[:, 2])).max() < 0.3
    # everywhere but there as the wheels say
    assert np.median(np.hypot(off[:, 0], off[:, 1])) < 1e-9

"""SE(2) is a group, exp and log undo each other, and points move as matrices say."""

import copy
import math
import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from slam.se2 import SE2, wrap_angle

# Lengths of a building. 500 m are held to 1e-13 m; a few products may lose three digits of that.
LENGTH = st.floats(-500.0, 500.0)
ANGLE = st.floats(-10.0, 10.0)
POSE = st.builds(SE2, LENGTH, LENGTH, ANGLE)


def assert_same(a: SE2, b: SE2, tolerance: float = 1e-9) -> None:
    """Equal poses, headings compared on the circle."""
    assert math.hypot(a.x - b.x, a.y - b.y) <= tolerance
    assert abs(wrap_angle(a.theta - b.theta)) <= tolerance


@given(POSE, POSE, POSE)
def test_composition_is_associative(a, b, c):
    assert_same((a @ b) @ c, a @ (b @ c))


@given(POSE)
def test_identity_changes_nothing(a):
    assert_same(a @ SE2.identity(), a)
    assert_same(SE2.identity() @ a, a)


@given(POSE)
def test_inverse_undoes_the_pose_from_both_sides(a):
    assert_same(a @ a.inverse(), SE2.identity())
    assert_same(a.inverse() @ a, SE2.identity())


@given(POSE, POSE)
def test_a_pose_seen_from_another_is_the_way_back_and_there(a, b):
    assume(abs(a.theta) < math.pi)  # of which the way back has no sign of its own
    seen, way = a.between(b), a.inverse() @ b
    assert (seen.x, seen.y, seen.theta) == (way.x, way.y, way.theta)  # to the bit


@given(POSE, POSE)
def test_matrices_compose_as_poses_do(a, b):
    np.testing.assert_allclose((a @ b).matrix(), a.matrix() @ b.matrix(), atol=1e-9)


@given(POSE, POSE)
def test_composed_pose_moves_points_as_one_after_the_other(a, b):
    points = np.array([[0.0, 0.0], [1.0, 0.0], [-2.0, 3.0]])
    np.testing.assert_allclose((a @ b) @ points, a @ (b @ points), atol=1e-9)


@given(POSE)
def test_exp_of_log_is_the_pose(a):
    # near a half turn tan(theta / 2) is large: 1e-6 of 500 m is 1e-9 relative
    assert_same(SE2.exp(a.log()), a, 1e-6)


@given(LENGTH, LENGTH, st.floats(-3.1, 3.1))
def test_log_of_exp_is_the_twist(x, y, theta):
    np.testing.assert_allclose(SE2.exp([x, y, theta]).log(), [x, y, theta], atol=1e-6)


@pytest.mark.parametrize("theta", [9.9e-5, 1.01e-4, 1e-9, 0.0])
def test_exp_is_smooth_where_the_series_takes_over(theta):
    # the exact arc of radius 1 / theta; y = (1 - cos) / theta = 2 sin(theta / 2)**2 / theta
    exact_y = 2.0 * math.sin(theta / 2.0) ** 2 / theta if theta else 0.0
    assert SE2.exp([1.0, 0.0, theta]).y == pytest.approx(exact_y, abs=1e-12)


@given(POSE, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_adjoint_carries_a_twist_through_the_pose(a, x, y, theta):
    twist = np.array([x, y, theta])
    assert_same(a @ SE2.exp(twist) @ a.inverse(), SE2.exp(a.adjoint() @ twist), 1e-8)


@settings(max_examples=200)
@given(st.floats(-1e4, 1e4))
def test_wrapped_angle_lies_in_the_half_open_interval_and_is_the_same_direction(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert abs(math.sin(wrapped) - math.sin(angle)) < 1e-10
    assert wrap_angle(np.array([angle]))[0] == wrapped  # the array form to the bit


def test_half_a_turn_is_plus_pi_from_both_sides():
    assert SE2(0.0, 0.0, -math.pi).theta == math.pi
    assert SE2(0.0, 0.0, 3.0 * math.pi).theta == pytest.approx(math.pi)


def test_poses_are_near_by_distance_and_by_turn_across_the_seam():
    pose = SE2(1.0, 2.0, math.pi - 0.01)
    assert pose.is_near(SE2(1.03, 2.04, -math.pi + 0.01), 0.0501, 0.0201)
    assert not pose.is_near(SE2(1.03, 2.04, -math.pi + 0.01), 0.0499, 0.0201)
    assert not pose.is_near(SE2(1.03, 2.04, -math.pi + 0.01), 0.0501, 0.0199)


def test_points_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"\(N, 2\), not \(3,\)"):
        SE2.identity() @ np.zeros(3)
    with pytest.raises(ValueError, match=r"shape \(3,\), not \(2,\)"):
        SE2.from_array([1.0, 2.0])


def test_a_pose_is_kept_in_slots_and_stays_as_it_is():
    pose = SE2(np.float64(1.0), 2, 7.0)
    assert not hasattr(pose, "__dict__")  # coordinates are read a hundred times a scan
    assert type(pose.x) is type(pose.y) is type(pose.theta) is float
    assert pickle.loads(pickle.dumps(pose)) == copy.deepcopy(pose) == pose
    with pytest.raises(FrozenInstanceError):
        pose.x = 2.0

"""Errors of poses and trajectories, each beside a slow and obvious twin."""

import math

import numpy as np
import pytest

from slam.metrics import (
    Spread,
    absolute_errors,
    absolute_trajectory_error_m,
    index_pairs,
    pose_errors,
    relative_errors,
    time_pairs,
    way_pairs,
)
from slam.pose_arrays import composed
from slam.se2 import SE2


@pytest.fixture
def true() -> np.ndarray:
    """A hundred poses (N, 3), half a metre apart and turning."""
    return np.array([SE2.exp([0.5 * i, 0.0, 0.07 * i]).as_array() for i in range(100)])


@pytest.fixture
def estimated(true) -> np.ndarray:
    """The same with a drift, in another frame."""
    drift = np.cumsum(np.random.default_rng(5).normal(0.0, [0.02, 0.02, 0.002], true.shape), axis=0)
    return composed(np.array([4.0, -2.0, 1.1]), composed(true, drift))


def test_heading_error_across_the_half_turn_is_small():
    errors = pose_errors([[1.0, 2.0, 3.1]], [[0.5, 2.5, -3.1]])
    assert errors[0] == pytest.approx([0.5, -0.5, 6.2 - 2.0 * math.pi])


def test_alignment_removes_a_moved_frame_and_nothing_else():
    rng = np.random.default_rng(0)
    true = rng.uniform(-5.0, 5.0, (100, 3))
    moved = composed(SE2(3.0, -2.0, 1.0).as_array(), true)
    assert absolute_trajectory_error_m(moved, true) > 1.0
    assert absolute_trajectory_error_m(moved, true, is_aligned=True) == pytest.approx(0, abs=1e-12)
    errors = absolute_errors(moved, true)
    assert errors.heading_rad.max == pytest.approx(0.0, abs=1e-12)
    found = errors.T_true_estimated @ SE2(3.0, -2.0, 1.0)
    np.testing.assert_allclose(found.as_array(), 0.0, atol=1e-12)
    mirrored = true * [1.0, -1.0, 1.0]
    assert absolute_trajectory_error_m(mirrored, true, is_aligned=True) > 1.0


def test_alignment_is_the_rotation_that_the_singular_values_give(true, estimated):
    # Umeyama, PAMI 1991, without scale: the way that evo goes, in its own words
    x, y = estimated[:, :2], true[:, :2]
    u, _, vt = np.linalg.svd((y - y.mean(0)).T @ (x - x.mean(0)))
    turn = u @ np.diag([1.0, np.linalg.det(u @ vt)]) @ vt
    off_m = np.linalg.norm((x - x.mean(0)) @ turn.T + y.mean(0) - y, axis=1)
    found = absolute_errors(estimated, true).position_m
    assert found.rmse == pytest.approx(math.sqrt(np.mean(off_m**2)), rel=1e-9)
    assert (found.median, found.max) == pytest.approx((np.median(off_m), off_m.max()), rel=1e-9)


@pytest.mark.parametrize("is_overlapping", [True, False])
def test_relative_error_is_that_of_the_motions_one_by_one(true, estimated, is_overlapping):
    pairs = way_pairs(true, 5.0, is_overlapping)
    found = relative_errors(estimated, true, pairs)
    lengths, turns = [], []
    for first, second in pairs:
        (A, B), (C, D) = (
            [SE2.from_array(poses[i]) for i in (first, second)] for poses in (true, estimated)
        )
        off = (A.inverse() @ B).inverse() @ (C.inverse() @ D)
        lengths.append(math.hypot(off.x, off.y))
        turns.append(abs(off.theta))
    for spread, errors in ((found.translation_m, lengths), (found.rotation_rad, turns)):
        assert spread.count == len(pairs)
        assert spread.mean == pytest.approx(sum(errors) / len(errors))
        assert spread.rmse == pytest.approx(math.sqrt(sum(e**2 for e in errors) / len(errors)))
        assert spread.std == pytest.approx(math.sqrt(spread.rmse**2 - spread.mean**2))
        assert spread.max == pytest.approx(max(errors))


def test_relative_error_does_not_know_the_frame(true, estimated):
    moved = composed(SE2(-7.0, 1.0, 2.0).as_array(), estimated)
    pairs = index_pairs(len(true), 10)
    assert relative_errors(moved, true, pairs).translation_m.rmse == pytest.approx(
        relative_errors(estimated, true, pairs).translation_m.rmse
    )


def test_pairs_over_poses_time_and_way_end_where_the_delta_is_reached():
    assert index_pairs(5, 2).tolist() == [[0, 2], [1, 3], [2, 4]]
    assert index_pairs(5, 2, is_overlapping=False).tolist() == [[0, 2], [2, 4]]
    assert time_pairs([0.0, 1.0, 1.5, 4.0], 1.5).tolist() == [[0, 2], [1, 3], [2, 3]]
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]], dtype=float)
    # along the way, not across: the end lies on the start
    assert way_pairs(square, 4.0).tolist() == [[0, 4]]
    assert way_pairs(square * 0.1, 0.1).tolist() == [[0, 1], [1, 2], [2, 3], [3, 4]]
    # the nearest within a tenth; not overlapping, the first that is as far or farther
    assert way_pairs(square * 0.97, 2.0).tolist() == [[0, 2], [1, 3], [2, 4]]
    assert way_pairs(square * 0.97, 1.5).tolist() == []
    assert way_pairs(square * 0.97, 2.0, is_overlapping=False).tolist() == [[0, 3]]
    assert way_pairs(square[:1], 1.0).tolist() == []
    assert way_pairs(square[:0], 1.0).tolist() == []


def test_pairs_farther_apart_than_all_poses_are_none():
    assert (
        len(index_pairs(5, 5))
        == len(index_pairs(0, 1))
        == len(way_pairs(np.zeros((3, 3)), 1.0))
        == 0
    )
    nothing = relative_errors(np.zeros((2, 3)), np.zeros((2, 3)), index_pairs(2, 2, False))
    assert nothing.translation_m.count == 0
    assert math.isnan(nothing.translation_m.mean)


def test_delta_that_is_none_and_times_that_go_back_are_refused():
    with pytest.raises(ValueError, match="delta above 0, not 0"):
        index_pairs(5, 0)
    with pytest.raises(ValueError, match="times that do not go back"):
        time_pairs([1.0, 0.0], 1.0)


def test_rows_must_belong_together():
    with pytest.raises(ValueError, match="true must have shape"):
        pose_errors(np.zeros((3, 3)), np.zeros((2, 3)))


def test_spread_takes_errors_without_their_sign():
    spread = Spread.of([-1.0, 1.0, 3.0, -3.0])
    assert (spread.mean, spread.std, spread.median, spread.max) == (2.0, 1.0, 2.0, 3.0)
    assert spread.rmse == pytest.approx(math.sqrt(5.0))
    assert spread.scaled(10.0).mean == 20.0

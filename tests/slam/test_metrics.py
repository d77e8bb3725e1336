"""Errors of poses and trajectories."""

import math

import numpy as np
import pytest

from slam.metrics import absolute_trajectory_error_m, pose_errors
from slam.se2 import SE2


def test_heading_error_across_the_half_turn_is_small():
    errors = pose_errors([[1.0, 2.0, 3.1]], [[0.5, 2.5, -3.1]])
    assert errors[0] == pytest.approx([0.5, -0.5, 6.2 - 2.0 * math.pi])


def test_alignment_removes_a_moved_frame_and_nothing_else():
    rng = np.random.default_rng(0)
    true = rng.uniform(-5.0, 5.0, (100, 3))
    moved = np.column_stack([SE2(3.0, -2.0, 1.0) @ true[:, :2], true[:, 2]])
    assert absolute_trajectory_error_m(moved, true) > 1.0
    assert absolute_trajectory_error_m(moved, true, is_aligned=True) == pytest.approx(0, abs=1e-12)
    mirrored = true * [1.0, -1.0, 1.0]
    assert absolute_trajectory_error_m(mirrored, true, is_aligned=True) > 1.0


def test_rows_must_belong_together():
    with pytest.raises(ValueError, match="true must have shape"):
        pose_errors(np.zeros((3, 3)), np.zeros((2, 3)))

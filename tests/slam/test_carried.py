"""Scans placed by the wheels between two that see: as least squares over the whole way places them."""

import numpy as np
import pytest

from slam import SE2
from slam.carried import Carried
from slam.odometry import compose_covariance
from slam.pose_graph import PoseGraph

STEP = SE2(0.3, 0.0, 0.12)
NOISE = np.diag([4e-4, 1e-4, 9e-4])


def carried(count: int) -> tuple[Carried, SE2]:
    """A run of so many steps, ended by one more; and where that one is by the wheels."""
    run, T, covariance = Carried(), SE2(1.0, 2.0, 0.5), np.zeros((3, 3))
    for number in range(count):
        T, covariance = T @ STEP, compose_covariance(covariance, STEP, NOISE)
        run.add(number, T, covariance)
    run.end(T @ STEP, compose_covariance(covariance, STEP, NOISE))
    return run, T @ STEP


@pytest.mark.parametrize("off", [SE2(0.1, 0.05, 0.06), SE2(-0.2, 0.1, -0.1)])
def test_smoothed_poses_are_those_of_least_squares(off):
    run, T_predicted = carried(8)
    T_seen = T_predicted @ off
    graph = PoseGraph()
    start = SE2(1.0, 2.0, 0.5)
    poses = [start]
    for _ in range(9):
        poses.append(poses[-1] @ STEP)
    for number, pose in enumerate(poses):
        is_end = number in (0, 9)
        graph.add_node(T_seen if number == 9 else pose, is_fixed=is_end)
    for number in range(9):
        graph.add_edge(number, number + 1, STEP, np.linalg.inv(NOISE))
    best = graph.solve().poses[1:9]
    found = np.array([pose.as_array() for pose in run.runs[0].smoothed(T_seen)])
    by_wheels = np.array([pose.as_array() for pose in poses[1:9]])
    assert np.abs(by_wheels - best).max() > 0.05
    # both are the same to first order
    np.testing.assert_allclose(found, best, atol=0.006)


def test_wheels_that_led_right_are_left_alone():
    run, T_predicted = carried(5)
    (one,) = run.runs
    for pose, (placed, _) in zip(one.smoothed(T_predicted), one.placed, strict=True):
        assert pose.is_near(placed, 1e-12, 1e-12)


def test_runs_begin_with_the_first_scan_that_saw_nothing_and_end_with_one_that_sees():
    run, _ = carried(3)
    run.end(SE2.identity(), NOISE)  # one that sees after one that sees ends nothing
    run.add(7, STEP, NOISE)
    run.end(STEP @ STEP, 2.0 * NOISE)
    run.add(9, STEP, NOISE)  # not ended: nobody knows where the wheels led
    assert [(one.first, len(one.placed)) for one in run.runs] == [(0, 3), (7, 1)]

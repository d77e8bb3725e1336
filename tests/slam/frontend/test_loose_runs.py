"""Scans between two that see: as least squares over the whole way places them."""

import numpy as np
import pytest

from slam import SE2
from slam.frontend.loose_runs import LooseRuns
from slam.odometry import compose_covariance
from slam.pose_graph import PoseGraph

START = SE2(1.0, 2.0, 0.5)
STEP = SE2(0.3, 0.0, 0.12)
NOISE = np.diag([4e-4, 1e-4, 9e-4])
TRUST = 20.0
ACROSS = np.diag([1e-6, 1e4, 1e4])  # information of a scan between two walls


def loose(count: int, seen: np.ndarray | None = None) -> tuple[LooseRuns, SE2]:
    """A run of so many steps, ended by one more, of scans that tell so much (3, 3) of where they were
    taken; and where the wheels lead at the end."""
    runs, T, covariance = LooseRuns(), START, np.zeros((3, 3))
    for number in range(count + 1):
        T, covariance = T @ STEP, compose_covariance(covariance, STEP, NOISE)
        runs.lead_to(T, covariance, covariance, TRUST)
        if number == count:
            break
        if seen is not None:
            covariance = np.linalg.inv(np.linalg.inv(covariance) + seen)
        runs.add(number, T, covariance)
    runs.end()
    return runs, T


@pytest.mark.parametrize("seen", [None, ACROSS])
@pytest.mark.parametrize("off", [SE2(0.1, 0.05, 0.06), SE2(-0.2, 0.1, -0.1)])
def test_smoothed_poses_are_those_of_least_squares(off, seen):
    runs, T_predicted = loose(8, seen)
    T_seen = T_predicted @ off
    graph, poses = PoseGraph(), [START]
    for _ in range(9):
        poses.append(poses[-1] @ STEP)
    for number, pose in enumerate(poses):
        graph.add_node(T_seen if number == 9 else pose, is_fixed=number in (0, 9))
    for number in range(9):
        graph.add_edge(number, number + 1, STEP, np.linalg.inv(NOISE))
        if seen is not None and number < 8:
            graph.add_edge(0, number + 1, START.inverse() @ poses[number + 1], seen)
    best = graph.solve().poses[1:9]
    found = np.array([pose.as_array() for pose in runs.ended[0].smoothed(T_seen)])
    by_wheels = np.array([pose.as_array() for pose in poses[1:9]])
    assert np.abs(by_wheels - best).max() > 0.05
    # both are the same to first order
    np.testing.assert_allclose(found, best, atol=0.01)


@pytest.mark.parametrize("seen", [None, ACROSS])
def test_wheels_that_led_right_are_left_alone(seen):
    runs, T_predicted = loose(5, seen)
    (one,) = runs.ended
    for pose, scan in zip(one.smoothed(T_predicted), one.scans, strict=True):
        assert pose.is_near(scan.T_map_base, 1e-12, 1e-12)


def test_runs_begin_with_the_first_scan_that_is_loose_and_end_with_one_that_is_not():
    runs, _ = loose(3)
    runs.lead_to(SE2.identity(), NOISE, NOISE, TRUST)
    runs.end()  # one that sees after one that sees ends nothing
    runs.add(7, STEP, NOISE)
    runs.lead_to(STEP @ STEP, 2.0 * NOISE, NOISE, TRUST)
    runs.end()
    runs.add(9, STEP, NOISE)  # not ended: nobody knows where the wheels led
    assert [(one.first, len(one.scans)) for one in runs.ended] == [(0, 3), (7, 1)]


@pytest.mark.parametrize(("off_m", "is_spread"), [(0.05, True), (3.0, False)])
def test_after_a_break_the_wheels_are_believed_where_they_led_to_what_was_seen(off_m, is_spread):
    """Where scans broke off, wheels may be wrong by anything: but not those of a laser that froze."""
    runs, T, covariance = LooseRuns(), START, np.zeros((3, 3))
    for number in range(5):
        T, covariance = T @ STEP, compose_covariance(covariance, STEP, NOISE)
        runs.lead_to(T, covariance, covariance + (number == 4) * np.diag([25.0, 25.0, 1.0]), TRUST)
        runs.add(number, T, covariance)
    runs.end()
    (run,) = runs.ended
    T_seen = T @ SE2(off_m, 0.0, 0.0)
    moved = run.smoothed(T_seen)[-1]
    assert run.scans[-1].T_map_base.is_near(moved, 0.02, 0.02) != is_spread
    assert moved.is_near(T_seen @ STEP.inverse(), 0.02, 0.02) == is_spread

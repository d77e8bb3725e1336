"""Scans alone: a robot is looked for where it goes on as it did before."""

import math
from dataclasses import replace

import numpy as np
import pytest

from slam.frontend.constant_velocity import ConstantVelocity
from slam.frontend.front_end import FrontEnd
from slam.frontend.keyframes import StepStatus
from slam.measurements import LaserScan, Measurement
from slam.se2 import SE2
from tests.slam.synthetic import box, room, scan_of

UNMEASURED = np.eye(3)
STEP_M = 0.15
# things to see at the beginning, then bare walls
WALLS = np.concatenate(
    [
        room(-3.0, -1.2, 60.0, 1.2),
        *(box(x, 0.8, x + 0.4, 1.2) for x in (-2.0, 0.5, 2.5, 4.5, 6.0)),
        *(box(x, -1.2, x + 0.5, -0.7) for x in (-1.0, 1.5, 3.5, 5.5)),
    ]
)


def placed(xs, *, interval_s=0.3, covariance=UNMEASURED, blind=()):
    """Where scans at these x are placed, of which those in blind see nothing, and how."""
    rng, front_end = np.random.default_rng(0), FrontEnd(SE2.identity())
    steps = []
    for k, x in enumerate(xs):
        scan = scan_of(WALLS, SE2(x, 0.0, 0.0), rng, 0.01, range_max_m=5.0)
        if k in blind:
            scan = LaserScan(0.0, scan.angles_rad, np.full(len(scan.angles_rad), np.inf))
        measurement = Measurement(interval_s * k, SE2.identity(), scan, covariance)
        steps.append(front_end.update(measurement))
    return np.array([step.T_map_base.x for step in steps]), steps


def test_robot_goes_on_between_walls_that_look_the_same():
    xs = np.arange(0.0, 18.0, STEP_M)
    found, steps = placed(xs)
    assert any(step.is_open for step in steps)
    assert np.abs(found - xs).max() < 0.5  # of 6 m and more that no scan tells


def test_wheels_that_say_it_stands_are_believed():
    xs = np.concatenate([np.arange(0.0, 9.0, STEP_M), np.full(40, 9.0)])
    covariance = np.diag([0.01, 0.01, 0.01]) ** 2
    told, _ = placed(xs[-40:], covariance=covariance)
    assert np.ptp(told) < 0.05


def test_whom_no_scan_sees_is_not_taken_to_go_on():
    xs = np.concatenate([np.arange(0.0, 3.0, STEP_M), np.full(20, 3.0)])
    found, steps = placed(xs, blind=range(20, 35))
    assert {step.status for step in steps[20:35]} == {StepStatus.CARRIED}
    assert found[34] - found[19] == pytest.approx(STEP_M, abs=0.03)
    assert found[-1] == pytest.approx(3.0, abs=0.05)


def test_robot_that_ends_a_turn_is_looked_for_where_it_was_as_well():
    rng, front_end = np.random.default_rng(0), FrontEnd(SE2.identity())
    headings = np.concatenate([np.arange(0.0, 2.0, 0.35), np.full(6, 1.75)])
    for k, heading in enumerate(headings):
        scan = scan_of(WALLS, SE2(3.0, 0.0, heading), rng, 0.01, range_max_m=5.0)
        measurement = Measurement(0.3 * k, SE2.identity(), scan, UNMEASURED)
        found = front_end.update(measurement).T_map_base
        assert found.is_near(SE2(0.0, 0.0, heading), 0.03, 0.01)


@pytest.mark.parametrize(
    ("interval_s", "off_m", "status"),
    [
        # offices without wheels: 0.83 m beside where it went on to, 0.05 better, and four scans stayed
        (0.3, 0.83, StepStatus.MATCHED),
        (0.3, 0.3, StepStatus.SEARCHED),
        # of a scan each three seconds, fr101, a robot that drives off is there
        (3.0, 0.83, StepStatus.SEARCHED),
    ],
)
def test_robot_does_not_go_five_times_as_far_at_once(monkeypatch, interval_s, off_m, status):
    rng, front_end = np.random.default_rng(0), FrontEnd(SE2.identity())
    match = front_end._window.surfaces.match

    def badly(*args, **kwargs):
        return replace(match(*args, **kwargs), inlier_ratio=0.8, cost=0.25)

    def around(points, told, usual):
        found = badly(points, told.T_map_base, told.T_map_base, told.odometry)
        off = SE2(off_m, 0.0, 0.0)
        return replace(found, T_map_base=told.T_map_base @ off, inlier_ratio=0.9, cost=0.2)

    for k in range(8):
        if k == 7:
            monkeypatch.setattr(front_end._window.surfaces, "match", badly)
            monkeypatch.setattr(front_end._placing.candidates, "around", around)
        scan = scan_of(WALLS, SE2(STEP_M * k, 0.0, 0.0), rng, 0.01, range_max_m=5.0)
        step = front_end.update(Measurement(interval_s * k, SE2.identity(), scan, UNMEASURED))
    assert step.status is status


def test_that_a_robot_goes_on_proves_nothing_of_where_it_is():
    front_end, rng = FrontEnd(SE2.identity()), np.random.default_rng(0)
    bare = room(-30.0, -1.2, 60.0, 1.2)
    for k in range(8):
        scan = scan_of(bare, SE2(STEP_M * k, 0.0, 0.0), rng, 0.01, range_max_m=5.0)
        front_end.update(Measurement(0.3 * k, SE2.identity(), scan, UNMEASURED))
    assert front_end.keyframes[-1].covariance[0, 0] > 0.9


def test_one_scan_drawn_aside_does_not_lead_the_robot_on():
    # offices with people: 0.3 m back at once, and as much again at each of ten scans between bare walls
    velocity = ConstantVelocity()
    for moved in (SE2(0.1, 0.0, 0.0), SE2(0.1, 0.0, 0.0), SE2(-0.3, 0.0, 0.0)):
        velocity.take(SE2.identity(), moved, 0.3)
    assert velocity.motion(0.3).is_near(SE2(0.1, 0.0, 0.0), 1e-9, 1e-9)


def test_a_robot_goes_on_as_seen_from_where_it_was():
    velocity, T_before = ConstantVelocity(), SE2(3.0, -1.0, 2.0)
    velocity.take(T_before, T_before @ SE2(0.1, 0.0, 0.02), 0.3)
    assert velocity.motion(0.3).is_near(SE2(0.1, 0.0, 0.02), 1e-9, 1e-9)


def test_a_robot_turns_on_as_it_did_last():
    velocity = ConstantVelocity()
    for theta in (0.0, 0.0, 0.2):
        velocity.take(SE2.identity(), SE2(0.0, 0.0, theta), 0.5)
    assert velocity.motion(0.5).theta == pytest.approx(0.2)
    assert velocity.motion(0.25).theta == pytest.approx(0.1)


def test_nobody_knows_how_a_robot_goes_on_after_long_or_unseen():
    velocity = ConstantVelocity()
    assert velocity.motion(0.3) is None
    velocity.take(SE2.identity(), SE2(0.1, 0.0, 0.0), 0.3)
    assert velocity.motion(0.6) is None
    assert velocity.motion(-0.1) is None
    velocity.take(SE2.identity(), SE2(0.1, 0.0, 0.0), math.inf)  # the first scan of a log
    assert velocity.motion(0.3) is None
    velocity.take(SE2.identity(), SE2(0.1, 0.0, 0.0), 0.3)
    velocity.stop()
    assert velocity.motion(0.3) is None

"""Faults that no single scan shows: a slow robot's frozen laser, a lookalike, wheels told in parts."""

import math
from dataclasses import replace

import numpy as np
import pytest

from slam import SE2, Measurement, Status
from tests.slam.guarded import LASER, START, STILL, Robot, made
from tests.slam.synthetic import ROOM_SEGMENTS, box, legs, scan_of
from tests.slam.synthetic import room as walls_around


@pytest.fixture(scope="module")
def room():
    return made(ROOM_SEGMENTS)


def frozen_scans(robot):
    """The same scan again and again, but for a millimetre."""
    scan = scan_of(robot.segments, robot.at @ LASER, robot.rng, 0.01)
    while True:
        noise_m = robot.rng.normal(0.0, 0.001, len(scan.ranges_m))
        yield replace(scan, ranges_m=scan.ranges_m + noise_m)


@pytest.mark.parametrize(
    "step",
    [SE2(0.004, 0.0, 0.0), SE2(0.02, 0.0, 0.0), SE2(0.0, 0.0, math.radians(0.3))],
    ids=["slow", "fast", "turning"],
)
def test_laser_that_freezes_but_for_its_noise_is_found_however_slow_the_robot(room, step):
    robot = Robot(room, START)
    robot.look()
    scans = frozen_scans(robot)
    for _ in range(60):
        estimate = robot.look(step, scan=next(scans))
        if estimate.verdict.status is Status.TRACKING:
            off = robot.at.inverse() @ estimate.T_map_base
            assert math.hypot(off.x, off.y) < 0.1
            assert abs(off.theta) < math.radians(5.0)
    assert estimate.verdict.status is Status.UNSURE


def test_wheels_that_are_told_of_between_scans_are_told_of(room):
    robot = Robot(room, START)
    robot.look()
    half, noise, statuses = SE2(0.01, 0.0, 0.0), np.diag([1e-6] * 3), []
    for _ in range(15):
        # the wheels spin in the air
        robot.time_s += 0.05
        robot.localizer.move(robot.time_s, half, noise)
        robot.time_s += 0.05
        scan = scan_of(robot.segments, robot.at @ LASER, robot.rng, 0.01)
        told = Measurement(robot.time_s, half, scan, noise)
        statuses.append(robot.localizer.update(told).verdict.status)
    assert set(statuses[4:]) == {Status.UNSURE}


def test_driving_on_with_wheels_told_of_between_scans_is_tracking(room):
    robot = Robot(room, START)
    half, noise = SE2(0.01, 0.0, 0.01), np.diag([1e-6] * 3)
    for _ in range(20):
        robot.time_s += 0.05
        robot.localizer.move(robot.time_s, half, noise)
        robot.at = robot.at @ half
        estimate = robot.look(half)
        assert estimate.verdict.status is Status.TRACKING
        assert robot.is_right(estimate)


@pytest.mark.parametrize(
    ("x", "y", "theta"),
    [(0.5, 0.2, 1.0), pytest.param(-0.6, -0.3, 0.2, marks=pytest.mark.slow)],
)
def test_where_no_single_scan_tells_several_together_do(x, y, theta):
    # a room that looks the same from either end but for a post of 5 cm at its wall
    post = box(0.875, 1.45, 0.925, 1.5)
    twin = made(np.concatenate([walls_around(-2.0, -1.5, 2.0, 1.5), post]))
    robot = Robot(twin, SE2(-x, -y, theta + math.pi), at=SE2(x, y, theta))
    statuses = []
    for _ in range(40):
        estimate = robot.look(SE2(0.01, 0.0, 0.08))
        statuses.append(estimate.verdict.status)
    # it once went on, sure of the wrong end, for 20 scans and 63
    assert Status.LOST in statuses[:15]
    assert statuses[-1] is Status.TRACKING
    assert robot.is_right(estimate)


def test_stamps_that_go_back_give_no_time_below_nothing(room):
    robot = Robot(room, None)
    robot.time_s = 10.0
    first = robot.look(STILL, scan=replace(scan_of(ROOM_SEGMENTS, LASER), ranges_m=np.zeros(481)))
    assert first.verdict.status is Status.UNSURE
    robot.time_s = 5.0
    assert robot.look().verdict.recovery_s == 0.0


def reasons_on_the_way(room, *, away_m, sector=None, legs_at=None):
    """What is said along 20 steps in a curve, the beams of a sector ended near by, or before legs."""
    robot = Robot(room, START)
    stand = np.empty((0, 2, 2)) if legs_at is None else legs(START @ LASER, [legs_at], away_m)
    said = []
    for _ in range(20):
        robot.at = robot.at @ SE2(0.02, 0.0, 0.05)
        walls = np.concatenate([robot.segments, stand])
        scan = scan_of(walls, robot.at @ LASER, robot.rng, 0.01)
        ranges_m = scan.ranges_m.copy()
        if sector is not None:
            ranges_m[sector] = away_m + robot.rng.normal(0.0, 0.003, len(ranges_m[sector]))
        robot.at = robot.at @ SE2(0.02, 0.0, 0.05).inverse()
        estimate = robot.look(SE2(0.02, 0.0, 0.05), scan=replace(scan, ranges_m=ranges_m))
        assert robot.is_right(estimate)
        said.append(" ".join(estimate.verdict.reasons))
    return said


@pytest.mark.parametrize(
    ("first", "beams", "away_m"), [(100, 144, 0.25), (300, 60, 0.4), (300, 60, -np.inf)]
)
def test_what_hides_a_part_of_the_view_wherever_the_robot_goes_is_named(room, first, beams, away_m):
    said = reasons_on_the_way(room, away_m=away_m, sector=slice(first, first + beams))
    assert f"{beams} of 481 beams end within 0.5 m at what moves along" in said[-1]


@pytest.mark.parametrize("bearing", [0.0, -1.2])
def test_somebody_who_stands_close_does_not_move_along(room, bearing):
    said = reasons_on_the_way(room, away_m=0.45, legs_at=bearing)
    assert not any("moves along" in reasons for reasons in said)

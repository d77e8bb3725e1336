"""The way by wheels and by scans: noise, lags, other units, and what scans left out."""

import math

import numpy as np
import pytest

from slam.frontend.keyframes import FrontEndStep, StepStatus
from slam.map_checks.compared_ways import ComparedWays
from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.se2 import SE2
from tests.slam.corridors import WALLS, mapped
from tests.slam.synthetic import box, scan_of

STEP_M, TOLD_M2 = 0.3, 0.05**2 * 0.3


def compared(by_wheels_m, by_scans_m, is_open=None) -> ComparedWays:
    """After a straight way; scans one after the other, each 0.5 s."""
    ways, x = ComparedWays(), 0.0
    opens = [False] * len(by_wheels_m) if is_open is None else is_open
    for k, (wheels_m, scans_m, is_one) in enumerate(
        zip(by_wheels_m, by_scans_m, opens, strict=True)
    ):
        x += scans_m
        T = SE2(x, 0.0, 0.0)
        step = FrontEndStep(0.5 * k, 0, T, T, StepStatus.MATCHED, 0.9, True, is_open=is_one)
        ways.take(SE2(wheels_m, 0.0, 0.0), TOLD_M2, SE2(scans_m, 0.0, 0.0), step)
    return ways


@pytest.mark.parametrize("scale", [0.9, 1.0, 1.1])
@pytest.mark.parametrize("times", [0.5, 1.0, 2.0])
def test_noise_is_what_scans_show_of_it_whatever_the_scale(scale, times):
    rng, count = np.random.default_rng(0), 4000
    sigma_m = times * math.sqrt(TOLD_M2 + 0.01**2)
    by_wheels_m = STEP_M + rng.normal(0.0, sigma_m, count)
    ways = compared(by_wheels_m, np.full(count, scale * STEP_M))
    assert ways.noise_ratio == pytest.approx(times * scale, rel=0.1)
    assert not ways.objections()


def test_noise_of_a_short_way_is_not_known():
    assert ComparedWays().noise_ratio is None
    assert compared([STEP_M] * 20, [0.5 * STEP_M] * 20).noise_ratio is None


@pytest.mark.parametrize("lever_m", [0.3, 1.0])
def test_turns_that_swing_an_untold_laser_are_no_way(lever_m):
    # aces with its laser 0.3 m ahead: 2.3 m by the wheels while the robot turned, and none by scans
    ways, step = (
        ComparedWays(),
        FrontEndStep(0.0, 0, SE2.identity(), SE2.identity(), StepStatus.MATCHED, 0.9, True),
    )
    for told in [SE2(STEP_M, 0.0, 0.0)] * 120 + [SE2(0.05 * lever_m, -0.3 * lever_m, 0.3)] * 40:
        by_scan = told if told.theta == 0.0 else SE2(0.0, 0.0, 0.3)
        ways.take(told, TOLD_M2, by_scan, step)
    assert bool(ways.objections()) is (lever_m > 0.5)


def test_wheels_that_tell_the_heading_more_often_than_the_way_are_no_other_units():
    # of a gyro at each scan, and the way at each second one: 32 m by the wheels, and 18 by scans
    ways, step = (
        ComparedWays(),
        FrontEndStep(0.0, 0, SE2.identity(), SE2.identity(), StepStatus.MATCHED, 0.9, True),
    )
    for k in range(200):
        told = SE2(2.0 * STEP_M if k % 2 else 0.0, 0.0, 0.001 * (-1.0) ** (k // 2))
        ways.take(told, TOLD_M2, SE2(STEP_M, 0.0, 0.0), step)
    assert not ways.objections()


def test_what_scans_leave_open_says_nothing_nor_does_the_first_scan_after_it():
    by_scans_m = [STEP_M] * 300
    is_open = [k % 30 in (10, 11, 12) for k in range(300)]
    for k in range(0, 300, 30):
        by_scans_m[k + 13] = 3.0  # all that the wheels were off between the walls, at once
    ways = compared([STEP_M] * 300, by_scans_m, is_open)
    assert ways.noise_ratio == pytest.approx(0.0, abs=1e-9)
    assert not ways.objections()


@pytest.mark.parametrize("scans", [2, 3, 4])
def test_odometry_slower_than_the_laser_is_of_the_same_way(scans):
    # scans are drawn along with it: half the way as it is told, half before
    by_wheels_m = [scans * STEP_M if k % scans == 0 else 0.0 for k in range(400)]
    by_scans_m = [0.5 * one + 0.5 * STEP_M for one in by_wheels_m]
    ways = compared(by_wheels_m, by_scans_m)
    assert not ways.objections()
    assert ways.noise_ratio < 1.0


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_other_units_are_told(scale):
    (said,) = compared([STEP_M] * 100, [scale * STEP_M] * 100).objections()
    assert "may be in other units" in said
    assert not compared([STEP_M] * 100, [0.9 * STEP_M] * 100).objections()


@pytest.mark.parametrize(("missing_m", "is_told"), [(0.9, False), (3.0, True), (6.0, True)])
def test_way_that_scans_left_out_is_told(missing_m, is_told):
    way = [STEP_M] * 200
    way[100 : 100 + round(missing_m / STEP_M)] = [0.0] * round(missing_m / STEP_M)
    said = compared([STEP_M] * 200, way).objections()
    assert len(said) == is_told
    if is_told:
        assert "the wheels spun, or somebody walked ahead" in said[0]
        assert said[0].startswith("from 49.") or said[0].startswith("from 50.")


@pytest.mark.parametrize("is_followed", [False, True])
def test_somebody_walks_ahead_through_a_bare_corridor(is_followed):
    """Scans would hold on to whoever is in front, at one distance all along; wheels deny it."""
    low = [[0, -3], [12, -3], [12, -1.1], [18, -1.1], [18, -3], [30, -3]]
    outline = np.array([*low, *([x, -y] for x, y in low[::-1])], dtype=float)
    walls = [np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)]
    corners = ((4.0, 2.0), (7.0, -2.4), (10.0, 1.8), (21.0, -2.0), (25.0, 2.0))
    walls = np.concatenate([*walls, *(box(x, y, x + 0.6, y + 0.4) for x, y in corners)])
    rng, mapper = np.random.default_rng(0), Mapper(SE2.identity())
    angles_rad = np.radians(np.arange(-135.0, 135.5, 1.0))
    for k, x in enumerate(np.arange(2.0, 28.0, 0.2)):
        pose = SE2(x, 0.0, 0.0)
        seen = walls
        if is_followed and 10.5 < x < 19.0:
            seen = np.concatenate([walls, box(x + 1.0, -0.2, x + 1.25, 0.2)])
        scan = scan_of(seen, pose, rng, 0.01, angles_rad, 10.0)
        by_wheels = SE2(0.2 * 1.01 + rng.normal(0.0, 0.002), 0.0, 0.0) if k else SE2.identity()
        mapper.update(Measurement(0.4 * k, by_wheels, scan, np.diag([0.02, 0.01, 0.01]) ** 2))
    slam_map = mapper.finish()
    assert slam_map.verdict.is_good, slam_map.verdict.reasons
    gone_m = slam_map.trajectory.poses[:, 0] - slam_map.trajectory.poses[0, 0]
    assert np.abs(gone_m - 0.2 * np.arange(len(gone_m))).max() < 0.05


def test_a_cart_pushed_ahead_from_the_first_scan_on_is_no_scale_of_the_wheels():
    # between bare walls scans go nowhere, all along: 14 m off, and good
    slam_map, off_m = mapped(
        np.arange(0.0, 14.0, 0.25),
        np.array([0.0] + [0.25] * 55),
        0.01,
        lambda x: np.concatenate([WALLS, box(x + 0.7, -0.4, x + 0.9, 0.4)]),
    )
    assert off_m < 0.3 or "the wheels spun" in slam_map.verdict.reasons[0]


@pytest.mark.parametrize(("scale", "is_told"), [(0.6, False), (0.35, False), (0.05, True)])
def test_wheels_of_another_scale_are_right_and_those_that_tell_of_no_way_are_not(scale, is_told):
    way = [STEP_M] * round(18.0 / STEP_M)
    said = compared(way, [scale * step for step in way]).objections()
    assert bool(said) is is_told

"""Walls that look the same all along: how far wheels may be off there is told by what they are
elsewhere."""

import math
from dataclasses import replace

import numpy as np
import pytest

from slam.frontend.told_steps import ToldStep
from slam.map_checks.open_ways import _told
from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.metrics import absolute_errors
from slam.se2 import SE2
from tests.slam.synthetic import box, room, scan_of

# 44 m of bare walls between two ends with things to see
WALLS = np.concatenate(
    [
        room(0.0, -1.2, 60.0, 1.2),
        *(box(x, 0.9, x + 0.5, 1.2) for x in (1.5, 3.5, 6.0, 54.0, 56.5, 58.0)),
        *(box(x, -1.2, x + 0.4, -0.8) for x in (2.5, 5.0, 7.0, 53.0, 55.5, 57.5)),
    ]
)


def mapped(walls: np.ndarray, poses: list[SE2], noise_m: float, scale: float, seed: int):
    """The map of a drive with 8 m of sight, by wheels that are told to be off by 0.05 m after a metre,
    and are by noise_m; and how far it is off [m]."""
    rng, mapper = np.random.default_rng(seed), Mapper(SE2.identity())
    for k, pose in enumerate(poses):
        step = poses[max(k - 1, 0)].inverse() @ pose
        way_m = math.hypot(step.x, step.y)
        told = np.diag([0.05**2 * way_m, 0.05**2 * way_m, 1e-4])
        by_wheels = SE2(scale * step.x, step.y, step.theta)
        by_wheels = by_wheels @ SE2(noise_m * math.sqrt(way_m) * rng.normal(), 0.0, 0.0)
        scan = scan_of(walls, pose, rng, 0.01, range_max_m=8.0)
        mapper.update(Measurement(0.8 * k, by_wheels, scan, told))
    slam_map, true = mapper.finish(), np.array([pose.as_array() for pose in poses])
    return slam_map, absolute_errors(slam_map.trajectory.poses, true).position_m.rmse


@pytest.mark.parametrize(("noise_m", "is_good"), [(0.01, True), (0.1, False)])
def test_map_between_bare_walls_is_as_good_as_its_wheels(noise_m, is_good):
    xs = np.arange(1.0, 59.0, 0.4)
    poses = [SE2(x, 0.0, 0.0) for x in xs]
    poses += [SE2(xs[-1], 0.0, theta) for theta in np.linspace(0.3, math.pi, 10)]
    poses += [SE2(x, 0.0, math.pi) for x in xs[::-1]]
    slam_map, off_m = mapped(WALLS, poses, noise_m, 1.0, seed=3)
    assert (off_m < 0.15) is is_good
    assert slam_map.verdict.is_good is is_good, (off_m, slam_map.verdict.reasons)
    if not is_good:
        said = "how far the robot went between them the wheels alone tell"
        assert any(said in reason for reason in slam_map.verdict.reasons)


@pytest.mark.parametrize(("scale", "is_good"), [(1.0, True), (0.8, False)])
def test_short_way_by_wheels_that_deny_each_scan_is_not_known(scale, is_good):
    """15 m of bare walls, of which a laser of 8 m sees one end or the other: a way too short to compare metres of
    it. 0.5 m off and good."""
    walls = np.concatenate([room(-6.0, -0.7, 11.0, 0.7), box(-3.0, 0.2, -2.2, 0.7)])
    poses = [SE2(x, 0.0, 0.0) for x in np.arange(0.0, 9.0, 0.5)]
    slam_map, off_m = mapped(walls, poses, 0.01, scale, seed=1)
    assert (off_m < 0.1) is is_good
    assert slam_map.verdict.is_good is is_good, (off_m, slam_map.verdict.reasons)


def test_who_has_no_wheels_is_not_told_what_they_tell():
    """10 m of bare walls, from the middle of which a laser of 8 m sees next to nothing of their ends."""
    mapper, rng = Mapper(SE2.identity()), np.random.default_rng(3)
    posts = [box(x, 0.2, x + 0.5, 1.2) for x in (2.0, 4.5, 6.2, 9.5, 19.5, 21.1, 24.5, 26.4)]
    walls = np.concatenate([room(0.0, -1.2, 31.0, 1.2), *posts])
    for k, x in enumerate(np.arange(1.0, 29.0, 0.3)):
        scan = scan_of(walls, SE2(x, -0.5, 0.0), rng, 0.01, range_max_m=8.0)
        mapper.update(Measurement(0.6 * k, SE2.identity(), scan, np.eye(3)))
    (reason,) = mapper.finish().verdict.reasons
    assert "no wheels tell how far the robot went between them" in reason
    assert "the wheels alone tell" not in reason


@pytest.mark.parametrize(("deep_m", "is_good"), [(0.22, True), (0.16, False)])
def test_scans_that_tell_hardly_how_far_the_robot_went_are_not_taken_for_sure(deep_m, is_good):
    """Posts along the walls are in view all the way, of shallow ones hardly a beam: what such scans
    tell ends by half a metre off."""
    low, high = np.arange(6.5, 66.0, 6.1), np.arange(4.0, 66.0, 5.3)
    posts = [box(x, 1.2 - deep_m, x + 0.9, 1.2) for x in high]
    posts += [box(x, -1.2, x + 0.9, deep_m - 1.2) for x in low]
    walls = np.concatenate([room(0.0, -1.2, 70.0, 1.2), *posts])
    xs = np.arange(1.0, 69.0, 0.4)
    poses = [SE2(x, 0.1 * math.sin(0.7 * x), 0.07 * math.cos(0.7 * x)) for x in xs]
    slam_map, off_m = mapped(walls, poses, 0.045, 0.95, seed=1)
    assert (off_m < 0.15) is is_good
    assert slam_map.verdict.is_good is is_good, (off_m, slam_map.verdict.reasons)
    # nearly all of it is matched, and leaves nothing open
    assert np.mean([step.is_open for step in slam_map.steps]) < 0.1


def test_way_past_keyframes_that_were_let_go_is_as_unsure_as_it_is():
    mapper = Mapper(SE2.identity())
    rng = np.random.default_rng(3)
    for k, x in enumerate(np.arange(1.0, 6.0, 0.25)):
        scan = scan_of(WALLS, SE2(x, 0.0, 0.0), rng, 0.01, range_max_m=8.0)
        motion = SE2(0.25 if k else 0.0, 0.0, 0.0)
        mapper.update(Measurement(0.5 * k, motion, scan, 1e-4 * np.eye(3)))
    slam_map = mapper.finish()
    way = ToldStep(SE2(3.0, 0.0, 0.0), 0.5 * np.eye(3))
    gap = slam_map.keyframes[5].after_gap(way)
    keyframes = (*slam_map.keyframes[:5], gap, *slam_map.keyframes[6:])
    found = _told(replace(slam_map, keyframes=keyframes), mapper._drive.front_end)
    assert np.array_equal(found[5].covariance, way.covariance)

"""Keyframes between bare walls, tied to what was before them by a scan that sees it again."""

import math

import numpy as np
import pytest

from slam import SE2, Beams, Mapper, Measurement, SlamMap
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.keyframes import Keyframe
from slam.frontend.open_runs import OpenRun, tied
from slam.frontend.told_steps import ToldStep
from slam.loop_closing import without_ties
from slam.odometry import compose_covariance
from slam.pose_graph import PoseGraph
from slam.surface.surface_window import SurfaceWindow
from tests.slam.synthetic import box, room, scan_of

# a corridor, bare but for two boxes by the way; a robot drives past, back and past once more
WALLS = np.concatenate(
    [room(-30.0, -1.0, 30.0, 1.0), box(-0.3, 0.7, 0.0, 1.0), box(-0.9, -1.0, -0.3, -0.6)]
)
ANGLES_RAD = np.radians(np.arange(-180.0, 180.0, 0.5))
STEP_M, SCALE = 0.1, 1.15


def way() -> list[SE2]:
    """Poses: to where the box is out of sight, and back, without a turn."""
    ahead = np.arange(0.0, 2.9, STEP_M)
    return [SE2(x, 0.0, 0.0) for x in (*ahead, *ahead[::-1])]


def driven() -> list[Measurement]:
    """There and back, by wheels that tell of too long a way."""
    found, rng, poses = list[Measurement](), np.random.default_rng(5), way()
    for index, pose in enumerate(poses):
        motion = poses[max(index - 1, 0)].inverse() @ pose
        # ahead it tells of more, as on a slope; back it tells of what it is
        told = SE2(motion.x * (SCALE if motion.x > 0.0 else 1.0), 0.0, 0.0)
        scan = scan_of(WALLS, pose, rng, 0.01, ANGLES_RAD, range_max_m=1.8)
        noise = np.diag([0.03, 0.01, 0.005]) ** 2
        found.append(Measurement(0.2 * index, told, scan, noise))
    return found


def mapped(count: int | None = None) -> SlamMap:
    """The map of so many scans, None: of all."""
    mapper = Mapper(SE2.identity())
    for measurement in driven()[:count]:
        mapper.update(measurement)
    return mapper.finish()


def kept(walls: np.ndarray, pose: SE2, rng: np.random.Generator) -> Keyframe:
    """A keyframe of a scan taken at a pose."""
    scan = scan_of(walls, pose, rng, 0.01, ANGLES_RAD, range_max_m=6.0)
    beams = Beams(np.zeros((len(ANGLES_RAD), 2)), scan.angles_rad, scan.ranges_m)
    points = scan.points(SE2.identity())
    return Keyframe(0.0, pose, SE2.identity(), np.eye(3), points, beams, is_break=False)


def off_m(poses: np.ndarray) -> float:
    """How far the poses of the scans are off, at most."""
    return float(np.abs(poses[:, 0] - [pose.x for pose in way()]).max())


def test_scan_that_sees_again_what_was_before_bare_walls_says_how_far_the_robot_went(monkeypatch):
    slam_map = mapped()
    (tie,) = (loop for loop in slam_map.loops if loop.is_tie)
    assert without_ties(slam_map.loops) == []
    earlier, later = slam_map.keyframes[tie.earlier].time_s, slam_map.keyframes[tie.later].time_s
    assert earlier < 6.0 < later
    assert off_m(slam_map.trajectory.poses) < 0.12

    monkeypatch.setattr(OpenRun, "seen_from_before", lambda *_: None)
    assert off_m(mapped().trajectory.poses) > 0.14


def test_each_step_takes_its_share_as_least_squares_has_it():
    steps = [
        ToldStep(SE2(0.3, 0.0, 0.1), np.diag([4e-4, 1e-4, 9e-4])),
        ToldStep(SE2(0.5, 0.1, -0.2), np.diag([1e-2, 1e-4, 1e-4])),
        ToldStep(SE2(0.2, 0.0, 0.0), np.diag([1e-3, 1e-3, 1e-3])),
    ]
    covariance = np.diag([1e-4, 1e-4, 1e-5])
    poses = [SE2.identity()]
    for step in steps:
        poses.append(poses[-1] @ step.motion)
    T_seen = poses[-1] @ SE2(0.1, -0.05, 0.03)
    graph = PoseGraph()
    for number, pose in enumerate(poses):
        graph.add_node(pose, is_fixed=number == 0)
    for number, step in enumerate(steps):
        graph.add_edge(number, number + 1, step.motion, np.linalg.inv(step.covariance))
    graph.add_edge(0, 3, T_seen, np.linalg.inv(covariance))
    T, found = SE2.identity(), []
    for motion in tied(steps, T_seen, covariance):
        T = T @ motion
        found.append(T.as_array())
    np.testing.assert_allclose(found, graph.solve().poses[1:], atol=0.004)
    assert math.hypot(found[1][0] - poses[2].x, found[1][1] - poses[2].y) > 0.05


def test_steps_that_led_where_they_said_are_left_alone():
    step = ToldStep(SE2(0.3, 0.0, 0.1), np.diag([4e-4, 1e-4, 9e-4]))
    end = step.motion @ step.motion
    spread = compose_covariance(step.covariance, step.motion, step.covariance)
    for motion in tied([step, step], end, spread):
        np.testing.assert_allclose(motion.as_array(), step.motion.as_array(), atol=1e-12)


@pytest.mark.parametrize(
    ("taken", "before"), [([False, True, True], 0), ([True, False], None), ([False], None)]
)
def test_a_run_begins_after_the_last_keyframe_that_saw_where_it_was(taken, before):
    run = OpenRun(Mapper(SE2.identity()).config.front_end)
    for index, is_open in enumerate(taken):
        run.take(index, is_open)
    assert run.is_empty == (before is None)
    if before is not None:
        assert run.before == before


def test_what_fits_along_the_way_as_well_is_no_tie(monkeypatch):
    # boards at equal distances, and a scan that sees of them what it would see one further on
    boards = [box(x, 0.8, x + 0.3, 1.0) for x in np.arange(-24.0, 24.0, 0.8)]
    walls = np.concatenate([room(-30.0, -1.0, 30.0, 1.0), *boards])
    config, rng = FrontEndConfig(), np.random.default_rng(1)
    keyframes = [kept(walls, SE2(x, 0.0, 0.0), rng) for x in (0.0, 0.3, 0.6)]
    window, run = SurfaceWindow(25, config.surfaces), OpenRun(config)
    for index, keyframe in enumerate(keyframes):
        window.learn(keyframe.T_map_base, keyframe.faced)
        run.take(index, index == 2)
    scan = kept(walls, SE2(0.5, 0.0, 0.0), rng)
    assert run.seen_from_before(keyframes, scan.faced, SE2(0.5, 0.0, 0.0), window) is None
    monkeypatch.setattr("slam.frontend.open_runs._SLID_M", ())
    assert run.seen_from_before(keyframes, scan.faced, SE2(0.5, 0.0, 0.0), window) is not None
    assert len(window) == 3

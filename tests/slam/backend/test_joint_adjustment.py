"""Joint adjustment: scans pull each other straight, and a scan that fits nowhere pulls nobody."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from slam.backend.joint_adjustment import AdjustmentConfig, jointly_adjusted
from slam.beams import Beams
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper
from slam.metrics import absolute_errors
from slam.pose_graph import EdgeKernel
from slam.se2 import SE2
from slam.slam_map import SlamMap, graph_of
from tests.slam import ring


@pytest.fixture(scope="module")
def drive():
    poses = ring.way(1.1)
    return poses, ring.drive(poses, np.random.default_rng(4))


@pytest.fixture(scope="module")
def loose(drive) -> SlamMap:
    """The ring, by steps and loops alone."""
    mapper = Mapper(ring.T_BASE_LASER, MapperConfig(adjustment=AdjustmentConfig(rounds=0)))
    for measurement in drive[1]:
        mapper.update(measurement)
    return mapper.finish()


def true_of(slam_map: SlamMap, drive) -> np.ndarray:
    at = {m.time_s: pose.as_array() for m, pose in zip(drive[1], drive[0], strict=True)}
    return np.array([at[keyframe.time_s] for keyframe in slam_map.keyframes])


def off(poses, true) -> tuple[float, float]:
    errors = absolute_errors(poses, true)
    return errors.position_m.rmse, errors.heading_rad.rmse


def test_scans_pull_straight_what_was_pushed_askew(loose, drive):
    true, rng = true_of(loose, drive), np.random.default_rng(8)
    pushed = loose.poses + rng.normal(size=loose.poses.shape) * [0.02, 0.02, 0.005]
    pushed[0] = loose.poses[0]
    # steps and loops that would hold nothing
    steps = [SE2.identity(), *_steps(pushed)]
    keyframes = [
        replace(one, covariance=np.eye(3), T_before=step)
        for one, step in zip(loose.keyframes, steps, strict=True)
    ]
    before = off(pushed, true)
    after = off(jointly_adjusted(keyframes, [], pushed, AdjustmentConfig(rounds=4)), true)
    assert after[0] < 0.5 * before[0]
    assert after[1] < 0.5 * before[1]


def test_frame_of_the_map_is_where_its_first_scan_fits_all_others(loose, drive):
    true, first = true_of(loose, drive), SE2.from_array(loose.poses[0])
    turned = [
        first @ SE2(0.0, 0.0, 0.005) @ first.inverse() @ SE2.from_array(p) for p in loose.poses
    ]
    pushed = np.array([first.as_array(), *(one.as_array() for one in turned[1:])])
    keyframes = [
        replace(one, covariance=np.eye(3), T_before=step)
        for one, step in zip(loose.keyframes, [SE2.identity(), *_steps(pushed)], strict=True)
    ]
    adjusted = jointly_adjusted(keyframes, [], pushed)
    assert adjusted[0] == pytest.approx(pushed[0], abs=1e-9)
    T_true_map = [
        SE2.from_array(poses[0]).inverse()
        @ absolute_errors(poses, true).T_true_estimated.inverse()
        @ SE2.from_array(true[0])
        for poses in (pushed, adjusted)
    ]
    assert abs(T_true_map[0].theta) > 0.004
    assert abs(T_true_map[1].theta) < 0.002


def _steps(poses: np.ndarray) -> list[SE2]:
    placed = [SE2.from_array(pose) for pose in poses]
    return [one.inverse() @ other for one, other in itertools.pairwise(placed)]


@pytest.mark.slow
def test_mapper_adjusts_in_the_end(loose, drive):
    mapper = Mapper(ring.T_BASE_LASER)
    for measurement in drive[1]:
        mapper.update(measurement)
    wanted = jointly_adjusted(loose.keyframes, loose.loops, loose.poses)
    assert mapper.finish().poses == pytest.approx(wanted, abs=1e-9)


def test_scan_that_saw_nothing_stays_where_steps_and_loops_have_it(loose):
    blind = replace(
        loose.keyframes[20], points=np.zeros((0, 2)),
        beams=Beams(np.zeros((4, 2)), np.arange(4.0), np.full(4, np.inf)),
    )  # fmt: skip
    keyframes = [*loose.keyframes[:20], blind, *loose.keyframes[21:]]
    adjusted = jointly_adjusted(keyframes, loose.loops, loose.poses)
    assert np.isfinite(adjusted).all()
    assert np.hypot(*(adjusted[20] - loose.poses[20])[:2]) < 0.05


def test_one_keyframe_or_none_is_left_alone():
    assert len(jointly_adjusted([], [], np.zeros((0, 3)))) == 0


def test_graph_keeps_what_was_measured_alone(loose):
    is_loop = loose.graph.edge_kernels == EdgeKernel.LOOP
    assert is_loop.sum() == len(loose.loops) + len(loose.rejected)
    steps = loose.graph.ends[~is_loop]
    assert np.array_equal(np.unique(steps[:, 1]), np.arange(1, len(loose.keyframes)))
    assert (np.diff(steps, axis=1) == 1).all()
    edges = graph_of(loose.keyframes, loose.loops, loose.poses).edge_count
    assert edges == loose.graph.edge_count - len(loose.rejected)

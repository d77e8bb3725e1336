"""Keyframes of long ago, taken together: the same poses by a smaller graph."""

from dataclasses import replace

import numpy as np
import pytest

from slam.arrays import diagonal_of
from slam.backend.keyframe_graph import KeyframeGraph
from slam.backend.older_keyframes import OlderKeyframes
from slam.backend.rescaling import chained
from slam.beams import Beams
from slam.frontend.keyframes import Keyframe
from slam.kernels.condensed_graph import follow, go_along, ways_over
from slam.loop_closing import Loop
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper
from slam.metrics import absolute_errors
from slam.odometry import compose_covariance
from slam.pose_graph import PoseGraph
from slam.se2 import SE2
from tests.slam import ring

STEP_SIGMA = (0.003, 0.003, 0.001)
SPREAD = np.diag(np.square([0.01, 0.005, 0.002]))
SIDE = 20
"""Keyframes on one side of the square that is driven."""


def keyframe(T_before: SE2, is_kept: bool = True) -> Keyframe:
    count = 3 if is_kept else 0
    beams = Beams(np.zeros((count, 2)), np.zeros(count), np.ones(count))
    return Keyframe(0.0, SE2.identity(), T_before, SPREAD, np.zeros((count, 2)), beams, False)


def laps(count: int, rng: np.random.Generator, recent: int, *, is_thinned: bool) -> KeyframeGraph:
    """Around a square, with noise; each eighth keyframe sees again what one of the first lap saw. Of all
    but three laps, where they are thinned, no more than places are kept."""
    graph, lap = KeyframeGraph(STEP_SIGMA, recent), 4 * SIDE
    true = [SE2.identity()]
    root = np.linalg.cholesky(SPREAD + diagonal_of(STEP_SIGMA))
    graph.add(keyframe(SE2.identity()))
    for k in range(1, count * lap + 1):
        way = way_to(k)
        true.append(true[-1] @ way)
        graph.add(keyframe(way @ SE2.exp(root @ rng.normal(size=3))))
        if k > lap and k % 8 == 0:
            seen = true[k % lap].between(true[k]) @ SE2.exp(rng.normal(0.0, 0.01, 3))
            graph.take([Loop(k % lap, k, seen, np.eye(3) / 0.01**2, 1.0, 0.0)])
        if is_thinned and k - 10 > 3 * lap:
            graph.keep_place_alone(k - 10)
        if k > lap and k % 8 == 0:
            graph.adjust(2)
    return graph


def way_to(k: int) -> SE2:
    return SE2(0.3, 0.0, np.pi / 2 if k % SIDE == 0 else 0.0)


def squares(count: int) -> np.ndarray:
    true = [SE2.identity()]
    for k in range(1, count):
        true.append(true[-1] @ way_to(k))
    return np.array([pose.as_array() for pose in true])


def off_m(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.hypot(*(one - other)[:, :2].T).max())


def test_ways_over_nodes_are_their_steps_one_after_the_other():
    rng = np.random.default_rng(1)
    motions = rng.uniform(-1.0, 1.0, (9, 3))
    roots = rng.normal(size=(9, 3, 3))
    covariances = roots @ roots.transpose(0, 2, 1)
    is_kept = np.isin(np.arange(9), [0, 3, 4, 8])
    ways, of_ways = np.empty((9, 3)), np.empty((9, 3, 3))
    ways_over(motions, covariances, is_kept, ways, of_ways)
    for before, kept in ((0, 3), (3, 4), (4, 8)):
        way, covariance = SE2.identity(), np.zeros((3, 3))
        for k in range(before + 1, kept + 1):
            motion = SE2.from_array(motions[k])
            way, covariance = way @ motion, compose_covariance(covariance, motion, covariances[k])
        assert SE2.from_array(ways[kept]).is_near(way, 1e-12, 1e-12)
        assert np.allclose(of_ways[kept], covariance)


def test_poses_between_two_go_along_with_both():
    rng = np.random.default_rng(2)
    before = np.column_stack([rng.uniform(-5.0, 5.0, (11, 2)), rng.uniform(-3.0, 3.0, 11)])
    is_kept = np.isin(np.arange(11), [0, 10])
    T = SE2(1.0, -2.0, 2.5)
    moved = np.array([(T @ SE2.from_array(pose)).as_array() for pose in before])
    poses = np.where(is_kept[:, np.newaxis], moved, before)
    follow(before, is_kept, poses)  # both alike: so do all
    assert np.allclose(poses, moved)
    poses = before.copy()
    poses[10, :2] += [0.5, 0.1]
    follow(before, is_kept, poses)
    shares = np.arange(11)[:, np.newaxis] / 10.0
    assert np.allclose(poses[:, :2] - before[:, :2], shares * [0.5, 0.1])
    assert np.allclose(poses[:, 2], before[:, 2])


def test_who_has_an_anchor_lies_beside_it_as_before():
    before = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.5, 0.2], [4.0, 4.0, 1.0]])
    poses, anchors = before.copy(), np.array([-1, -1, 1, 2])
    poses[1] = [1.0, 1.0, np.pi / 2]
    is_moved = np.array([True, True, False, False])
    go_along(before, anchors, is_moved, poses)
    assert np.allclose(poses[2], [0.5, 1.0, np.pi / 2 + 0.2])
    # whose anchor was not moved itself is left to those before and after it
    assert np.allclose(poses[3], before[3])
    assert is_moved.tolist() == [True, True, True, False]


def test_broken_step_is_not_taken_together_with_others():
    graph = KeyframeGraph(STEP_SIGMA, 5)
    for k in range(40):
        unknown = replace(keyframe(SE2(0.3, 0.0, 0.0)), covariance=np.diag([1e6, 1e6, 1e2]))
        graph.add(replace(unknown, is_break=True) if k == 20 else keyframe(SE2(0.3, 0.0, 0.0)))
    graph.take([Loop(2, 38, SE2(10.0, 1.0, 0.0), 1e4 * np.eye(3), 1.0, 0.0)])
    for _ in range(5):
        graph.adjust(1)
    # all that was wrong is there
    assert SE2.from_array(graph.poses[20]).is_near(SE2(5.2, 1.0, 0.0), 0.05, 0.05)


@pytest.mark.parametrize("seed", [0, 1])
def test_smaller_graph_of_all_that_loops_hold_has_the_same_poses(seed):
    small = laps(3, np.random.default_rng(seed), 10, is_thinned=False)
    whole = laps(3, np.random.default_rng(seed), 10_000, is_thinned=False)
    true = squares(len(small))
    assert off_m(chained(list(small.keyframes), true, 0), true) > 0.3
    assert off_m(whole.poses, true) < 0.12
    # those in between by their neighbours, not by what a step's own covariance leaves of a bend
    assert off_m(small.poses, whole.poses) < 0.02


def test_laps_of_which_places_are_kept_move_with_what_was_seen_first():
    small = laps(6, np.random.default_rng(1), 60, is_thinned=True)
    whole = laps(6, np.random.default_rng(1), 10_000, is_thinned=True)
    true = squares(len(small))
    assert off_m(whole.poses, true) < 0.12
    # steps alone, or with none to go along with, were 0.2 to 0.3 m off
    assert off_m(small.poses, true) < 0.15


def out_of_a_room(recent: int) -> tuple[float, float]:
    """Twelve laps, of all but the first three of which places alone are kept, and out by a corridor: how far the robot
    is off there [m], and the way from the first keyframe on."""
    rng = np.random.default_rng(2)
    graph = laps(12, rng, recent, is_thinned=True)
    root, first = np.linalg.cholesky(SPREAD + diagonal_of(STEP_SIGMA)), len(graph)
    true = SE2.from_array(squares(first)[-1])
    for k in range(first, first + 160):
        true = true @ SE2(0.3, 0.0, 0.0)
        graph.add(keyframe(SE2(0.3, 0.0, 0.0) @ SE2.exp(root @ rng.normal(size=3))))
        if k - 10 < first:
            graph.keep_place_alone(k - 10)
        if k % 8 == 0:
            graph.adjust(1)
    off = SE2.from_array(graph.poses[-1]).between(true)
    return float(np.hypot(off.x, off.y)), float(graph.ways_m(len(graph) - 1)[0])


def test_what_comes_after_many_laps_does_not_hang_by_all_their_steps():
    small_m, whole_m = out_of_a_room(60), out_of_a_room(10_000)
    # the last loop of a lap holds where it led out: by steps alone it was metres off, and 264 m long
    assert small_m[0] < whole_m[0] + 0.3
    assert small_m[1] < whole_m[1] + 1.0


def test_last_keyframe_is_always_solved_for():
    with pytest.raises(ValueError, match="recent must be 1 or more keyframes, not 0"):
        OlderKeyframes(STEP_SIGMA, 0)


def test_places_that_were_moved_go_along_with_those_who_are_near_then():
    graph = laps(6, np.random.default_rng(1), 60, is_thinned=True)
    older, poses = graph._older, graph.poses
    ends = np.array([(one.earlier, one.later) for one in graph.loops])
    is_kept = older.kept(ends)
    is_place = np.array([one.is_place_alone for one in graph.keyframes]) & ~is_kept
    anchors = older._anchored(poses, is_kept)
    assert is_place.sum() > 100
    assert (anchors[is_place] >= 0).all()
    assert np.hypot(*(poses[anchors[is_place]] - poses[is_place])[:, :2].T).max() < 2.0
    poses[is_place, 0] += 20.0  # as of a session that was joined elsewhere
    assert (older._anchored(poses, is_kept)[is_place] >= 0).all()
    graph.set_poses(poses)
    assert (older._anchored(poses, is_kept)[is_place] < 0).all()


def test_graph_that_is_solved_grows_with_what_is_kept_and_not_with_the_drive():
    sizes = [
        int(older(count).kept(np.array([(5, k) for k in range(90, count, 8)])).sum())
        for count in (200, 400, 800)
    ]
    assert sizes == [64, 64, 64]


def older(count: int) -> OlderKeyframes:
    found = OlderKeyframes(STEP_SIGMA, 60)
    for k in range(count):
        found.take(keyframe(SE2(0.3, 0.0, 0.0), is_kept=k < 80))
    return found


@pytest.mark.slow
def test_drive_is_mapped_by_the_smaller_graph(monkeypatch):
    poses, sizes = ring.way(2.5), []
    mapper = Mapper(ring.T_BASE_LASER, MapperConfig(crowd=3, recent=80))
    solve = PoseGraph.solve

    def counted(graph, *args, **kwargs):
        sizes.append(graph.node_count)
        return solve(graph, *args, **kwargs)

    monkeypatch.setattr(PoseGraph, "solve", counted)
    online = [
        mapper.update(one).T_map_base
        for one in ring.drive(poses, np.random.default_rng(0), 1.01, 1.005)
    ]
    assert max(sizes) < 0.7 * len(mapper._drive.graph)
    true = np.array([pose.as_array() for pose in poses])
    errors = absolute_errors(np.array([pose.as_array() for pose in online]), true)
    assert errors.position_m.rmse < 0.3
    found = mapper.finish()
    assert found.verdict.is_good
    assert absolute_errors(found.trajectory.poses, true).position_m.rmse < 0.05

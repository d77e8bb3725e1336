"""Keyframes of long ago, taken together: the same poses by a smaller graph."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from slam.arrays import IntArray, diagonal_of
from slam.backend.keyframe_graph import KeyframeGraph
from slam.backend.older_keyframes import OlderKeyframes
from slam.backend.rescaling import chained
from slam.beams import Beams
from slam.frontend.keyframes import Keyframe
from slam.frontend.remaining import Remaining
from slam.kernels.condensed_graph import follow, ways_over
from slam.loop_closing import Loop
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper
from slam.metrics import absolute_errors
from slam.odometry import compose_covariance
from slam.pose_graph import PoseGraph
from slam.se2 import SE2, wrap_angle
from slam.slam_map import graph_of
from tests.slam import ring

STEP_SIGMA = (0.003, 0.003, 0.001)
SPREAD = np.diag(np.square([0.01, 0.005, 0.002]))
SIDE = 20
"""Keyframes on one side of the square that is driven."""


def keyframe(T_before: SE2, is_kept: bool = True) -> Keyframe:
    count = 3 if is_kept else 0
    beams = Beams(np.zeros((count, 2)), np.zeros(count), np.ones(count))
    return Keyframe(0.0, SE2.identity(), T_before, SPREAD, np.zeros((count, 2)), beams, False)


@dataclass
class Driven:
    """A graph of a drive, and of each of its keyframes, (K,), how many steps were driven until then."""

    graph: KeyframeGraph
    steps: IntArray

    def let_go(self) -> Remaining | None:
        """Lets keyframes go, if there are enough to be let go of."""
        remaining = self.graph.remaining(())
        if remaining is not None:
            self.graph.renumber(remaining)
            self.steps = self.steps[remaining.kept]
        return remaining

    def off_m(self) -> float:
        """How far poses are off at most."""
        return off_m(self.graph.poses, squares(int(self.steps[-1]) + 1)[self.steps])


def laps(count: int, rng: np.random.Generator, recent: int, *, is_thinned: bool) -> Driven:
    """Around a square, with noise; each eighth keyframe sees again what one of the first lap saw. Of all
    but three laps, where they are thinned, no more than places are kept, until they are let go."""
    graph, lap = KeyframeGraph(STEP_SIGMA, recent), 4 * SIDE
    driven = Driven(graph, np.zeros(1, np.int64))
    true = [SE2.identity()]
    root = np.linalg.cholesky(SPREAD + diagonal_of(STEP_SIGMA))
    graph.add(keyframe(SE2.identity()))
    for k in range(1, count * lap + 1):
        way = way_to(k)
        true.append(true[-1] @ way)
        graph.add(keyframe(way @ SE2.exp(root @ rng.normal(size=3))))
        driven.steps = np.append(driven.steps, k)
        if k > lap and k % 8 == 0:
            seen = true[k % lap].between(true[k]) @ SE2.exp(rng.normal(0.0, 0.01, 3))
            graph.take([Loop(k % lap, len(graph) - 1, seen, np.eye(3) / 0.01**2, 1.0, 0.0)])
        if is_thinned and k - 10 > 3 * lap:
            graph.keep_place_alone(len(graph) - 11)
        if k > lap and k % 8 == 0:
            graph.adjust(2)
        if is_thinned:
            driven.let_go()
    return driven


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
    true = squares(len(small.graph))
    assert off_m(chained(list(small.graph.keyframes), true, 0), true) > 0.3
    assert whole.off_m() < 0.12
    # those in between by their neighbours, not by what a step's own covariance leaves of a bend
    assert off_m(small.graph.poses, whole.graph.poses) < 0.02


def test_laps_of_which_places_are_let_go_leave_as_good_a_graph():
    small = laps(6, np.random.default_rng(1), 60, is_thinned=True)
    whole = laps(6, np.random.default_rng(1), 10_000, is_thinned=True)
    assert whole.off_m() < 0.12
    # the first lap's, and a few more; steps alone would be 0.2 to 0.3 m off
    assert len(small.graph) < 0.8 * len(whole.graph)
    assert small.off_m() < 0.15


def out_of_a_room(recent: int) -> tuple[float, float]:
    """Twelve laps, of all but the first three of which places alone are kept, and out by a corridor: how far the robot
    is off there [m], and the way from the first keyframe on."""
    rng = np.random.default_rng(2)
    driven = laps(12, rng, recent, is_thinned=True)
    graph, first = driven.graph, int(driven.steps[-1]) + 1
    root = np.linalg.cholesky(SPREAD + diagonal_of(STEP_SIGMA))
    true = SE2.from_array(squares(first)[-1])
    for k in range(first, first + 160):
        true = true @ SE2(0.3, 0.0, 0.0)
        graph.add(keyframe(SE2(0.3, 0.0, 0.0) @ SE2.exp(root @ rng.normal(size=3))))
        driven.steps = np.append(driven.steps, k)
        if k - 10 < first:
            graph.keep_place_alone(len(graph) - 11)
        if k % 8 == 0:
            graph.adjust(1)
        driven.let_go()
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


def test_graph_grows_with_what_is_kept_and_not_with_the_drive():
    drives = [laps(count, np.random.default_rng(1), 60, is_thinned=True) for count in (8, 12, 16)]
    sizes = [len(one.graph) for one in drives]
    loops = [len(one.graph.loops) for one in drives]
    assert max(sizes) - min(sizes) <= 10
    assert max(loops) - min(loops) <= 5
    assert max(one.off_m() for one in drives) < 0.2


def test_graph_of_those_that_remain_is_the_one_made_of_them_anew():
    driven = laps(6, np.random.default_rng(1), 10_000, is_thinned=True)
    graph = driven.graph
    older = OlderKeyframes(STEP_SIGMA, 60)
    for one in graph.keyframes:
        older.take(one)
    ends = np.array([(one.earlier, one.later) for one in graph.loops])
    remaining = older.remaining(graph.poses, ends, ())
    graph.renumber(remaining)
    anew = graph_of(graph.keyframes, graph.loops, graph.poses, STEP_SIGMA)
    assert graph._graph.edge_count == anew.edge_count
    for name in ("ends", "measured", "information", "edge_kernels"):
        one, other = (getattr(of, name)[np.lexsort(of.ends.T)] for of in (graph._graph, anew))
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
    of_loops = graph._graph.ends[graph._loop_edges].tolist()
    assert of_loops == [[one.earlier, one.later] for one in graph.loops]
    after_gap = [k for k, one in enumerate(graph.keyframes) if one.is_after_gap]
    assert after_gap == sorted(map(remaining.number, remaining.ways))


def test_scans_are_seen_from_who_is_near():
    driven = laps(6, np.random.default_rng(1), 10_000, is_thinned=True)
    older = OlderKeyframes(STEP_SIGMA, 60)
    for one in driven.graph.keyframes:
        older.take(one)
    poses = driven.graph.poses
    remaining = older.remaining(poses, np.array([(5, 250)]), {300})
    gone = np.flatnonzero(~remaining.is_kept)
    assert len(gone) > 100
    assert remaining.is_kept[[0, 250, 300]].all()
    anchors = remaining.anchors[gone]
    assert remaining.is_kept[anchors].all()
    assert np.hypot(*(poses[anchors] - poses[gone])[:, :2].T).max() < 0.5
    assert np.abs(wrap_angle(poses[anchors, 2] - poses[gone, 2])).max() < 0.2
    # a session's own: another one may turn out to lie elsewhere
    other = OlderKeyframes(STEP_SIGMA, 60)
    for k, one in enumerate(driven.graph.keyframes):
        other.take(replace(one, session=int(k >= 240), is_break=k == 240))
    remaining = other.remaining(poses, np.array([(5, 250)]), ())
    gone = np.flatnonzero(~remaining.is_kept)
    assert gone.min() > 240
    anchors = remaining.anchors[gone]
    assert anchors.min() >= 240
    assert remaining.is_kept[anchors].all()
    assert np.hypot(*(poses[anchors] - poses[gone])[:, :2].T).max() < 2.0


def test_both_sides_of_a_break_stay_however_often_others_go():
    found, none = older(160), np.empty((0, 2), np.int64)
    found.take(replace(keyframe(SE2(0.3, 0.0, 0.0), is_kept=False), is_break=True))
    for _ in range(3):
        for _ in range(80):
            found.take(keyframe(SE2(0.3, 0.0, 0.0), is_kept=False))
        count = len(found._steps)
        remaining = found.remaining(np.zeros((count, 3)), none, ())
        assert remaining is not None
        found.renumber(remaining)
        (before, after) = found._at_breaks
        assert (before, after) == (80, 81)
        assert found.solved_for(none)[[before, after]].all()


def test_too_few_are_not_let_go_of():
    poses, none = np.zeros((100, 3)), np.empty((0, 2), np.int64)
    assert older(80 + 60 + 5).remaining(np.zeros((145, 3)), none, ()) is None
    assert older(100).remaining(poses, none, ()) is None
    found = older(200).remaining(np.zeros((200, 3)), none, ())
    assert np.flatnonzero(~found.is_kept).tolist() == list(range(80, 140))


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

    taken, add = [], KeyframeGraph.add
    monkeypatch.setattr(KeyframeGraph, "add", lambda *args: taken.append(args) or add(*args))
    monkeypatch.setattr(PoseGraph, "solve", counted)
    online = [
        mapper.update(one).T_map_base
        for one in ring.drive(poses, np.random.default_rng(0), 1.01, 1.005)
    ]
    assert max(sizes) < 0.7 * len(taken)
    assert len(mapper.keyframes) < 0.8 * len(taken)
    true = np.array([pose.as_array() for pose in poses])
    errors = absolute_errors(np.array([pose.as_array() for pose in online]), true)
    assert errors.position_m.rmse < 0.3
    found = mapper.finish()
    assert found.verdict.is_good
    assert absolute_errors(found.trajectory.poses, true).position_m.rmse < 0.05

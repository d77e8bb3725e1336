"""Keyframes and loops: how far the way between two is, and that right loops are not left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from slam.backend.keyframe_graph import KeyframeGraph
from slam.beams import Beams
from slam.frontend.keyframes import Keyframe
from slam.frontend.remaining import Remaining
from slam.frontend.told_steps import ToldStep
from slam.loop_closing import Loop
from slam.se2 import SE2

STEP_SIGMA = (0.01, 0.01, 0.005)


def keyframe(T_before: SE2, is_break: bool = False) -> Keyframe:
    nothing = Beams(np.empty((0, 2)), np.empty(0), np.empty(0))
    return Keyframe(
        0.0, SE2.identity(), T_before, np.zeros((3, 3)), np.empty((0, 2)), nothing, is_break
    )


def driven(steps: list[SE2], breaks: tuple[int, ...] = ()) -> KeyframeGraph:
    graph = KeyframeGraph(STEP_SIGMA)
    for k, step in enumerate([SE2.identity(), *steps]):
        graph.add(keyframe(step, k in breaks))
    return graph


def loop(earlier: int, later: int, T_earlier_later: SE2) -> Loop:
    return Loop(earlier, later, T_earlier_later, 1e4 * np.eye(3), 1.0, 0.0)


def test_way_between_keyframes_is_the_shortest_over_steps_and_loops():
    rng = np.random.default_rng(5)
    steps = [SE2(rng.uniform(0.2, 1.5), 0.0, rng.normal(0.0, 0.6)) for _ in range(60)]
    graph = driven(steps)
    pairs = sorted((int(a), int(b)) for a, b in np.sort(rng.choice(61, (8, 2)), axis=1))
    graph.take([loop(a, b, graph.pose(a).inverse() @ graph.pose(b)) for a, b in pairs if a < b])
    graph.solve()
    ends = np.array([(k, k + 1) for k in range(60)] + [pair for pair in pairs if pair[0] < pair[1]])
    lengths = np.hypot(*(graph.poses[ends[:, 0], :2] - graph.poses[ends[:, 1], :2]).T)
    edges = coo_array((lengths, ends.T), shape=(61, 61)).tocsr()
    for k in (0, 23, 60):
        assert np.allclose(graph.ways_m(k), dijkstra(edges, directed=False, indices=k))


def test_loop_shortens_the_way_only_once_the_poses_hold_it():
    graph = driven([SE2(1.0, 0.0, 0.0)] * 20)
    assert graph.ways_m(20)[0] == 20.0
    graph.take([loop(0, 20, SE2(19.9, 0.0, 0.0))])
    assert graph.ways_m(20)[0] == 20.0
    graph.solve()
    assert abs(graph.ways_m(20)[0] - 19.9) < 0.1
    # the others, who saw one place as well, keep theirs to each other
    assert abs(graph.ways_m(12)[10] - 2.0) < 0.1


def test_way_over_a_break_is_as_long_as_nobody_knows():
    graph = driven([SE2(1.0, 0.0, 0.0)] * 6, breaks=(3,))
    assert graph.ways_m(6)[3] == 3.0
    assert graph.ways_m(6)[2] > 100.0


def test_right_loops_that_lie_metres_off_are_not_left_out():
    # round a square of 40 m, one turn of which was taken for 0.15 rad less than it was: 16 scans of the
    # second lap tell, five metres off, and were told that they contradict the odometry
    side = [SE2(1.0, 0.0, 0.0)] * 39 + [SE2(1.0, 0.0, np.pi / 2.0)]
    true = side * 5
    told = list(true)
    told[79] = SE2(1.0, 0.0, np.pi / 2.0 - 0.15)
    graph = driven(told)
    graph.take([loop(k, 160 + k, SE2(0.02, 0.0, 0.0)) for k in range(2, 34, 2)])
    kept, rejected = graph.sorted_loops()
    assert len(kept) == 16
    assert rejected == []
    off_m = np.hypot(*(graph.poses[160:194, :2] - graph.poses[:34, :2]).T)
    assert off_m.max() < 0.1


def test_wheels_that_tell_of_kilometres_at_each_scan_are_solved_for_as_far_as_can_be():
    # information of 1e-10 beside 1e4: no direction is open, and none can be told to be held
    graph = driven([SE2(1e5 * k, 0.0, 0.0) for k in range(1, 9)])
    graph.keyframes = [replace(one, covariance=1e12 * np.eye(3)) for one in graph.keyframes]
    loops = [loop(k, k + 3, SE2(0.0, 50.0 * k, 0.0)) for k in range(5)]
    graph.renew(graph.keyframes, loops, graph.poses)
    assert np.isfinite(graph.solve().poses).all()


def test_ways_past_keyframes_that_are_gone_are_as_unsure_as_over_a_break():
    graph = driven([SE2(1.0, 0.0, 0.0)] * 9, breaks=(2,))
    kept = ~np.isin(np.arange(10), (4, 5))
    way = ToldStep(SE2(3.0, 0.0, 0.0), 0.1 * np.eye(3))
    graph.renumber(Remaining(kept, np.where(kept, np.arange(10), 3), {6: way}))
    # after the break one torn metre, after the gap one more
    expected = [0.0, 1.0, 102.0, 103.0, 206.0, 207.0, 208.0, 209.0]
    assert graph.ways_m(0) == pytest.approx(expected)
    graph.add(keyframe(SE2(1.0, 0.0, 0.0)))
    assert graph.ways_m(0) == pytest.approx([*expected, 210.0])
    # the same of a graph that is made of these keyframes anew
    anew = KeyframeGraph(STEP_SIGMA)
    anew.renew(graph.keyframes, [], graph.poses)
    assert anew.ways_m(0) == pytest.approx([*expected, 210.0])


def test_loops_are_counted_of_those_that_remain():
    graph = driven([SE2(1.0, 0.0, 0.0)] * 9)
    ties = [replace(loop(*ends, SE2(2.0, 0.0, 0.0)), is_tie=True) for ends in ((1, 3), (5, 7))]
    graph.take([loop(0, 9, SE2(9.0, 0.0, 0.0)), *ties, loop(2, 5, SE2(3.0, 0.0, 0.0))])
    assert graph.loop_count == 2
    kept = np.arange(10) != 5
    way = ToldStep(SE2(2.0, 0.0, 0.0), 0.1 * np.eye(3))
    graph.renumber(Remaining(kept, np.where(kept, np.arange(10), 4), {6: way}))
    assert (len(graph.loops), graph.loop_count) == (2, 1)
    assert graph.sorted_loops() == (graph.loops, [])
    assert graph.ways_m(8)[0] == pytest.approx(9.0)


def test_keyframes_of_an_open_run_that_has_not_ended_stay():
    graph = KeyframeGraph(STEP_SIGMA, 12)
    for k in range(60):
        graph.add(keyframe(SE2(0.3, 0.0, 0.0)), is_open=k > 30)
    remaining = graph.remaining((7,))
    assert remaining is not None
    assert remaining.is_kept[30:].all()
    assert remaining.is_kept[7]
    assert remaining.is_kept[8:30].sum() < 10
    sigmas_m = graph.looseness.sigmas_m
    graph.renumber(remaining)
    assert np.array_equal(graph.looseness.sigmas_m, sigmas_m[remaining.kept])


def test_loop_that_others_deny_holds_nobody():
    graph = KeyframeGraph(STEP_SIGMA, 12)
    for _ in range(60):
        graph.add(keyframe(SE2(0.3, 0.0, 0.0)))
    right = [loop(0, later, SE2(0.3 * later, 0.0, 0.0)) for later in (21, 25)]
    graph.take([*right, loop(5, 41, SE2(1.0, 3.0, 0.0))])
    graph.solve()
    remaining = graph.remaining(())
    assert remaining is not None
    assert remaining.is_kept[25]
    assert not remaining.is_kept[41]

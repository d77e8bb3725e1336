"""A loop that alone denies the wheels over a break: a corridor that looks the same a metre on."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from slam import SE2
from slam.backend.keyframe_graph import KeyframeGraph
from slam.loop_closing import Loop
from slam.map_checks.breaks_borne_out import BreaksBorneOut
from slam.map_checks.lone_loops import LEAST_NOISE, LoneLoop, breaks_in_doubt, lone_loops
from slam.map_checks.map_consistency import MapVerdict
from slam.map_checks.ways_over_breaks import sure_ways
from slam.mapper_config import MapperConfig
from slam.slam_map import SlamMap, graph_of
from tests.slam.map_checks.test_breaks_borne_out import (
    BREAK,
    BREAK_SIGMA,
    LOOSE,
    TO_BEGIN,
    TOLD,
    driven,
    off_m,
    take,
)

SIGMA, OFF = MapperConfig().step_sigma, SE2(1.4, 0.0, 0.0)


def false_loop(true: Sequence[SE2], ends: tuple[int, int]) -> Loop:
    one, other = ends
    T = true[one].inverse() @ true[other] @ OFF
    return Loop(one, other, T, 1e4 * np.eye(3), 0.9, 0.0)


def drive_with(
    false: Sequence[tuple[int, int]], ends: Sequence[tuple[int, int]] = TO_BEGIN[:1]
) -> tuple[KeyframeGraph, Sequence[SE2]]:
    """False loops, and true ones that know less."""
    graph, true = driven(ends=())
    take(graph, true, ends, information=600.0)
    graph.take([false_loop(true, one) for one in false])
    return graph, true


def lone_of(graph: KeyframeGraph) -> list[LoneLoop]:
    keyframes, solution = graph.keyframes, graph.solve()
    sure = sure_ways(keyframes, graph.poses, TOLD, BREAK_SIGMA, LEAST_NOISE)
    return lone_loops(keyframes, graph.loops, solution, sure, SIGMA)


def test_loop_that_wheels_and_all_others_deny_is_let_go():
    graph, true = drive_with([(BREAK - 3, BREAK + 2)])
    (false,), breaks = graph.loops[1:], BreaksBorneOut(BREAK_SIGMA, SIGMA)
    before_m = off_m(graph, true)
    kept, rejected = breaks.sorted_loops(graph, TOLD)
    assert rejected == breaks.let_go == [false]
    assert len(kept) == 1
    # two against one: the wheels are believed from then on
    assert graph.keyframes[BREAK].covariance[0, 0] < 0.01 * LOOSE[0, 0]
    assert off_m(graph, true) < 0.5 * before_m
    # and whoever is asked again begins with all loops
    breaks.believe(graph, TOLD)
    assert breaks.let_go == [false]
    # but for a session that is joined no more
    breaks.leave_apart(false.earlier)
    assert breaks.let_go == [false]
    breaks.leave_apart(BREAK)
    assert breaks.let_go == []


def test_nobody_knows_who_is_right_where_no_other_loop_tells():
    graph, _ = drive_with([(BREAK - 3, BREAK + 2)], ends=())
    (one,) = lone_of(graph)
    assert not one.is_denied
    assert one.keyframe == BREAK
    assert one.off_m == pytest.approx(OFF.x, abs=0.1)
    keyframes, loops = tuple(graph.keyframes), tuple(graph.loops)
    built, verdict = graph_of(keyframes, loops, graph.poses), MapVerdict(True, 0.0, 0.0, 0)
    slam_map = SlamMap(keyframes, graph.poses, loops, (), built, (), verdict)
    (said,) = breaks_in_doubt(slam_map, TOLD, MapperConfig())
    assert breaks_in_doubt(replace(slam_map, loops=()), TOLD, MapperConfig()) == []
    assert said.startswith(f"the scans broke off at {BREAK:.2f} s, and one loop alone")
    assert "1.4 m" in said
    breaks = BreaksBorneOut(BREAK_SIGMA, SIGMA)
    kept, rejected = breaks.sorted_loops(graph, TOLD)
    assert kept == graph.loops
    assert rejected == []


def test_loops_that_bear_each_other_out_know_better_than_wheels():
    graph, _ = drive_with([(BREAK - 3, BREAK + 2), (BREAK - 2, BREAK + 3)], ends=())
    assert lone_of(graph) == []


def test_loop_that_leads_where_wheels_do_stands_alone_against_nothing():
    assert lone_of(driven(ends=[(BREAK - 3, BREAK + 2)])[0]) == []


def test_wheels_that_hardly_know_the_way_deny_nothing():
    graph, _ = drive_with([(BREAK - 3, BREAK + 2)])
    vague = np.diag([0.3, 0.3, 4e-4])
    keyframes = [
        replace(one, covariance=one.covariance + vague) if k == BREAK else one
        for k, one in enumerate(graph.keyframes)
    ]
    graph.renew(keyframes, graph.loops, graph.poses)
    assert lone_of(graph) == []

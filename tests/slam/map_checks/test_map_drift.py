"""How far a map may have drifted: a chain's is known, a loop lessens it, and too much is told."""

import math

import numpy as np
import pytest

from slam.files.slam_map_files import read_slam_map, write_slam_map
from slam.map_checks import map_drift
from slam.map_checks.map_drift import between_m, drift_m, too_far_adrift
from slam.mapping import Mapper
from slam.pose_graph import EdgeKernel, PoseGraph
from slam.se2 import SE2
from tests.slam import ring

SIGMA_M = 0.01


def chain(count: int) -> PoseGraph:
    """Steps of a metre ahead, which do not turn."""
    graph = PoseGraph()
    for k in range(count):
        graph.add_node(SE2(float(k), 0.0, 0.0))
    for k in range(1, count):
        information = np.diag([SIGMA_M**-2, SIGMA_M**-2, 1e12])
        graph.add_edge(k - 1, k, SE2(1.0, 0.0, 0.0), information)
    return graph


@pytest.mark.parametrize("count", [9, 201])
def test_chain_drifts_as_a_random_walk_does_as_seen_from_its_middle(count):
    # each step adds a variance along and across; in the mean a quarter of the steps lie between
    expected_m = SIGMA_M * math.sqrt(2.0 * count / 4.0)
    assert drift_m(chain(count), np.arange(count)) == pytest.approx(expected_m, rel=0.06)


def test_loop_lessens_it_as_for_a_bridge():
    graph = chain(101)
    graph.add_edge(0, 100, SE2(100.0, 0.0, 0.0), 1e8 * np.eye(3), EdgeKernel.LOOP)
    # n of N steps around a ring have the variance of n (N - n) / N: in the mean N / 6
    expected_m = SIGMA_M * math.sqrt(2.0 * 101 / 6.0)
    assert drift_m(graph, np.arange(101)) == pytest.approx(expected_m, rel=0.06)


def test_only_those_asked_for_count():
    graph = chain(101)
    assert drift_m(graph, np.arange(11)) == pytest.approx(drift_m(chain(11), np.arange(11)))
    assert drift_m(graph, np.arange(1)) == drift_m(PoseGraph(), np.arange(0)) == 0.0


def test_between_two_keyframes_a_loop_tells_more_than_the_steps():
    graph = chain(26)
    assert between_m(graph, 0, 25) == pytest.approx(5.0 * SIGMA_M, rel=1e-3)
    assert between_m(graph, 7, 7) == 0.0
    graph.add_edge(0, 25, SE2(25.0, 0.0, 0.0), 1e8 * np.eye(3), EdgeKernel.LOOP)
    assert between_m(graph, 0, 25) < 0.02 * SIGMA_M
    node = graph.add_node(SE2(26.0, 0.0, 0.0))
    graph.add_edge(25, node, SE2(1.0, 0.0, 0.0), np.diag([0.0, 1.0, 1.0]))
    assert between_m(graph, 0, node) == math.inf


def test_open_direction_has_no_bounds():
    graph = chain(3)
    node = graph.add_node(SE2(3.0, 0.0, 0.0))
    graph.add_edge(2, node, SE2(1.0, 0.0, 0.0), np.diag([0.0, 1.0, 1.0]))
    assert drift_m(graph, np.arange(4)) == math.inf


def test_large_buildings_may_drift_farther():
    small, large = np.zeros((2, 3)), np.array([[0.0, 0.0, 0.0], [160.0, 120.0, 0.0]])
    assert too_far_adrift(0.6, small) == too_far_adrift(1.9, large) == []
    assert "off by 0.7 m" in too_far_adrift(0.7, small)[0]
    assert "off by 2.1 m" in too_far_adrift(2.1, large)[0]


def test_map_that_may_be_far_adrift_is_called_failed(monkeypatch, tmp_path):
    mapper = Mapper(ring.T_BASE_LASER)
    for measurement in ring.drive(ring.way(0.4), np.random.default_rng(0)):
        mapper.update(measurement)
    slam_map = mapper.finish()
    assert slam_map.verdict.is_good
    assert 0.0 < slam_map.drift_m < map_drift._MOST_DRIFT_M
    monkeypatch.setattr(map_drift, "_MOST_DRIFT_M", slam_map.drift_m / 2.0)
    monkeypatch.setattr(map_drift, "_MOST_DRIFT", 0.0)
    verdict = mapper.finish().verdict
    assert not verdict.is_good
    assert "too few loops" in verdict.reasons[0]
    path = tmp_path / "map.npz"
    write_slam_map(path, slam_map)
    assert read_slam_map(path).drift_m == pytest.approx(slam_map.drift_m, rel=1e-6)


def test_less_drift_is_let_pass_where_more_is_asked():
    poses = np.array([[0.0, 0.0, 0.0], [30.0, 40.0, 0.0]])
    assert too_far_adrift(0.5, poses) == []
    assert too_far_adrift(0.5, poses, 0.5)
    assert too_far_adrift(0.29, poses, 0.5) == []
    # of a large one, a share of its size
    assert too_far_adrift(0.5, 10.0 * poses, 0.5) == []
    assert too_far_adrift(2.6, 10.0 * poses, 0.5)

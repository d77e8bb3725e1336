"""The point map: nearest points, and thinning when it grows."""

import numpy as np
import pytest

from slam.point_map import PointMap

GRID = np.array([[x, y] for x in range(4) for y in range(4)], dtype=float)


def test_nearest_agrees_with_the_search_over_all_points():
    rng = np.random.default_rng(0)
    points, queries = rng.uniform(0.0, 5.0, (300, 2)), rng.uniform(0.0, 5.0, (200, 2))
    pairs = PointMap(points, 0.1).nearest(queries, 0.2)
    distances = np.hypot(*(queries[:, np.newaxis] - points).transpose(2, 0, 1))
    within = np.flatnonzero(distances.min(axis=1) < 0.2)
    assert pairs.scan_ids.tolist() == within.tolist()
    assert pairs.map_ids.tolist() == distances.argmin(axis=1)[within].tolist()


def test_empty_map_and_empty_scan_give_no_pairs():
    assert len(PointMap(np.empty((0, 2)), 0.1).nearest(GRID, 1.0)) == 0
    assert len(PointMap(GRID, 0.1).nearest(np.empty((0, 2)), 1.0)) == 0


def test_infinite_reach_pairs_every_point():
    assert len(PointMap(GRID, 0.1).nearest([[100.0, 100.0]], np.inf)) == 1


def test_integrated_points_keep_the_spacing_to_the_map_and_among_themselves():
    rng = np.random.default_rng(1)
    point_map = PointMap(rng.uniform(0.0, 1.0, (1, 2)), 0.1)
    for _ in range(5):
        point_map.integrate(rng.uniform(0.0, 1.0, (400, 2)))
    points = point_map.points
    distances = np.hypot(*(points[:, np.newaxis] - points).transpose(2, 0, 1))
    assert distances[~np.eye(len(points), dtype=bool)].min() >= 0.1
    # 2000 points leave no gap: every place has a map point nearer than the spacing
    assert len(point_map.nearest(rng.uniform(0.05, 0.95, (500, 2)), 0.15)) == 500


def test_thinning_is_the_plain_greedy_one():
    points = np.random.default_rng(2).uniform(0.0, 1.0, (200, 2))
    kept: list[np.ndarray] = []
    for point in points:
        if all(np.hypot(*(point - other)) >= 0.1 for other in kept):
            kept.append(point)
    point_map = PointMap(np.empty((0, 2)), 0.1)
    point_map.integrate(points)
    np.testing.assert_array_equal(point_map.points, kept)


def test_the_same_scan_twice_changes_nothing_the_second_time():
    point_map = PointMap(np.empty((0, 2)), 0.5)
    point_map.integrate(GRID)
    version = point_map.version
    point_map.integrate(GRID)
    assert (len(point_map), point_map.version) == (16, version)


def test_points_found_after_growth_include_the_new_ones():
    point_map = PointMap(GRID, 0.1)
    assert len(point_map.nearest([[10.0, 10.0]], 0.5)) == 0
    point_map.integrate([[10.1, 10.0]])
    assert len(point_map.nearest([[10.0, 10.0]], 0.5)) == 1


@pytest.mark.parametrize(
    ("points", "message"),
    [(np.zeros(3), r"\(N, 2\)"), (np.zeros((2, 3)), r"\(N, 2\)"), ([[0.0, np.inf]], "finite")],
)
def test_malformed_points_are_refused(points, message):
    with pytest.raises(ValueError, match=message):
        PointMap(points, 0.1)
    with pytest.raises(ValueError, match=message):
        PointMap(GRID, 0.1).nearest(points, 0.1)
    with pytest.raises(ValueError, match="spacing_m"):
        PointMap(GRID, 0.0)

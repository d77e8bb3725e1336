"""The point nearest to each cell: what a look at all cells says, without looking at all."""

import tracemalloc

import numpy as np
import pytest
from scipy.spatial import cKDTree

from slam.surface import near_cells
from slam.surface.near_cells import nearest_points, row_blocks


def all_at_once(points, x, y, reach_m):
    xs, ys = np.meshgrid(x, y)
    middles = np.column_stack([xs.ravel(), ys.ravel()])
    distances_m, nearest = cKDTree(points).query(middles, distance_upper_bound=reach_m)
    return distances_m, np.where(np.isfinite(distances_m), nearest, -1)


def in_parts(points, x, y, reach_m):
    distances_m = np.full(len(x) * len(y), np.inf)
    nearest = np.full(len(x) * len(y), -1)
    for cells, found_m, which in nearest_points(points, x, y, reach_m):
        assert not np.isfinite(distances_m[cells]).any()
        distances_m[cells], nearest[cells] = found_m, which
    return distances_m, nearest


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("reach_m", [0.03, 0.4, 2.0, 30.0])
def test_it_is_what_a_look_at_all_cells_says(monkeypatch, seed, reach_m):
    monkeypatch.setattr(near_cells, "_CELLS_AT_ONCE", 500)
    rng = np.random.default_rng(seed)
    # some beyond the grid, some near one another and some in a row on its lines
    points = rng.uniform([-6.0, 1.0], [6.0, 9.0], (40, 2))
    points = np.concatenate([points, np.round(points, 1), points[:5] + 0.01])
    x, y = -3.0 + 0.1 * np.arange(57), 2.0 + 0.1 * np.arange(43)
    for expected, found in zip(
        all_at_once(points, x, y, reach_m), in_parts(points, x, y, reach_m), strict=True
    ):
        np.testing.assert_array_equal(found, expected)


def test_cells_exactly_at_reach_are_not_missed():
    # a point a hair less than the reach to the left of a cell, and one below
    x = y = np.arange(5.0)
    points = np.array([[2.0 - 0.999999999, 3.0], [4.0, 1.0 - 0.999999999]])
    np.testing.assert_array_equal(in_parts(points, x, y, 1.0)[0], all_at_once(points, x, y, 1.0)[0])


def test_rows_come_once_each_whatever_their_length(monkeypatch):
    monkeypatch.setattr(near_cells, "_CELLS_AT_ONCE", 10)
    for columns in (1, 3, 10, 11, 1000):
        rows = [row for part in row_blocks(7, columns) for row in range(part.start, part.stop)]
        assert rows == list(range(7))


def test_a_hall_takes_memory_for_its_rim_alone():
    # 4 million cells, of which one in a hundred is near the wall
    side = 20.0 * np.linspace(-1.0, 1.0, 8000)
    rim = np.full(len(side), 20.0)
    points = np.concatenate([np.column_stack(two) for two in ((side, rim), (rim, side))])
    x = y = -20.0 + 0.02 * np.arange(2000)
    tracemalloc.start()
    cells = sum(len(part) for part, _, _ in nearest_points(points, x, y, 0.1))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert cells == pytest.approx(2 * 2000 * 4, rel=0.02)
    # all at once: 64 MB for the middles alone, and as much for what is found
    assert peak < 25e6

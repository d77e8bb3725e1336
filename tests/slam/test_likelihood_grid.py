"""The search of a whole map: the same as trying every pose, and what it searches in."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.kernels.branch_and_bound import best_of_blocks, score_of
from slam.likelihood_grid import Candidate, LikelihoodGrid, SearchConfig, spread
from slam.se2 import SE2
from tests.slam.slow_twins import exhaustive_search
from tests.slam.synthetic import CLUTTERED_ROOM, sampled, scan_of

FEW = settings(max_examples=60, deadline=None)
COARSE = {
    "cell_m": 0.25,
    "max_points": 24,
    "max_heading_step_rad": math.radians(30.0),
    "min_heading_step_rad": math.radians(10.0),
    "block_headings_rad": math.radians(50.0),
}


def everywhere(points: np.ndarray) -> np.ndarray:
    return np.ones(len(points), dtype=bool)


def right_half(points: np.ndarray) -> np.ndarray:
    return points[:, 0] > 2.0


def room_grid(is_free=everywhere, **changed) -> LikelihoodGrid:
    walls = sampled(CLUTTERED_ROOM, 0.05)
    return LikelihoodGrid.of(walls, 5.0, is_free, SearchConfig(**{**COARSE, **changed}))


def room_points(pose: SE2) -> np.ndarray:
    return scan_of(CLUTTERED_ROOM, pose).points(SE2.identity())


def as_rows(candidates: list[Candidate]) -> list[tuple[float, ...]]:
    return [(*one.T_map_base.as_array().tolist(), one.score) for one in candidates]


@st.composite
def scenes(draw):
    """A grid of random walls, partly closed, and a scan that may have been taken nowhere."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    size_m = np.array([draw(st.floats(0.1, 4.5)), draw(st.floats(0.1, 4.5))])
    walls = rng.uniform(-0.5, 0.5, (draw(st.integers(1, 40)), 2)) * size_m
    config = SearchConfig(
        **COARSE,
        # narrow: all cells are 0 or nearly 255, and many poses tie
        sigma_m=draw(st.sampled_from([0.04, 0.25])),
        top_level=draw(st.integers(1, 4)),
        keep=draw(st.sampled_from([0.3, 0.6, 0.9, 1.0])),
        max_candidates=draw(st.sampled_from([1, 3, 10, 1000])),
    )
    open_share = draw(st.sampled_from([0.0, 0.1, 0.7, 1.0]))
    grid = LikelihoodGrid.of(
        walls, draw(st.sampled_from([0.5, 2.0, 9.0])),
        lambda points: rng.random(len(points)) < open_share, config,
    )  # fmt: skip
    points = rng.normal(0.0, draw(st.sampled_from([0.3, 1.0, 4.0])), (draw(st.integers(0, 30)), 2))
    if draw(st.booleans()):
        # as the walls look from one of the poses: a good match among many poor ones
        points = SE2(*rng.uniform(-0.5, 0.5, 2), rng.uniform(-3.0, 3.0)).inverse() @ walls
    return grid, points


@FEW
@given(scenes())
def test_search_returns_what_trying_every_pose_does(scene):
    grid, points = scene
    # poses and scores to the bit: both make them of the same whole numbers
    assert as_rows(grid.search(points)) == as_rows(exhaustive_search(grid, points))


@pytest.mark.parametrize("is_free", [everywhere, right_half])
@pytest.mark.parametrize(
    ("keep", "max_candidates"), [(0.3, 1000), (0.3, 1), (0.6, 5), (0.9, 64), (1.0, 64)]
)
def test_search_in_a_room_returns_what_trying_every_pose_does(keep, max_candidates, is_free):
    for top_level in (1, 2, 3, 4):
        config = {"keep": keep, "max_candidates": max_candidates, "top_level": top_level}
        grid = room_grid(is_free, **config)
        points = room_points(SE2(2.6, 1.3, 0.7))
        found = grid.search(points)
        assert 1 <= len(found) <= max_candidates
        assert as_rows(found) == as_rows(exhaustive_search(grid, points))
        assert all(is_free(one.T_map_base.as_array()[np.newaxis, :2]).all() for one in found)


def test_best_is_within_a_cell_and_a_step_of_where_the_scan_was_taken():
    true = SE2(2.6, 1.3, 0.7)
    best = room_grid(cell_m=0.1, max_heading_step_rad=math.radians(4.0),
                     min_heading_step_rad=math.radians(1.0)).search(room_points(true))[0]  # fmt: skip
    off = true.inverse() @ best.T_map_base
    assert math.hypot(off.x, off.y) < 0.1 * math.sqrt(2.0)
    assert abs(off.theta) < math.radians(4.0)
    # points half a cell off their walls, one sigma being a cell: exp(-1/8) and a little less
    assert best.score > 0.7


def test_scores_fall_and_no_block_comes_twice():
    grid = room_grid(keep=0.3, max_candidates=1000, top_level=2)
    points = room_points(SE2(1.2, 0.8, -2.0))
    found = grid.search(points)
    scores = [one.score for one in found]
    assert scores == sorted(scores, reverse=True)
    assert scores[-1] >= 0.3 * scores[0]
    headings = grid.headings(spread(points, 0.25, 24, grid.reach_m))
    group = round(COARSE["block_headings_rad"] * len(headings) / (2.0 * math.pi))
    blocks = set()
    for one in found:
        column, row = np.floor((one.T_map_base.as_array()[:2] - grid.origin_m) / 0.25).astype(int)
        h = round(one.T_map_base.theta % (2.0 * math.pi) / (headings[1] - headings[0]))
        blocks.add((row // 4, column // 4, h // group))
    assert len(blocks) == len(found)


def test_search_looks_at_far_fewer_nodes_than_there_are_poses():
    grid = room_grid(cell_m=0.1, min_heading_step_rad=math.radians(4.0), top_level=3)
    points = spread(room_points(SE2(2.6, 1.3, 0.7)), 0.1, 24, grid.reach_m)
    headings = grid.headings(points)
    rows, columns = grid.is_open.shape[1:]
    best = np.empty((rows // 8, columns // 8, len(headings)), np.int64)
    looked = best_of_blocks(
        grid.levels, grid.is_open, grid.columns, grid.pad, grid.offsets(points, headings), 1,
        0.6, 64, best, np.empty_like(best),
    )  # fmt: skip
    # without any bound it would look at all poses and at the nodes above them
    assert looked < 0.2 * rows * columns * len(headings)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 24, 80])
def test_score_is_the_sum_of_all_points_wherever_it_reaches_what_is_asked(count):
    rng = np.random.default_rng(count)
    for _ in range(20):
        # much in the last points: what is given up early might have been reached by them
        level = np.sort(rng.integers(0, 256, count)).astype(np.uint8)
        offsets, total = np.arange(count, dtype=np.int32), int(level.sum())
        for least in (0, 1, total - 1, total, total + 1, 255 * count):
            found = score_of(level, offsets, 0, least, 255 * count)
            assert found == total if total >= least else found < least


@pytest.mark.parametrize("top_level", [1, 2, 3, 4])
def test_upper_levels_are_the_maxima_of_what_is_below_and_open_where_any_is(top_level):
    rng = np.random.default_rng(top_level)
    walls = rng.uniform(0.0, 3.0, (12, 2))
    config = SearchConfig(**COARSE, top_level=top_level)
    grid = LikelihoodGrid.of(walls, 1.0, lambda points: rng.random(len(points)) < 0.03, config)
    levels = grid.levels.reshape(top_level + 1, -1, grid.columns)
    assert grid.is_open[0].any()
    for pyramid in (levels, grid.is_open):
        for level in range(top_level + 1):
            side = 2**level
            for r, c in np.ndindex(pyramid.shape[1:]):
                assert pyramid[level, r, c] == pyramid[0, r : r + side, c : c + side].max()


def test_lowest_level_is_the_likelihood_of_the_nearest_wall():
    wall = np.array([[0.1, 0.1]])
    config = SearchConfig(**COARSE, sigma_m=0.3, top_level=1)
    grid = LikelihoodGrid.of(wall, 1.0, everywhere, config)
    level = grid.levels[0].reshape(-1, grid.columns)
    for r, c in np.ndindex(level.shape):
        middle = grid.origin_m + (np.array([c, r]) - grid.pad + 0.5) * 0.25
        distance_m = math.hypot(*(middle - wall[0]))
        if distance_m < 1.2:  # 4 sigma; beyond it a cell is 0, where this is 0.08 at most
            assert level[r, c] == round(255.0 * math.exp(-0.5 * (distance_m / 0.3) ** 2))
        else:
            assert level[r, c] == 0


def test_positions_are_open_where_they_are_free():
    grid = room_grid(right_half)
    rows, columns = np.nonzero(grid.is_open[0])
    x = grid.origin_m[0] + (columns + 0.5) * 0.25
    # 4 m of cells are padded to a multiple of 8: 16 of 16 columns, half of them to the right
    assert x.min() == pytest.approx(2.125)
    assert len(set(columns)) == grid.is_open.shape[2] - 8
    assert set(rows) == set(range(grid.is_open.shape[1]))


def test_scan_without_points_in_reach_is_found_nowhere():
    grid = room_grid()
    assert grid.search(np.empty((0, 2))) == []
    # the map is 5 m across, so that points farther away lie on none of its walls
    assert grid.search(np.array([[1e6, 0.0], [0.0, -1e6], [6.0, 0.0]])) == []


def test_points_out_of_reach_change_nothing():
    grid, points = room_grid(), room_points(SE2(2.6, 1.3, 0.7))
    far = np.array([[1e6, 1e6], [-1e6, 3.0], [np.inf, 0.0], [np.nan, 1.0]])
    assert as_rows(grid.search(np.concatenate([far, points]))) == as_rows(grid.search(points))


@pytest.mark.parametrize("point", [[0.0, 0.0], [1.0, 0.0], [-0.3, 2.0]])
def test_single_point_is_found_at_every_wall(point):
    grid, points = room_grid(top_level=2, max_candidates=1000), np.array([point])
    found = grid.search(points)
    # 16 m of walls in blocks of 1 m: a dozen at the least, whatever the heading
    assert len(found) >= 12
    assert as_rows(found) == as_rows(exhaustive_search(grid, points))


def test_search_where_nothing_is_free_finds_nothing():
    grid = room_grid(lambda points: np.zeros(len(points), dtype=bool))
    assert grid.search(room_points(SE2(2.6, 1.3, 0.7))) == []


def test_map_too_large_to_search_is_refused_in_one_line():
    walls = np.array([[0.0, 0.0], [40_000.0, 3.0], [0.0, 30_000.0]])
    with pytest.raises(ValueError, match=r"4000\d by 3000\d m .* larger cell_m") as refused:
        LikelihoodGrid.of(walls, 30.0, everywhere)
    assert "\n" not in str(refused.value)


def test_map_without_walls_is_refused():
    with pytest.raises(ValueError, match="no walls"):
        LikelihoodGrid.of(np.empty((0, 2)), 5.0, everywhere)


def test_spread_takes_the_first_point_of_each_cell_in_their_order():
    points = np.array([[0.05, 0.05], [1.23, 0.0], [0.01, 0.09], [-0.05, 0.05], [9.0, 0.0]])
    taken = spread(points, 0.1, 80, reach_m=5.0)
    assert taken.tolist() == [[0.05, 0.05], [1.23, 0.0], [-0.05, 0.05]]


def test_spread_takes_at_most_so_many_evenly():
    points = np.column_stack([np.arange(1001) * 0.1 + 0.05, np.zeros(1001)])
    taken = spread(points, 0.1, 11, np.inf)
    np.testing.assert_array_equal(taken, points[::100])


def test_headings_are_so_close_that_most_points_move_by_a_cell_at_most():
    grid = room_grid(cell_m=0.1, min_heading_step_rad=1e-3, max_heading_step_rad=0.5)
    points = np.column_stack([np.linspace(0.5, 2.0, 31), np.zeros(31)])
    headings = grid.headings(points)
    step = headings[1] - headings[0]
    # three quarters; of 31 points that is 23 and a part of one
    assert np.count_nonzero(points[:, 0] * step <= 0.1 + 1e-9) >= 23
    assert headings[-1] + step == pytest.approx(2.0 * math.pi)


@pytest.mark.parametrize(
    "wrong",
    [
        {"cell_m": 0.0},
        {"sigma_m": -0.1},
        {"max_heading_step_rad": 0.001},
        {"top_level": 0},
        {"max_points": 0},
        {"max_candidates": 0},
        {"keep": 0.0},
        {"keep": 1.1},
    ],
)
def test_search_that_cannot_be_is_refused(wrong):
    with pytest.raises(ValueError, match=r"above 0|1 or more|\(0, 1\]"):
        SearchConfig(**wrong)

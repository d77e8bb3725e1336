"""Masks over the floor against slow, obvious versions of them."""

import numpy as np

from kitasap_sim.free_space import pulled_straight, steps_to, widened


def slow_widened(mask, radius_cells):
    middles, lit = np.indices(mask.shape).reshape(2, -1).T, np.argwhere(mask)
    if not len(lit):
        return np.zeros_like(mask)
    away = np.hypot(*(middles[:, None] - lit[None]).transpose(2, 0, 1))
    return (away.min(axis=1) <= radius_cells).reshape(mask.shape)


def slow_steps_to(is_open, seeds):
    steps = np.full(is_open.shape, -1)
    front = {tuple(seed) for seed in seeds.tolist() if is_open[tuple(seed)]}
    count = 0
    while front:
        for cell in front:
            steps[cell] = count
        beside = {(i + a, j + b) for i, j in front for a, b in ((0, 1), (1, 0), (0, -1), (-1, 0))}
        rows, columns = is_open.shape
        front = {
            (i, j)
            for i, j in beside
            if 0 <= i < rows and 0 <= j < columns and is_open[i, j] and steps[i, j] < 0
        }
        count += 1
    return steps


def masks(count):
    rng = np.random.default_rng(0)
    for _ in range(count):
        yield rng.random(tuple(rng.integers(1, 16, 2))) < rng.random(), rng


def test_widened_mask_holds_what_lies_within_the_radius():
    for mask, rng in masks(100):
        radius_cells = float(rng.choice([0.5, 1.0, 1.5, 3.0, 7.2]))
        assert np.array_equal(widened(mask, radius_cells), slow_widened(mask, radius_cells))


def test_steps_are_those_of_a_flood_cell_by_cell():
    for mask, rng in masks(100):
        # some seeds twice, some not open
        seeds = rng.integers(0, mask.shape, (int(rng.integers(0, 6)), 2))
        seeds = np.concatenate([seeds, seeds[:2]])
        steps = slow_steps_to(mask, seeds)
        assert np.array_equal(steps_to(mask, seeds), steps)
        # to a cell and no farther: what lies as near as that has its steps
        until = rng.integers(0, mask.shape)
        found = steps_to(mask, seeds, until)
        is_near = steps <= steps[tuple(until)]
        is_near |= steps[tuple(until)] < 0
        assert np.array_equal(found, np.where(is_near, steps, -1))


def test_way_pulled_straight_turns_at_its_corners_alone():
    points_m = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [2.0, 2.0]])

    def is_along_an_axis(start_m, end_m):
        return bool((start_m == end_m).any())

    def may_be(start_m, ends_m):
        return np.ones(len(ends_m), dtype=bool)

    corners_m = pulled_straight(points_m, is_along_an_axis, may_be)
    assert corners_m.tolist() == [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]]
    # the next point always is in sight
    assert np.array_equal(pulled_straight(points_m, lambda start_m, end_m: False, may_be), points_m)


def test_the_quick_look_along_a_way_never_tells_a_free_one_from_it(box_room):
    rng = np.random.default_rng(4)
    spots_m = np.array([box_room.draw_free_pose(rng)[:2] for _ in range(40)])
    told = 0
    for start_m in spots_m:
        is_free = np.array([box_room.is_way_free(start_m, end_m) for end_m in spots_m])
        may_be = box_room._may_be_free(start_m, spots_m)
        assert may_be[is_free].all()
        told += int((~may_be).sum())
    assert told > 100

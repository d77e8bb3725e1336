"""Walls joined and thinned."""

import time

import numpy as np
import pytest

from slam.surface.segments import joined, simplified
from tests.slam.synthetic import ROOM_SEGMENTS, round_wall

SQUARE = np.array(
    [
        [[0.0, 0.0], [2.0, 0.0]],
        [[2.0, 0.0], [2.0, 1.0]],
        [[2.0, 1.0], [0.0, 1.0]],
        [[0.0, 1.0], [0.0, 0.0]],
    ]
)


def lengths_m(segments: np.ndarray) -> np.ndarray:
    return np.hypot(*(segments[:, 1] - segments[:, 0]).T)


def sorted_rows(segments: np.ndarray) -> np.ndarray:
    rows = np.round(segments.reshape(-1, 4), 9) + 0.0
    return rows[np.lexsort(rows.T[::-1])]


def split(segments: np.ndarray, parts: int) -> np.ndarray:
    """Each segment in so many equal pieces, in the same direction."""
    shares = np.linspace(0.0, 1.0, parts + 1)[:, np.newaxis]
    lines = [a + shares * (b - a) for a, b in segments]
    return np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines])


def signed_area_m2(segments: np.ndarray) -> float:
    a, b = segments[:, 0], segments[:, 1]
    return float(0.5 * np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))


def distance_to_m(points: np.ndarray, segments: np.ndarray) -> np.ndarray:
    a, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    share = np.einsum("kij,ij->ki", points[:, np.newaxis] - a, along) / np.sum(along**2, axis=1)
    feet = a + np.clip(share, 0.0, 1.0)[..., np.newaxis] * along
    return np.hypot(*np.moveaxis(points[:, np.newaxis] - feet, 2, 0)).min(axis=1)


def test_touching_and_overlapping_pieces_of_one_line_are_one_wall():
    line = np.array([[0.0, 0.5, 0.4, 1.0, 1.0, 1.6, 3.0, 3.5]]).reshape(-1, 2)
    # along 3 : 4, so that no coordinate is special
    pieces = np.stack([line * 0.6, line * 0.8], axis=2)
    united = sorted_rows(joined(pieces))
    # a gap of 1.4 m stays one
    expected = [[0.0, 0.0, 0.96, 1.28], [1.8, 2.4, 2.1, 2.8]]
    np.testing.assert_allclose(united, expected, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_split_and_shuffled_walls_come_back_whole(seed):
    rng = np.random.default_rng(seed)
    pieces = rng.permutation(split(ROOM_SEGMENTS, 7))
    # rounding of the splits alone: 1e-15 m; sorted at 1e-9
    np.testing.assert_allclose(
        sorted_rows(joined(pieces)), sorted_rows(ROOM_SEGMENTS), rtol=0.0, atol=1e-9
    )


def test_lines_of_all_directions_are_joined_each_by_itself():
    # backwards along x, where the angle is pi as well as -pi, and lines a hair apart
    rng = np.random.default_rng(4)
    lines = []
    for angle in [np.pi, -np.pi, np.pi - 4e-6, 0.3, 0.3 + 4e-6, *rng.uniform(-np.pi, np.pi, 30)]:
        start, along = rng.uniform(-50.0, 50.0, 2), np.array([np.cos(angle), np.sin(angle)])
        lines.append([start, start + rng.uniform(1.0, 3.0) * along])
    pieces = rng.permutation(split(np.array(lines), 9))
    united = joined(pieces)
    assert len(united) == len(lines)
    np.testing.assert_allclose(sorted_rows(united), sorted_rows(np.array(lines)), atol=1e-7)


def test_backwards_along_x_is_one_direction_whichever_its_sign():
    # the last digit of y makes the angle of the one pi, and of the other -pi
    both = np.array([[[2.0, 0.0], [1.0, 1e-12]], [[1.0, 1e-12], [0.0, 0.0]]])
    assert len(joined(both)) == 1


def building(lines: int) -> np.ndarray:
    """So many parallel walls, half of them either way, each in ten pieces."""
    at = np.arange(0.5 * lines)
    ends = [np.column_stack([np.full_like(at, x), at]) for x in (0.0, 9.9)]
    rows = np.stack(ends, axis=1)
    return split(np.concatenate([rows, rows[:, ::-1, ::-1]]), 10)


def test_time_of_joining_grows_with_the_walls_and_not_with_their_square():
    spent_s = {200: [], 1600: []}
    pieces = {lines: building(lines) for lines in spent_s}
    for _ in range(4):  # by turns, so that both meet the machine in the same mood
        for lines, spent in spent_s.items():
            begin_s = time.process_time()
            assert len(joined(pieces[lines])) == lines
            spent.append(time.process_time() - begin_s)
    # eight times as many take 8 times as long; where each met each, it was 50
    assert min(spent_s[1600]) < 20.0 * min(spent_s[200])


def test_pieces_of_opposite_directions_stay_apart():
    both = np.array([[[0.0, 0.0], [1.0, 0.0]], [[1.5, 0.0], [0.5, 0.0]]])
    np.testing.assert_allclose(sorted_rows(joined(both)), sorted_rows(both), atol=1e-12)


def test_parallel_lines_a_hundredth_of_a_millimetre_apart_stay_apart():
    both = np.array([[[0.0, 0.0], [1.0, 0.0]], [[0.5, 1e-5], [1.5, 1e-5]]])
    assert len(joined(both)) == 2


def test_pieces_at_an_angle_are_not_joined():
    # a milliradian at a common end: a hundred times what counts as the same direction
    bent = np.array([[[0.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [2.0, 1e-3]]])
    assert len(joined(bent)) == 2


def test_segments_without_length_are_dropped_and_nothing_gives_nothing():
    dot = np.array([[[1.0, 1.0], [1.0, 1.0 + 5e-7]]])
    assert joined(dot).shape == (0, 2, 2)
    assert joined(np.empty((0, 2, 2))).shape == (0, 2, 2)
    assert len(joined(np.concatenate([dot, SQUARE]))) == 4
    assert simplified(np.empty((0, 2, 2)), 1e-3).shape == (0, 2, 2)


@pytest.mark.parametrize("tolerance_m", [1e-4, 1e-3, 1e-2])
def test_circle_of_facets_is_thinned_within_the_tolerance(tolerance_m):
    circle = round_wall(0.3, 128)
    thinned = simplified(circle, tolerance_m)
    assert distance_to_m(circle[:, 0], thinned).max() <= tolerance_m + 1e-12
    # n chords of a circle are r (1 - cos(pi / n)) off: so many at least are needed, and halving
    # where it is worst makes four times as many at most
    least = np.pi / np.arccos(1.0 - tolerance_m / 0.3) / np.sqrt(2.0)
    assert least <= len(thinned) <= min(128, 4.0 * least)
    # leaving out one corner of 128 is r (1 - cos(2 pi / 128)) = 0.36 mm off
    assert (len(thinned) < 128) == (tolerance_m > 0.36e-3)


def test_thinned_circle_stays_closed_and_keeps_its_sense():
    for circle in (round_wall(0.3, 128), round_wall(0.3, 128)[::-1, ::-1]):
        thinned = simplified(np.random.default_rng(0).permutation(circle), 1e-3)
        starts, ends = (sorted(map(tuple, thinned[:, side].tolist())) for side in (0, 1))
        assert starts == ends
        # a tolerance of 1 mm all round takes 2 pi r mm2 of area at most, and turns no sign
        assert signed_area_m2(thinned) == pytest.approx(signed_area_m2(circle), abs=2e-3)


def test_corners_stay_and_points_on_the_way_go():
    np.testing.assert_allclose(
        sorted_rows(simplified(split(SQUARE, 8), 1e-4)), sorted_rows(SQUARE), atol=1e-9
    )
    # an open chain: an L
    el = split(SQUARE[:2], 8)
    np.testing.assert_allclose(
        sorted_rows(simplified(el, 1e-4)), sorted_rows(SQUARE[:2]), atol=1e-9
    )


def test_closed_chain_that_starts_amid_a_wall_loses_no_corner():
    ring = np.roll(split(SQUARE, 8), 3, axis=0)
    thinned = simplified(ring, 1e-4)
    corners = SQUARE[:, 0]
    assert distance_to_m(corners, thinned).max() < 1e-9
    assert lengths_m(thinned).sum() == pytest.approx(6.0)
    # one more corner where the ring is cut open, and its opposite
    assert len(thinned) <= 6


def test_kink_above_the_tolerance_stays_and_one_below_goes():
    kink = np.array([[[0.0, 0.0], [1.0, 1.1e-3]], [[1.0, 1.1e-3], [2.0, 0.0]]])
    assert len(simplified(kink, 1e-3)) == 2
    assert len(simplified(kink, 1.2e-3)) == 1


def test_branching_walls_keep_their_node_and_their_length():
    # three walls meet in one point; each has a point on the way that goes
    arms = np.array([[[0.0, 0.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]], [[-1.0, 0.0], [0.0, 0.0]]])
    thinned = simplified(split(arms, 4), 1e-4)
    np.testing.assert_allclose(sorted_rows(thinned), sorted_rows(arms), atol=1e-9)


def test_two_rings_that_touch_in_a_point_keep_all_their_walls():
    far = SQUARE - [2.0, 1.0]  # shares the corner (0, 0) of one and (2, 1) of the other
    thinned = simplified(np.concatenate([SQUARE, far]), 1e-4)
    assert lengths_m(thinned).sum() == pytest.approx(12.0)


@pytest.mark.parametrize("seed", range(3))
def test_order_of_the_segments_changes_no_wall(seed):
    rng = np.random.default_rng(seed)
    plain = simplified(split(ROOM_SEGMENTS, 5), 1e-4)
    mixed = simplified(rng.permutation(split(ROOM_SEGMENTS, 5)), 1e-4)
    assert lengths_m(mixed).sum() == pytest.approx(lengths_m(plain).sum())
    assert distance_to_m(mixed.reshape(-1, 2), plain).max() < 1e-9
    assert distance_to_m(plain.reshape(-1, 2), mixed).max() < 1e-9


def test_same_wall_in_both_directions_stays_in_both():
    sheet = np.concatenate([split(SQUARE[:1], 4), split(SQUARE[:1], 4)[:, ::-1]])
    thinned = joined(sheet)
    assert sorted_rows(thinned).tolist() == [[0.0, 0.0, 2.0, 0.0], [2.0, 0.0, 0.0, 0.0]]
    # both hang together at both ends; no length may get lost
    assert lengths_m(simplified(sheet, 1e-4)).sum() == pytest.approx(4.0)

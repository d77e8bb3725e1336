"""Which side of a cut surface is open: shown by points on either side of it."""

import numpy as np
import pytest

from kitasap_sim.facing import facing_out

BOX = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
EL = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]])


def outline(corners: np.ndarray) -> np.ndarray:
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def shuffled(segments: np.ndarray, seed: int) -> np.ndarray:
    """In any order, each in any direction: a mesh says nothing of either."""
    rng = np.random.default_rng(seed)
    flips = rng.random(len(segments)) < 0.5
    return rng.permutation(np.where(flips[:, None, None], segments[:, ::-1], segments))


def beside(segments: np.ndarray, share: float, aside_m: float) -> np.ndarray:
    """(S, 2) points at that share of each segment, so far to its left."""
    along = segments[:, 1] - segments[:, 0]
    left = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
    return segments[:, 0] + share * along + aside_m * left


def in_box(points: np.ndarray) -> np.ndarray:
    return ((points > [0.0, 0.0]) & (points < [2.0, 1.0])).all(axis=1)


def in_el(points: np.ndarray) -> np.ndarray:
    low = ((points > 0.0) & (points < [3.0, 1.0])).all(axis=1)
    return low | ((points > 0.0) & (points < [1.0, 3.0])).all(axis=1)


def in_ring(points: np.ndarray) -> np.ndarray:
    radius_m = np.hypot(*points.T)
    return (radius_m > 0.5) & (radius_m < 1.0)


def circle(radius_m: float, count: int = 40) -> np.ndarray:
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False) + 0.1
    return outline(radius_m * np.column_stack([np.cos(angles), np.sin(angles)]))


@pytest.mark.parametrize("turn_rad", [0.0, 0.3, np.pi / 2, 2.0])
@pytest.mark.parametrize(
    ("solid", "is_inside"),
    [(outline(BOX), in_box), (outline(EL), in_el)],
)
def test_left_of_each_side_is_open_and_its_right_solid(solid, is_inside, turn_rad):
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[c, s], [-s, c]])
    for seed in range(3):
        facing = facing_out(shuffled(solid @ turn, seed)) @ turn.T
        assert len(facing) == len(solid)
        for share in (0.05, 0.5, 0.95):
            assert not is_inside(beside(facing, share, 0.01)).any()
            assert is_inside(beside(facing, share, -0.01)).all()


def test_hole_of_a_ring_is_open_too():
    # 3 mm inside: chords of 40 lie 3.1 mm inside their circle at the middle
    solid = np.concatenate([circle(1.0), circle(0.5)])
    facing = facing_out(shuffled(solid, 0))
    assert len(facing) == 80
    assert not in_ring(beside(facing, 0.5, 0.01)).any()
    assert in_ring(beside(facing, 0.5, -0.01)).all()


def test_single_wall_is_seen_from_both_sides():
    wall = np.array([[[0.0, 0.0], [1.0, 2.0]]])
    facing = facing_out(wall)
    assert facing.tolist() == [[[0.0, 0.0], [1.0, 2.0]], [[1.0, 2.0], [0.0, 0.0]]]


@pytest.mark.parametrize(
    "turn_rad",
    [
        0.0,
        np.pi / 2,
    ],
)
def test_sheet_in_three_pieces_is_seen_from_both_sides(turn_rad):
    along = np.array([np.cos(turn_rad), np.sin(turn_rad)])
    ends = np.outer([0.0, 1.0, 2.0, 3.0], along)
    facing = facing_out(np.stack([ends[:-1], ends[1:]], axis=1))
    headings = (facing[:, 1] - facing[:, 0]) @ along
    assert sorted(headings.round(9).tolist()) == [-1.0] * 3 + [1.0] * 3


def test_pieces_without_length_are_dropped_and_nothing_stays_nothing():
    dot = np.full((1, 2, 2), 0.5)
    assert len(facing_out(np.concatenate([outline(BOX), dot]))) == 4
    assert facing_out(np.empty((0, 2, 2))).shape == (0, 2, 2)


def test_many_segments_face_out_as_few_do():
    # more than are looked at in one part
    facing = facing_out(shuffled(circle(1.0, 1000), 1))
    assert len(facing) == 1000
    assert (np.hypot(*beside(facing, 0.5, 0.01).T) > 1.0).all()

"""Masks tiled by rectangles: every cell once, no other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from kitasap_sim.rectangles import rectangles


def times_covered(boxes: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    counts = np.zeros(shape, dtype=int)
    for low, left, high, right in boxes.tolist():
        assert 0 <= low < high <= shape[0]
        assert 0 <= left < right <= shape[1]
        counts[low:high, left:right] += 1
    return counts


@settings(max_examples=100, deadline=None)
@given(arrays(bool, array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.booleans()))
def test_rectangles_cover_the_mask_exactly_and_nothing_twice(mask):
    boxes = rectangles(mask, mask.size)
    np.testing.assert_array_equal(times_covered(boxes, mask.shape), mask)


@pytest.mark.parametrize("share", [0.02, 0.5, 0.98])
def test_rectangles_cover_large_grids(share):
    mask = np.random.default_rng(5).random((150, 90)) < share
    boxes = rectangles(mask, mask.size)
    np.testing.assert_array_equal(times_covered(boxes, mask.shape), mask)


def test_the_mask_stays_as_it_was():
    mask = np.ones((3, 4), dtype=bool)
    assert rectangles(mask, 1).tolist() == [[0, 0, 3, 4]]
    assert mask.all()


def test_a_room_takes_its_four_walls():
    mask = np.ones((40, 60), dtype=bool)
    mask[2:-2, 2:-2] = False
    assert len(rectangles(mask, 4)) == 4


def test_no_cell_takes_no_rectangle():
    assert rectangles(np.zeros((3, 3), dtype=bool), 0).shape == (0, 4)


def test_more_rectangles_than_allowed_are_refused():
    with pytest.raises(ValueError, match=r"^more than 7 rectangles$"):
        rectangles(np.eye(9, dtype=bool), 7)

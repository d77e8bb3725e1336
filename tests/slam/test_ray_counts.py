"""What scans hit and what they saw through: counted by scans, and what stands by that."""

import math

import numpy as np
import pytest

from slam.beams import Beams
from slam.ray_counts import RayCounts, still_standing
from slam.se2 import SE2

POSE = SE2(0.05, 0.05, 0.0)


def one_beam(range_m: float) -> Beams:
    return Beams(np.zeros((1, 2)), np.zeros(1), np.array([range_m]))


def looks(*ranges_m: float) -> list[tuple[SE2, Beams]]:
    """Scans of one beam each, along y = 0.05 m."""
    return [(POSE, one_beam(range_m)) for range_m in ranges_m]


def test_each_scan_counts_once_where_it_ends_and_once_where_it_passes():
    counts = RayCounts.of(looks(0.2, 0.2, 0.3), 0.1)
    assert counts.hits.tolist() == [[0, 0, 2, 1]]
    assert counts.misses.tolist() == [[3, 3, 1, 0]]
    np.testing.assert_array_equal(counts.corner_m, [0.0, 0.0])


def test_beam_without_return_passes_as_far_as_it_is_trusted():
    counts = RayCounts.of(looks(math.inf), 0.1, free_range_m=0.2)
    assert counts.hits.tolist() == [[0, 0, 0]]
    assert counts.misses.tolist() == [[1, 1, 1]]


@pytest.mark.parametrize(("seen_through", "stands"), [(9, True), (10, False)])
def test_point_stands_until_nine_of_ten_looks_go_through_it(seen_through, stands):
    scans = looks(0.5, *[1.0] * seen_through)
    found = still_standing([[0.55, 0.05], [1.05, 0.05]], scans)
    assert found.tolist() == [stands, True]


def test_points_off_the_grid_stand():
    # as when a mean of points has moved off it: nothing was seen there
    off = [[-0.01, 0.05], [0.05, -0.01], [1.2, 0.05], [0.05, 0.2], [1e9, 0.0]]
    assert still_standing(off, looks(1.0)).all()
    with pytest.raises(ValueError, match="points"):
        still_standing([[math.nan, 0.0]], looks(1.0))

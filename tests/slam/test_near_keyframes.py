"""Which keyframes lie near one of them."""

import numpy as np
import pytest

from slam.kernels.near_keyframes import alike, seen_before
from slam.se2 import wrap_angle


def _drive(rng, count):
    """(K, 3) poses of a robot that wanders about."""
    return np.column_stack(
        [np.cumsum(rng.normal(0.0, 0.8, (count, 2)), axis=0), rng.uniform(-9, 9, count)]
    )


def test_those_alike_are_as_near_and_turned_as_little():
    rng = np.random.default_rng(31)
    poses, found = _drive(rng, 200), np.empty(200, np.int64)
    for index in range(0, 200, 20):
        off_m = np.hypot(*(poses[:, :2] - poses[index, :2]).T)
        turned_rad = np.abs(wrap_angle(poses[:, 2] - poses[index, 2]))
        count = alike(poses, index, 4.0, 1.0, found)
        np.testing.assert_array_equal(
            found[:count], np.flatnonzero((off_m < 4.0) & (turned_rad < 1.0))
        )


@pytest.mark.parametrize("starts", [[], [40, 90], [40, 40, 120], [0, 1, 199]])
@pytest.mark.parametrize(("first", "end"), [(0, 200), (30, 80)])
def test_those_seen_before_are_near_and_of_another_time(starts, first, end):
    rng = np.random.default_rng(37)
    poses, sigma_m = _drive(rng, 200), rng.uniform(0.0, 3.0, 200)
    found, away_m = np.empty(200, np.int64), np.empty(200)
    ways_m = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    for start in starts:
        ways_m[max(start - 1, 0) : start] += 6.0
    way_m = np.concatenate([[0.0], np.cumsum(ways_m)])
    for later in (0, 1, 41, 120, 199):
        off_m = np.hypot(*(poses[:later, :2] - poses[later, :2]).T)
        is_near = off_m <= 3.0 + np.minimum(2.0 * sigma_m[:later], 2.5)
        is_near &= way_m[later] - way_m[:later] > 6.0
        expected = [k for k in np.flatnonzero(is_near)[::-1] if first <= k < end]
        turned_rad = np.abs(wrap_angle(poses[expected, 2] - poses[later, 2]))
        count = seen_before(
            poses,
            later,
            np.array(starts, np.int64),
            6.0,
            3.0,
            sigma_m,
            2.5,
            first,
            end,
            found,
            away_m,
        )
        np.testing.assert_array_equal(found[:count], expected)
        np.testing.assert_allclose(away_m[:count], off_m[expected] + 0.5 * turned_rad)

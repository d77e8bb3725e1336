"""Scans set against each other: which pairs, and of drives that go the same way over and over."""

import tracemalloc

import numpy as np
import pytest

from slam.kernels.near_keyframes import pairs_near
from slam.map_checks.map_consistency import judged
from slam.mapping import Mapper
from tests.slam import ring


@pytest.fixture(scope="module")
def slam_map():
    mapper = Mapper(ring.T_BASE_LASER)
    for measurement in ring.drive(ring.way(1.3), np.random.default_rng(0)):
        mapper.update(measurement)
    return mapper.finish()


@pytest.mark.parametrize("is_within", [True, False])
@pytest.mark.parametrize("every", [1, 7])
def test_pairs_are_those_near_one_another_in_order_and_evenly_thinned(is_within, every):
    rng = np.random.default_rng(3)
    # to and fro through a building, so that many lie too far off, and in a row
    poses = np.cumsum(rng.normal(0.0, 0.7, (400, 3)), axis=0) % 9.0
    asked = np.flatnonzero(rng.random(400) < 0.7)
    pieces = np.sort(rng.integers(0, 3, len(asked)))
    expected = [
        (one, other)
        for a, one in enumerate(asked)
        for b, other in enumerate(asked)
        if other - one > 10
        and np.hypot(*(poses[one] - poses[other])[:2]) <= 2.0
        and (pieces[a] == pieces[b]) is np.bool_(is_within)
    ]
    found = np.full((2000, 2), -1)
    count = pairs_near(poses, asked, pieces, is_within, 2.0, 10, every, found)
    assert count == len(expected) > 60
    kept = expected[::every]
    assert found[: len(kept)].tolist() == [list(pair) for pair in kept[:2000]]
    # there may be no room for any
    none = np.empty((0, 2), np.int64)
    assert pairs_near(poses, asked, pieces, is_within, 2.0, 10, 1, none) == count


@pytest.mark.parametrize("off_m", [0.0, 0.6])
def test_scans_are_asked_however_often_the_robot_comes_by_again(slam_map, off_m):
    poses = slam_map.poses.copy()
    poses[len(poses) // 2 :, :2] += off_m
    first = judged(slam_map.keyframes, poses, slam_map.loops, ())
    assert first.pairs > 500
    assert first.is_good is (off_m == 0.0)
    # eight times there and back, and nothing new to be seen
    again = [one.place_alone() for one in slam_map.keyframes]
    keyframes = [*slam_map.keyframes, *([*again[::-1], *again] * 8)]
    laps = np.concatenate([poses, *([poses[::-1], poses] * 8)])
    if off_m == 0.0:  # the other one would take ten times as long
        tracemalloc.start()
    assert judged(keyframes, laps, slam_map.loops, ()) == first
    _, most_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # of all pairs, whether their scans are kept or not, a list took some twenty times as much
    assert most_bytes < 20e6

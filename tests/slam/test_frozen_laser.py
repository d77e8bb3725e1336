"""A laser that gives old scans once more."""

import numpy as np
import pytest

from slam.frozen_laser import FrozenLaser
from slam.measurements import LaserScan


def scan(seed: int, count: int = 20) -> LaserScan:
    """One of its own."""
    ranges_m = np.random.default_rng(seed).uniform(1.0, 4.0, count)
    return LaserScan(0.0, np.linspace(-1.0, 1.0, count), ranges_m)


def without(one: LaserScan, *beams: int) -> LaserScan:
    """The same scan, some beams of which did not come back."""
    ranges_m = one.ranges_m.copy()
    ranges_m[list(beams)] = np.inf
    return LaserScan(one.time_s, one.angles_rad, ranges_m)


BLANK = without(scan(0), *range(20))


@pytest.mark.parametrize(
    "between",
    [
        (),
        (BLANK,) * 9,
        (scan(1), scan(2), scan(3)),
        (scan(1, count=30),),
        (scan(1, count=10), BLANK),
    ],
)
def test_a_scan_is_known_again_whatever_came_between(between):
    laser = FrozenLaser()
    assert not laser.repeats(scan(0))
    for one in between:
        assert not laser.repeats(one)
    assert laser.repeats(scan(0))


def test_one_of_four_before_is_forgotten():
    laser = FrozenLaser()
    assert [laser.repeats(scan(seed)) for seed in (0, 1, 2, 3, 4, 0)] == [False] * 6


def test_a_scan_that_comes_again_takes_nobody_s_place():
    laser = FrozenLaser()
    said = [laser.repeats(scan(seed)) for seed in (0, 1, 2, 3, 3, 3, 0)]
    assert said == [False] * 4 + [True] * 3


@pytest.mark.parametrize(("gone", "is_same"), [((3,), True), ((3, 4, 5), False)])
def test_a_few_beams_may_be_gone(gone, is_same):
    laser = FrozenLaser()
    laser.repeats(scan(0))
    assert laser.repeats(without(scan(0), *gone)) is is_same


def test_one_beam_that_differs_makes_another_scan():
    laser, first = FrozenLaser(), scan(0)
    laser.repeats(first)
    ranges_m = first.ranges_m.copy()
    ranges_m[7] += 1e-12
    assert not laser.repeats(LaserScan(0.0, first.angles_rad, ranges_m))


def test_the_first_beams_of_a_longer_scan_are_no_scan_of_a_shorter_one():
    laser, longer = FrozenLaser(), scan(0, count=30)
    laser.repeats(longer)
    assert not laser.repeats(LaserScan(0.0, longer.angles_rad[:20], longer.ranges_m[:20]))


def test_blank_scans_are_not_the_same():
    laser = FrozenLaser()
    assert [laser.repeats(BLANK) for _ in range(3)] == [False] * 3

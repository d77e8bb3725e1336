"""Scans that look as one shortly before did."""

import numpy as np
import pytest

from slam.beams import Beams
from slam.frontend.still_scans import StillScans
from slam.se2 import SE2

ANGLES_RAD = np.radians(np.arange(-90.0, 91.0))
RANGES_M = np.random.default_rng(3).uniform(1.0, 5.0, len(ANGLES_RAD))


def beams(ranges_m: np.ndarray) -> Beams:
    return Beams(np.zeros((len(ranges_m), 2)), ANGLES_RAD[: len(ranges_m)], ranges_m)


def other(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(1.0, 5.0, len(ANGLES_RAD))


def at(x_m: float) -> SE2:
    return SE2(x_m, 0.0, 0.0)


def changed(count: int, to_m: float) -> np.ndarray:
    """Ranges of which so many are another."""
    ranges_m = RANGES_M.copy()
    ranges_m[:count] = to_m
    return ranges_m


@pytest.mark.parametrize(
    ("ranges_m", "is_same"),
    [
        (RANGES_M, True),
        (RANGES_M + 0.04, True),
        (RANGES_M * 1.01 + 0.02, True),
        (RANGES_M + 0.15, False),
        (changed(10, 9.0), True),  # somebody passes by
        (changed(30, 9.0), False),
        (changed(10, np.inf), True),
        (changed(30, np.inf), False),
        (changed(10, np.nan), True),
        (RANGES_M[:-1], False),  # another laser
        (np.full(len(RANGES_M), np.inf), False),
    ],
)
def test_scans_are_the_same_but_for_noise_and_who_passes_by(ranges_m, is_same):
    still = StillScans()
    assert still.place(beams(ranges_m), at(0.0), 0.5) is None
    still.take(beams(RANGES_M), at(0.0))
    assert (still.place(beams(ranges_m), at(0.0), 0.5) == at(0.0)) is is_same


def test_scans_without_returns_look_like_none():
    still, nothing = StillScans(), beams(np.full(len(RANGES_M), np.inf))
    still.take(nothing, at(0.0))
    assert still.place(nothing, at(0.0), 0.5) is None


def test_the_first_place_is_taken_for_those_that_wheels_led_to_while_it_stood():
    still = StillScans()
    for x_m, ranges_m in (
        (0.0, other(1)),
        (0.3, changed(2, 9.0)),
        (0.4, RANGES_M),
        (0.5, RANGES_M),
    ):
        still.take(beams(ranges_m), at(x_m))
    assert still.place(beams(RANGES_M + 0.01), at(0.5), 0.1) == at(0.3)


@pytest.mark.parametrize(
    ("way_m", "between", "is_told"),
    [
        (0.1, RANGES_M, True),
        (0.2, RANGES_M, False),  # it may be as far on, where pillars look the same
        (0.1, other(1), False),  # what lies between looked otherwise
    ],
)
def test_farther_back_it_stood_only_if_all_since_looked_the_same_a_short_way(
    way_m, between, is_told
):
    still = StillScans()
    for x_m, ranges_m in ((0.0, RANGES_M), (0.2, between), (0.4, RANGES_M)):
        still.take(beams(ranges_m), at(x_m))
    expected = at(0.0) if is_told else None
    assert still.place(beams(RANGES_M), at(0.4), way_m) == expected


def test_that_which_is_most_the_same_goes_before_one_that_is_less():
    still = StillScans()
    still.take(beams(changed(12, 9.0)), at(0.0))  # from farther back along a corridor
    still.take(beams(RANGES_M), at(0.3))
    assert still.place(beams(RANGES_M), at(0.3), 0.5) == at(0.3)


def test_scans_from_far_back_are_not_asked():
    still = StillScans()
    still.take(beams(RANGES_M), at(0.0))
    assert still.place(beams(RANGES_M), at(0.9), 0.1) == at(0.0)
    assert still.place(beams(RANGES_M), at(1.1), 0.1) is None


def test_scans_of_another_laser_are_others():
    still = StillScans()
    still.take(beams(RANGES_M), at(0.0))
    still.take(beams(RANGES_M[:-1]), at(0.01))
    assert still.place(beams(RANGES_M), at(0.0), 0.1) is None
    assert still.place(beams(RANGES_M[:-1]), at(0.0), 0.1) == at(0.01)


def test_where_a_robot_stands_one_scan_is_kept_of_all_and_of_a_way_the_last_ones():
    still = StillScans()
    for k in range(100):
        still.take(beams(RANGES_M if k == 0 else other(k)), at(0.0004 * k))
    assert still.place(beams(RANGES_M), at(0.04), 0.5) == at(0.0)
    for k in range(16):
        still.take(beams(other(1000 + k)), at(0.1 + 0.055 * k))
    assert still.place(beams(RANGES_M), at(0.1), 0.5) is None
    for k in range(16):
        place = at(0.1 + 0.055 * k)
        assert still.place(beams(other(1000 + k)), place, 0.5) == place


def test_poses_that_are_no_more_what_they_were_are_forgotten():
    still = StillScans()
    still.take(beams(RANGES_M), at(0.0))
    still.forget()
    assert still.place(beams(RANGES_M), at(0.0), 0.5) is None
    still.take(beams(RANGES_M), at(5.0))
    assert still.place(beams(RANGES_M), at(5.0), 0.5) == at(5.0)


def test_the_last_scans_are_kept_in_their_order_however_many_there_were():
    still = StillScans()
    for k in range(100):
        still.take(beams(other(k)), at(0.1 * k))
        for back in (0, 7, 15, 16):
            place = (
                None if k < back else still.place(beams(other(k - back)), at(0.1 * (k - back)), 9.0)
            )
            assert place == (None if k < back or back == 16 else at(0.1 * (k - back)))

"""Beams of scans by one laser: what they share is computed once."""

import math

import numpy as np
import pytest

from slam.arrays import diagonal_of, frozen_array
from slam.beams import Beams
from slam.measurements import LaserScan
from slam.se2 import SE2
from slam.straightening import Straightener

MOUNT = SE2(0.1, -0.05, 0.2)


def scan(time_s: float, angles_rad: np.ndarray, range_m: float) -> LaserScan:
    return LaserScan(time_s, angles_rad, np.full(len(angles_rad), range_m))


def frozen_angles(first_rad: float, last_rad: float, count: int = 7) -> np.ndarray:
    return frozen_array(np.linspace(first_rad, last_rad, count), (None,), "angles_rad")


def test_values_that_are_frozen_already_are_not_copied():
    angles_rad = frozen_angles(-1.0, 1.0)
    assert frozen_array(angles_rad, (None,), "angles_rad") is angles_rad
    assert scan(0.0, angles_rad, 2.0).angles_rad is scan(1.0, angles_rad, 3.0).angles_rad


def test_values_that_others_may_change_are_copied():
    values = np.zeros(3)
    view = values.view()
    view.flags.writeable = False
    for given in (values, view, [0.0, 0.0, 0.0], view.astype(np.float32)):
        frozen = frozen_array(given, (3,), "values")
        values[:] = 1.0
        assert frozen.tolist() == [0.0, 0.0, 0.0]
        values[:] = 0.0
    with pytest.raises(ValueError, match=r"must have shape \(2\)"):
        frozen_array(frozen, (2,), "values")


def test_deviations_of_a_configuration_may_be_a_list():
    assert diagonal_of([1.0, 2.0]).tolist() == [[1.0, 0.0], [0.0, 4.0]]
    assert diagonal_of((1.0, 2.0)) is diagonal_of([1.0, 2.0])


def test_beams_with_other_ranges_are_as_if_made_anew():
    at = np.array([[0.0, 0.0], [0.1, 0.0], [0.2, 0.1]])
    for origins_m in (np.full((3, 2), 0.3), at):
        one = Beams(origins_m, [-0.5, 0.0, 0.7], [1.0, 2.0, 3.0])
        assert len(one.points) == 3
        other = one.with_ranges(np.array([3.0, np.inf, 1.0]))
        anew = Beams(origins_m, [-0.5, 0.0, 0.7], [3.0, np.inf, 1.0])
        assert (other.points == anew.points).all()
        assert (other.middle_m == anew.middle_m).all()
        assert other.spread_m == anew.spread_m
        assert all(
            (x == y).all() for x, y in zip(other.from_middle(), anew.from_middle(), strict=True)
        )
    with pytest.raises(ValueError, match="ranges_m"):
        one.with_ranges(np.ones(2))


def test_where_beams_look_is_kept_from_scan_to_scan_of_one_laser_alone():
    wide, narrow = frozen_angles(-1.5, 1.5), frozen_angles(-0.5, 0.5)
    straightener = Straightener(MOUNT)
    first = straightener.beams(scan(0.0, wide, 2.0))
    second = straightener.beams(scan(0.1, wide, 3.0))
    assert second.directions is first.directions
    assert (second.points == Beams.of(scan(0.1, wide, 3.0), MOUNT).points).all()
    other = straightener.beams(scan(0.2, narrow, 3.0))
    assert (other.points == Beams.of(scan(0.2, narrow, 3.0), MOUNT).points).all()
    assert math.isclose(float(other.angles_rad[0]), 0.2 - 0.5)

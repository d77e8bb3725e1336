"""Halls of which nothing lies near: mapped, continued and localised in by a laser that sees as far."""

import math

import numpy as np
import pytest

from slam.known_map import USUAL_LASER, laser_seen, reach_m
from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.metrics import absolute_errors
from slam.se2 import SE2
from slam.slam_map import SlamMap
from slam.verdict import Status
from tests.slam import ring
from tests.slam.synthetic import box, room

HALL = np.concatenate(
    [
        room(-55.0, -48.0, 60.0, 50.0),
        *(
            box(20.0, 44.0, 30.0, 49.9),
            box(-54.9, -10.0, -49.0, 5.0),
            box(48.0, -47.9, 59.9, -40.0),
        ),
        box(-20.0, -47.9, -12.0, -43.0),
    ]
)
"""One-sided walls (4 N, 2, 2), 40 to 78 m from the middle, and no turn brings them over themselves."""


def circle(count: int, first_rad: float) -> list[SE2]:
    """Poses on a circle of 3 m about the middle, 0.15 m apart."""
    angles = first_rad + 0.05 * np.arange(count)
    return [SE2(3.0 * math.cos(a), 3.0 * math.sin(a), a + math.pi / 2.0) for a in angles]


def driven(size: float, poses: list[SE2], seed: int) -> list[Measurement]:
    rng = np.random.default_rng(seed)
    return ring.drive(poses, rng, walls=size * HALL, range_max_m=80.0)


def mapped(size: float) -> SlamMap:
    mapper = Mapper(ring.T_BASE_LASER)
    for measurement in driven(size, circle(140, 0.0), 1):
        mapper.update(measurement)
    return mapper.finish()


@pytest.mark.parametrize("size", [0.4, 1.0])
def test_a_hall_is_mapped(size):
    # walls beyond 40 m were left out of maps: a hall of 100 m was refused
    slam_map, true = mapped(size), np.array([pose.as_array() for pose in circle(140, 0.0)])
    assert slam_map.verdict.is_good
    assert absolute_errors(slam_map.trajectory.poses, true).position_m.max < 0.05


@pytest.mark.parametrize("size", [0.4, pytest.param(1.0, marks=pytest.mark.slow)])
def test_a_hall_is_continued_and_localised_in(size):
    # walls beyond 12 m were left out of the search on a map: a hall of 40 m was never found again
    slam_map, later = mapped(size), driven(size, circle(60, 2.0), 2)
    second = Mapper.continued(slam_map, ring.T_BASE_LASER)
    steps = [second.update(measurement) for measurement in later]
    assert steps[-1].is_joined
    localizer = slam_map.localizer(ring.T_BASE_LASER)
    estimates = [localizer.update(measurement) for measurement in later]
    assert [one.verdict.status for one in estimates[-10:]] == [Status.TRACKING] * 10
    assert estimates[-1].T_map_base.is_near(steps[-1].T_map_base, 0.05, 0.01)


def test_reach_is_of_most_that_was_seen():
    near, far = np.full(900, 3.0), np.full(100, 70.0)
    assert reach_m(np.concatenate([near, far])) == USUAL_LASER.range_max_m
    assert reach_m(np.concatenate([near, np.full(900, 40.0)])) == 40.0
    assert reach_m(np.zeros(0)) == USUAL_LASER.range_max_m
    assert laser_seen([]) == USUAL_LASER

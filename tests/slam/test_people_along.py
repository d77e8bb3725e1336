"""People who walk along between bare walls, where nothing but them and the wheels tells of the way."""

import math

import numpy as np
import pytest

from slam.candidates import Candidates, Prediction
from slam.front_end_config import FrontEndConfig
from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.se2 import SE2
from slam.surface_map import SurfaceMap, SurfaceMatch, faced
from tests.slam.synthetic import box, room, scan_of
from tests.slam.test_open_runs import kept

# 14 m of bare walls between two ends with things to see
WALLS = np.concatenate(
    [
        room(-6.0, -1.0, 20.0, 1.0),
        box(-3.0, 0.4, -2.2, 1.0),
        box(-1.0, -1.0, -0.5, -0.5),
        box(15.0, 0.3, 15.6, 1.0),
        box(17.0, -1.0, 17.9, -0.4),
    ]
)
ANGLES_RAD = np.radians(np.linspace(-135.0, 135.0, 361))
CONFIG = FrontEndConfig()


def person(x: float, y: float) -> np.ndarray:
    """Two legs."""
    legs = [box(x - 0.06, y + aside - 0.06, x + 0.06, y + aside + 0.06) for aside in (-0.15, 0.15)]
    return np.concatenate(legs)


def ahead(x: float) -> list[np.ndarray]:
    """Of a robot at x, one who walks two metres ahead of it for a while."""
    return [person(x + 2.0, 0.3)] if 3.0 < x < 8.0 else []


def slower(x: float) -> list[np.ndarray]:
    """Two, whom the robot comes up to."""
    first = 5.0 + 0.6 * (x - 3.0)
    return [person(first, 0.4), person(first + 0.3, -0.4)] if 3.0 < x < 8.0 else []


@pytest.mark.parametrize("people", [ahead, slower])
@pytest.mark.parametrize("step_m", [0.5, 1.0])
@pytest.mark.parametrize("sigma_m", [0.003, 0.01])
def test_good_wheels_are_believed_rather_than_people_who_walk_along(people, step_m, sigma_m):
    # 0.3 to 4 m off, and some of them good
    rng, mapper, true_m = np.random.default_rng(0), Mapper(SE2.identity()), np.arange(0, 16, step_m)
    for k, x in enumerate(true_m):
        walls = np.concatenate([WALLS, *people(x)])
        scan = scan_of(walls, SE2(x, 0.0, 0.0), rng, 0.01, ANGLES_RAD, 8.0)
        off_m = rng.normal(0.0, sigma_m * math.sqrt(step_m))
        motion = SE2(step_m + off_m, 0.0, rng.normal(0.0, 0.005)) if k else SE2.identity()
        told = np.diag([sigma_m**2 * step_m + 1e-6, 1e-4, 1e-4])
        mapper.update(Measurement(step_m * k, motion, scan, told))
    slam_map = mapper.finish()
    off_m = np.abs(slam_map.trajectory.poses[:, 0] - true_m).max()
    assert off_m < 0.3
    # of a scan each metre there are too few to learn the wheels' scale
    assert slam_map.verdict.is_good or step_m == 1.0


@pytest.mark.parametrize(
    ("sigma_m", "gone_m", "is_led"), [(0.01, 0.5, True), (0.3, 0.5, False), (0.01, 0.0, False)]
)
def test_where_wheels_surely_lead_a_scan_lies_if_it_fits_there_all_but_for_people(
    sigma_m, gone_m, is_led
):
    """Of a person who went as far as the robot; but odometry that stands may tell late of a way."""
    rng, surfaces = np.random.default_rng(1), SurfaceMap()
    for x in (-0.5, 0.0):
        surfaces.add(moved_by(x, seen(x, [person(x + 2.0, 0.3)], rng)))
    points = seen(0.5, [person(2.5, 0.3)], rng)
    led = SE2(0.5, 0.0, 0.0)
    last = led @ SE2(-gone_m, 0.0, 0.0)
    covariance = np.diag([sigma_m**2, sigma_m**2, 0.01**2])
    information = np.linalg.inv(covariance)
    told = Prediction(last, led, covariance, information, 1.0, is_coasting=False)
    bare = room(-30.0, -1.0, 30.0, 1.0)
    before = [kept(bare, SE2(x, 0.0, 0.0), rng) for x in np.arange(-4.0, 0.1, 0.5)]
    match = Candidates(surfaces, before, CONFIG).led(points, told)
    assert match.T_map_base.is_near(led, 0.1, 0.02) is is_led


ROOM = np.concatenate(
    [
        room(-3.0, -3.0, 17.0, 3.0),
        box(0.5, 1.5, 1.5, 3.0),
        box(3.0, -3.0, 4.0, -2.0),
        box(5.5, 1.8, 6.0, 2.4),
        box(8.0, -2.6, 9.1, -1.9),
        box(10.0, 2.2, 12.0, 3.0),
        box(13.0, -3.0, 13.6, -1.4),
        box(15.0, 1.0, 15.5, 1.7),
    ]
)


@pytest.mark.parametrize("step_m", [0.25, 0.5])
@pytest.mark.parametrize("sigma_m", [0.003, 0.01])
@pytest.mark.parametrize(("slips", "every"), [(True, 1), (False, 2)])
def test_walls_of_a_room_are_no_people_however_sure_wheels_are(step_m, sigma_m, slips, every):
    # wheels that spin for a metre, or tell of two steps at each second scan: 0.5 to 1 m off and good
    rng, mapper = np.random.default_rng(0), Mapper(SE2.identity())
    true_m, told_m = np.arange(0.0, 14.0, step_m), np.full(round(14.0 / step_m), step_m)
    if slips:
        at, long = len(true_m) // 2, round(1.0 / step_m)
        true_m = np.insert(true_m, at, np.full(long, true_m[at - 1]))
        told_m = np.insert(told_m, at, np.full(long, step_m))
    told_m[0], untold_m = 0.0, 0.0
    for k, x in enumerate(true_m):
        untold_m += told_m[k]
        by_wheels_m, untold_m = (untold_m, 0.0) if k % every == 0 else (0.0, untold_m)
        by_wheels_m += rng.normal(0.0, sigma_m * math.sqrt(by_wheels_m))
        scan = scan_of(ROOM, SE2(x, 0.0, 0.0), rng, 0.01, ANGLES_RAD, 8.0)
        told = np.diag([sigma_m**2 * by_wheels_m + 1e-6, 1e-4, 1e-4])
        motion = SE2(by_wheels_m, 0.0, 0.0)
        mapper.update(Measurement(max(0.2, step_m) * k, motion, scan, told))
    slam_map = mapper.finish()
    off_m = np.abs(slam_map.trajectory.poses[:, 0] - true_m).max()
    assert off_m < 0.35, slam_map.verdict


@pytest.mark.parametrize(("drawn_m", "are_people"), [(0.0, False), (0.3, False), (0.9, True)])
def test_walls_seen_before_are_none_though_the_wheels_drew_a_match_aside(drawn_m, are_people):
    # in a corridor with doors, wheels that spun for 2 m: a match 0.27 m aside of where its walls had been
    rng, pose = np.random.default_rng(1), SE2(4.0, 0.0, 0.0)
    before = [kept(ROOM, SE2(x, 0.0, 0.0), rng) for x in np.arange(-1.0, 3.6, 0.5)]
    points = faced(
        scan_of(ROOM, pose, rng, 0.01, ANGLES_RAD, 8.0).points(SE2.identity()), np.zeros(2)
    )
    led, covariance = SE2(6.0, 0.0, 0.0), 1e-4 * np.eye(3)
    information = np.linalg.inv(covariance)
    told = Prediction(SE2(5.0, 0.0, 0.0), led, covariance, information, 1.0, is_coasting=False)
    at, nothing = pose @ SE2(drawn_m, 0.0, 0.0), np.zeros((3, 3))
    match = SurfaceMatch(at, np.eye(3), nothing, 1.0, 1.0, 0.1, 1.0)
    assert Candidates(SurfaceMap(), before, CONFIG)._are_people(points, told, match) is are_people


def seen(x: float, people: list[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    walls = np.concatenate([room(-30.0, -1.0, 30.0, 1.0), *people])
    scan = scan_of(walls, SE2(x, 0.0, 0.0), rng, 0.01, ANGLES_RAD, 8.0)
    return faced(scan.points(SE2.identity()), np.zeros(2))


def moved_by(x: float, points: np.ndarray) -> np.ndarray:
    return points + np.array([x, 0.0, 0.0])

"""People who walk along between bare walls, where nothing but them and the wheels tells of the way; and walls
that are none, though wheels that spin or tell late deny them."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from slam.beams import Beams
from slam.candidates import Candidates, Prediction
from slam.front_end_config import FrontEndConfig
from slam.keyframes import Keyframe
from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.people_along import SeenBefore
from slam.se2 import SE2
from slam.slam_map import SlamMap
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


def spun(true_m: np.ndarray, at: int, far_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Where a robot is [m] whose wheels spin over so far while it stands, and what they tell of each step."""
    step_m = true_m[1] - true_m[0]
    long = round(far_m / step_m)
    told_m = np.full(len(true_m) + long, step_m)
    told_m[0] = 0.0
    return np.insert(true_m, at, np.full(long, true_m[at - 1])), told_m


def mapped(
    true_m: np.ndarray,
    told_m: np.ndarray,
    sigma_m: float,
    walls: Callable[[float], np.ndarray],
    *,
    angles_rad: np.ndarray = ANGLES_RAD,
    range_m: float = 8.0,
    turn_rad: float = 0.0,
    seed: int = 0,
) -> tuple[SlamMap, float]:
    """The map of a drive along x, and how far off it is at most [m]. sigma_m: of a metre by the wheels;
    turn_rad: of each step by them."""
    rng, mapper = np.random.default_rng(seed), Mapper(SE2.identity())
    step_m = true_m[1] - true_m[0]
    for k, (x, way_m) in enumerate(zip(true_m, told_m, strict=True)):
        scan = scan_of(walls(x), SE2(x, 0.0, 0.0), rng, 0.01, angles_rad, range_m)
        noise = sigma_m * math.sqrt(way_m)
        motion = SE2(way_m + rng.normal(0.0, noise), 0.0, rng.normal(0.0, turn_rad) if k else 0.0)
        told = np.diag([noise**2 + 1e-6, 1e-4, 1e-4])
        mapper.update(Measurement(max(0.2, step_m) * k, motion, scan, told))
    slam_map = mapper.finish()
    return slam_map, float(np.abs(slam_map.trajectory.poses[:, 0] - true_m).max())


@pytest.mark.parametrize("people", [ahead, slower])
@pytest.mark.parametrize("step_m", [0.5, 1.0])
@pytest.mark.parametrize("sigma_m", [0.003, 0.01])
def test_good_wheels_are_believed_rather_than_people_who_walk_along(people, step_m, sigma_m):
    # 0.3 to 4 m off, and some of them good
    true_m, told_m = np.arange(0.0, 16.0, step_m), np.full(round(16.0 / step_m), step_m)
    told_m[0] = 0.0
    slam_map, off_m = mapped(
        true_m, told_m, sigma_m, lambda x: np.concatenate([WALLS, *people(x)]), turn_rad=0.005
    )
    assert off_m < 0.3
    # of a scan each metre there are too few to learn the wheels' scale
    assert slam_map.verdict.is_good or step_m == 1.0


@pytest.mark.parametrize("people", [ahead, slower])
@pytest.mark.parametrize("sigma_m", [0.003, 0.01])
@pytest.mark.parametrize(("step_m", "beams"), [(0.05, 361), (0.1, 361), (0.1, 1081)])
def test_people_who_draw_each_scan_by_less_than_wheels_could_deny(people, sigma_m, step_m, beams):
    # 2 to 5 m off, and of 16 with a scan each 0.1 m two good
    true_m = np.arange(0.0, 16.0, step_m)
    told_m = np.full(len(true_m), step_m)
    told_m[0] = 0.0
    slam_map, off_m = mapped(
        true_m, told_m, sigma_m, lambda x: np.concatenate([WALLS, *people(x)]),
        angles_rad=np.radians(np.linspace(-135.0, 135.0, beams)), turn_rad=0.005,
    )  # fmt: skip
    assert off_m < 0.3
    # steps of 5 cm are as sure as the scans' own noise: between bare walls nobody knows the way well enough
    assert slam_map.verdict.is_good or step_m == 0.05


@pytest.mark.parametrize(
    ("sigma_m", "gone_m", "is_led"), [(0.01, 0.5, True), (0.3, 0.5, False), (0.01, 0.0, False)]
)
def test_where_wheels_surely_lead_a_scan_lies_if_it_fits_there_all_but_for_people(
    sigma_m, gone_m, is_led
):
    """Of a person who went as far as the robot; but odometry that stands may tell late of a way."""
    rng, surfaces = np.random.default_rng(1), SurfaceMap()
    for x in (-0.5, 0.0):
        surfaces.add(moved_by(x, faced(seen(x, [person(x + 2.0, 0.3)], rng).points, np.zeros(2))))
    beams = seen(0.5, [person(2.5, 0.3)], rng)
    points = faced(beams.points, np.zeros(2))
    led = SE2(0.5, 0.0, 0.0)
    last = led @ SE2(-gone_m, 0.0, 0.0)
    covariance = np.diag([sigma_m**2, sigma_m**2, 0.01**2])
    information = np.linalg.inv(covariance)
    told = Prediction(last, led, covariance, information, 1.0, is_coasting=False)
    bare = room(-30.0, -1.0, 30.0, 1.0)
    before = [kept(bare, SE2(x, 0.0, 0.0), rng) for x in np.arange(-4.0, 0.1, 0.5)]
    match = Candidates(surfaces, before, CONFIG).led(points, beams, told)
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


DOORS = np.concatenate(
    [room(-6.0, -1.0, 20.0, 1.0), box(-3.0, 0.4, -2.2, 1.0), box(18.0, -1.0, 18.9, -0.4)]
    # walls a hand's breadth thick between doors of a corridor, each in its own distance
    + [
        box(x, 0.85, x + long, 1.0)
        for x, long in ((0.5, 0.9), (2.9, 0.5), (6.1, 1.1), (8.8, 0.7), (12.7, 0.9), (15.2, 0.4))
    ]
    + [
        box(x, -1.0, x + long, -0.85)
        for x, long in ((-1.2, 0.5), (1.6, 0.8), (4.4, 0.6), (7.7, 1.0), (10.9, 0.5), (14.1, 1.2))
    ]
)


@pytest.mark.parametrize("step_m", [0.25, 0.5])
@pytest.mark.parametrize("sigma_m", [0.003, 0.01])
@pytest.mark.parametrize(("slips", "every"), [(True, 1), (False, 2)])
def test_walls_of_a_room_are_no_people_however_sure_wheels_are(step_m, sigma_m, slips, every):
    # wheels that spin for a metre, or tell of two steps at each second scan: 0.5 to 1 m off and good
    true_m, told_m = np.arange(0.0, 14.0, step_m), np.full(round(14.0 / step_m), step_m)
    told_m[0] = 0.0
    if slips:
        true_m, told_m = spun(true_m, len(true_m) // 2, 1.0)
    if every == 2:
        told_m[2::2] += told_m[1:-1:2]
        told_m[1::2] = 0.0
    slam_map, off_m = mapped(true_m, told_m, sigma_m, lambda _: ROOM)
    assert off_m < 0.35, slam_map.verdict


@pytest.mark.parametrize(("at", "beams", "seed"), [(4, 181, 3), (4, 181, 6), (12, 1081, 4)])
def test_walls_that_have_just_come_into_reach_are_no_people(at, beams, seed):
    # of a laser that sees 4 m: 1 m off and good
    angles_rad = np.radians(np.linspace(-135.0, 135.0, beams))
    true_m, told_m = spun(np.arange(0.0, 14.0, 0.5), at, 1.0)
    slam_map, off_m = mapped(
        true_m, told_m, 0.01, lambda _: ROOM, angles_rad=angles_rad, range_m=4.0, seed=seed
    )
    assert off_m < 0.35, slam_map.verdict


@pytest.mark.parametrize(
    ("step_m", "far_m", "beams"), [(0.5, 1.0, 361), (0.25, 2.0, 181), (0.1, 1.0, 361)]
)
@pytest.mark.parametrize("at_m", [4.5, 6.3, 8.0])
def test_wheels_that_spin_between_doors_are_told_by_scans_that_look_the_same(
    step_m, far_m, beams, at_m
):
    # edges of a hand's breadth were outliers where the wheels led: 0.6 to 1.9 m off and good
    angles_rad = np.radians(np.linspace(-135.0, 135.0, beams))
    true_m, told_m = spun(np.arange(0.0, 14.0, step_m), round(at_m / step_m), far_m)
    slam_map, off_m = mapped(true_m, told_m, 0.01, lambda _: DOORS, angles_rad=angles_rad)
    assert off_m < 0.3, slam_map.verdict


@pytest.mark.parametrize(("drawn_m", "are_people"), [(0.0, False), (0.3, False), (0.9, True)])
def test_walls_seen_before_are_none_though_the_wheels_drew_a_match_aside(drawn_m, are_people):
    # in a corridor with doors, wheels that spun for 2 m: a match 0.27 m aside of where its walls had been
    rng, pose = np.random.default_rng(1), SE2(4.0, 0.0, 0.0)
    before = [kept(ROOM, SE2(x, 0.0, 0.0), rng) for x in np.arange(-1.0, 3.6, 0.5)]
    assert (
        seen_before(before, ROOM, pose, rng).are_people(at(4.0 + drawn_m), SE2(6.0, 0.0, 0.0))
        is are_people
    )


def test_people_that_those_before_saw_as_well_are_told_by_who_looked_through_there():
    """They walk slower than the robot: a little farther back the scan fits what was seen of them."""
    rng, bare = np.random.default_rng(4), room(-30.0, -1.0, 30.0, 1.0)
    before = []
    for k, x in enumerate(np.arange(0.0, 3.1, 0.25)):
        at_m = 2.5 + 0.1 * max(k - 5, 0)
        walls = np.concatenate([bare, person(at_m, 0.4)]) if k >= 5 else bare
        before.append(kept(walls, SE2(x, 0.0, 0.0), rng))
    walls = np.concatenate([bare, person(3.4, 0.4)])
    asked = seen_before(before, walls, SE2(3.25, 0.0, 0.0), rng)
    assert asked.are_people(at(3.0), SE2(3.25, 0.0, 0.0))


@pytest.mark.parametrize(
    ("far_m", "are_people"),
    [
        (5.5, True),  # where those before looked through, and met nothing
        (9.5, False),  # beyond what these could have seen
    ],
)
def test_people_stand_where_those_before_looked_through(far_m, are_people):
    rng, bare = np.random.default_rng(2), room(-30.0, -1.0, 30.0, 1.0)
    before = [kept(bare, SE2(x, 0.0, 0.0), rng) for x in np.arange(0.0, 3.1, 0.25)]
    walls = np.concatenate([bare, person(far_m, 0.3)])
    assert (
        seen_before(before, walls, SE2(4.0, 0.0, 0.0), rng).are_people(at(4.0), SE2(4.5, 0.0, 0.0))
        is are_people
    )


def test_what_hid_where_it_is_now_is_told_by_where_it_was():
    # a cart before the robot all along: behind it nobody saw anything, and now the scan looks through where it was
    rng, bare = np.random.default_rng(3), room(-30.0, -1.0, 30.0, 1.0)

    def with_it(x: float) -> np.ndarray:
        return np.concatenate([bare, box(x + 2.0, -0.2, x + 2.3, 0.2)])

    before = [kept(with_it(x), SE2(x, 0.0, 0.0), rng) for x in np.arange(0.0, 3.1, 0.25)]
    asked = seen_before(before, with_it(4.0), SE2(4.0, 0.0, 0.0), rng)
    assert asked.are_people(at(4.0), SE2(4.5, 0.0, 0.0))


def seen_before(
    before: list[Keyframe], walls: np.ndarray, pose: SE2, rng: np.random.Generator
) -> SeenBefore:
    scan = scan_of(walls, pose, rng, 0.01, ANGLES_RAD, 8.0)
    points = faced(scan.points(SE2.identity()), np.zeros(2))
    return SeenBefore(before, points, Beams.of(scan, SE2.identity()), CONFIG)


def at(x: float) -> SurfaceMatch:
    """A match that tells nothing but where it is."""
    return SurfaceMatch(SE2(x, 0.0, 0.0), np.eye(3), np.zeros((3, 3)), 1.0, 1.0, 0.1, 1.0)


def seen(x: float, people: list[np.ndarray], rng: np.random.Generator) -> Beams:
    """Between bare walls."""
    walls = np.concatenate([room(-30.0, -1.0, 30.0, 1.0), *people])
    scan = scan_of(walls, SE2(x, 0.0, 0.0), rng, 0.01, ANGLES_RAD, 8.0)
    return Beams.of(scan, SE2.identity())


def moved_by(x: float, points: np.ndarray) -> np.ndarray:
    return points + np.array([x, 0.0, 0.0])

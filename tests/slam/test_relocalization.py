"""Where on the map a scan may have been taken: found from anywhere, and honest about symmetry."""

import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from slam.beams import Beams
from slam.laser_model import LaserModel
from slam.localization import Localizer
from slam.lost import Guard
from slam.matchers import FastMatcher, LimitMatcher
from slam.measurements import Measurement
from slam.range_noise import RangeNoise
from slam.relocalization import Hypothesis, Relocalizer, RelocalizerConfig, in_front_of
from slam.se2 import SE2, wrap_angle
from slam.surface.segment_map import SegmentMap
from slam.surface.surfel_grid import SurfelGrid
from tests.slam.synthetic import (
    CLUTTERED_ROOM,
    ROOM_SEGMENTS,
    SYMMETRIC_ROOM,
    box,
    legs,
    room,
    scan_of,
    searcher,
)

ANGLES_RAD = np.radians(np.arange(-120.0, 121.0))
MOUNT = SE2(0.1, 0.0, 0.0)
CORRIDOR = np.concatenate(
    [room(-20.0, 0.0, 20.0, 2.0), box(-0.6, 0.0, -0.51, 0.09), box(0.6, 0.0, 0.69, 0.09)]
)
"""Its ends are out of reach; two posts alone tell where along it the robot is."""


@pytest.fixture(scope="module")
def in_clutter() -> Relocalizer:
    return searcher(CLUTTERED_ROOM)


@pytest.fixture(scope="module")
def in_symmetry() -> Relocalizer:
    return searcher(SYMMETRIC_ROOM)


def poses_in(walls: np.ndarray, count: int, seed: int) -> list[SE2]:
    """Where a robot may stand: 30 cm from all walls, in front of the nearest."""
    rng, segment_map = np.random.default_rng(seed), SegmentMap(walls, is_one_sided=True)
    points = segment_map.sampled(0.02)[0]
    is_free, found = in_front_of(segment_map, 0.02), []
    while len(found) < count:
        at = rng.uniform(points.min(axis=0), points.max(axis=0))
        if np.hypot(*(points - at).T).min() > 0.3 and is_free(at[np.newaxis]).all():
            found.append(SE2(*at, rng.uniform(-math.pi, math.pi)))
    return found


def seen(walls: np.ndarray, pose: SE2, rng: np.random.Generator, people: int = 0) -> Beams:
    if people:
        bearings = rng.uniform(-2.0, 2.0, people)
        walls = np.concatenate([walls, legs(pose @ MOUNT, bearings, rng.uniform(0.6, 1.2))])
    scan = scan_of(walls, pose @ MOUNT, rng, 0.01, ANGLES_RAD, range_max_m=10.0)
    return Beams.of(scan, MOUNT)


def is_right(pose: SE2, true: SE2) -> bool:
    off = true.inverse() @ pose
    return math.hypot(off.x, off.y) < 0.05 and abs(off.theta) < math.radians(2.0)


def assert_ranked(places: list[Hypothesis], config: RelocalizerConfig) -> None:
    likelihoods = [place.log_likelihood for place in places]
    assert likelihoods == sorted(likelihoods, reverse=True)
    for i, place in enumerate(places):
        assert place.log_likelihood == place.evidence.log_likelihood
        for other in places[:i]:
            a, b = place.T_map_base, other.T_map_base
            is_beside = math.hypot(a.x - b.x, a.y - b.y) < config.apart_m
            assert not (is_beside and abs(wrap_angle(a.theta - b.theta)) < config.apart_rad)


def margin(places: list[Hypothesis]) -> float:
    return places[0].log_likelihood - places[1].log_likelihood if len(places) > 1 else math.inf


def test_scan_from_anywhere_in_an_asymmetric_room_is_found_at_once(in_clutter):
    rng = np.random.default_rng(1)
    for true in poses_in(CLUTTERED_ROOM, 40, 1):
        places = in_clutter(seen(CLUTTERED_ROOM, true, rng))
        assert is_right(places[0].T_map_base, true)
        # a beam off its wall costs 3: eight of 241 more at the next best place
        assert margin(places) > 25.0
        assert places[0].evidence.inlier_ratio > 0.9
        assert_ranked(places, in_clutter.config)


def test_scan_among_three_pairs_of_legs_is_found_at_once(in_clutter):
    rng = np.random.default_rng(2)
    for true in poses_in(CLUTTERED_ROOM, 20, 2):
        places = in_clutter(seen(CLUTTERED_ROOM, true, rng, people=3))
        assert is_right(places[0].T_map_base, true)
        assert margin(places) > 10.0
        assert_ranked(places, in_clutter.config)


def test_half_turn_symmetric_room_gives_both_places_nearly_equally_likely(in_symmetry):
    rng, half_turn = np.random.default_rng(3), SE2(0.0, 0.0, math.pi)
    for true in poses_in(SYMMETRIC_ROOM, 15, 3):
        places = in_symmetry(seen(SYMMETRIC_ROOM, true, rng))
        best, other = (place.T_map_base for place in places[:2])
        assert is_right(best, true) or is_right(best, half_turn @ true)
        assert is_right(other, half_turn @ best)
        # they differ by where the matcher stopped: a sixth of a beam off its wall
        assert margin(places) < 0.5
        assert_ranked(places, in_symmetry.config)


def test_places_far_less_likely_than_the_best_are_not_returned(in_clutter):
    beams = seen(CLUTTERED_ROOM, SE2(2.6, 1.3, 0.7), np.random.default_rng(4))
    likelihoods = (0.0, -50.0, -99.0, -101.0, -500.0)
    places = [
        Hypothesis(SE2(i, 0.0, 0.0), in_clutter.at(beams, SE2(i, 0.0, 0.0)).evidence, likelihood)
        for i, likelihood in enumerate(likelihoods)
    ]
    kept = in_clutter.distinct(reversed(places))
    assert [place.log_likelihood for place in kept] == [0.0, -50.0, -99.0]


def test_places_nearer_than_both_limits_are_one_also_across_the_half_turn(in_clutter):
    beams = seen(CLUTTERED_ROOM, SE2(2.6, 1.3, 0.7), np.random.default_rng(4))
    apart_m, apart_rad = in_clutter.config.apart_m, in_clutter.config.apart_rad
    best = SE2(0.0, 0.0, math.pi - 0.2 * apart_rad)
    near = SE2(0.5 * apart_m, 0.0, -math.pi + 0.2 * apart_rad)
    turned, beside = best @ SE2(0.0, 0.0, 1.5 * apart_rad), best @ SE2(1.5 * apart_m, 0.0, 0.0)
    evidence = in_clutter.at(beams, best).evidence
    poses = (beside, near, turned, best)
    kept = in_clutter.distinct(Hypothesis(pose, evidence, float(i)) for i, pose in enumerate(poses))
    assert [one.T_map_base for one in kept] == [best, turned, beside]


def test_scan_without_hits_is_found_nowhere(in_clutter):
    for nothing in (np.inf, np.nan, -np.inf, 1e6):
        beams = Beams(np.zeros((241, 2)), ANGLES_RAD, np.full(241, nothing))
        assert in_clutter(beams) == []
    assert in_clutter(Beams(np.empty((0, 2)), np.empty(0), np.empty(0))) == []


@pytest.mark.parametrize("away_m", [0.5, 2.0, 9.0])
def test_scan_of_one_wall_is_found_at_several_places_or_none(in_clutter, away_m):
    wall = np.array([[[away_m, 20.0], [away_m, -20.0]]])
    scan = scan_of(wall, SE2.identity(), angles_rad=ANGLES_RAD, range_max_m=10.0)
    places = in_clutter(Beams.of(scan, SE2.identity()))
    assert len(places) != 1
    assert_ranked(places, in_clutter.config)


@pytest.mark.parametrize("range_m", [0.0, 1e-9, 0.02, 1.0, 9.99])
def test_scan_of_equal_ranges_or_of_one_point_is_no_error(in_clutter, range_m):
    around = Beams(np.zeros((241, 2)), ANGLES_RAD, np.full(241, range_m))
    one = Beams(np.zeros((1, 2)), np.zeros(1), np.full(1, range_m))
    for beams in (around, one):
        places = in_clutter(beams)
        assert all(math.isfinite(place.log_likelihood) for place in places)
        assert_ranked(places, in_clutter.config)


def test_refined_is_never_less_likely_than_where_it_started(in_clutter):
    rng = np.random.default_rng(5)
    for true in poses_in(CLUTTERED_ROOM, 10, 5):
        beams = seen(CLUTTERED_ROOM, true, rng)
        start = true @ SE2(*rng.normal(0.0, [0.03, 0.03, 0.03]))
        refined = in_clutter.refined(beams, start)
        assert refined.log_likelihood >= in_clutter.at(beams, start).log_likelihood
        assert is_right(refined.T_map_base, true)
        # of ranges without noise the truth explains all, and the matcher stops a little beside it
        perfect = Beams.of(scan_of(CLUTTERED_ROOM, true @ MOUNT, angles_rad=ANGLES_RAD), MOUNT)
        assert in_clutter.refined(perfect, true).log_likelihood == pytest.approx(0.0, abs=1e-12)


def test_search_keeps_to_where_the_robot_may_be():
    walls = SYMMETRIC_ROOM
    left = searcher(walls, is_free=lambda points: points[:, 0] < 0.0)
    rng = np.random.default_rng(6)
    for true in (SE2(-1.0, 0.3, 0.5), SE2(1.0, -0.3, 0.5 - math.pi)):
        places = left(seen(walls, true, rng))
        assert is_right(places[0].T_map_base, SE2(-1.0, 0.3, 0.5))
        assert all(place.T_map_base.x < 0.2 for place in places)


def test_in_front_of_one_sided_walls_is_free_and_inside_and_outside_is_not():
    is_free = in_front_of(SegmentMap(CLUTTERED_ROOM, is_one_sided=True), 0.1)
    free = [[2.0, 1.5], [0.7, 0.5], [0.7, 1.5], [3.9, 0.1], [3.5, 2.0], [2.0, 0.6]]
    # in the cupboard, in the pillar, in the bench, outside, outside far away
    closed = [[3.5, 2.5], [0.3, 1.5], [2.1, 0.25], [-0.3, 1.0], [90.0, -50.0]]
    assert is_free(np.array(free)).all()
    assert not is_free(np.array(closed)).any()
    # slack: 10 cm behind a wall still count
    assert is_free(np.array([[-0.09, 1.0]])).all()
    assert not is_free(np.array([[-0.11, 1.0]])).any()


def one_by_one(walls: SegmentMap, slack_m: float, points: np.ndarray) -> np.ndarray:
    """Whether the nearest piece of wall to each point shows it its open side."""
    samples, owners = walls.sampled(slack_m / 2.0)
    _, nearest = cKDTree(samples).query(points)
    normals = walls.normals[owners[nearest]]
    return np.sum((points - samples[nearest]) * normals, axis=1) > -slack_m


@pytest.mark.parametrize("seed", range(2))
def test_in_front_of_far_walls_is_told_by_squares_as_one_by_one(seed):
    rng = np.random.default_rng(seed)
    # a hall, and walls that enclose nothing: each free on one side as far as it is nearest
    stray = rng.uniform(0.0, 30.0, (12, 2, 2))
    stray[:, 1] = stray[:, 0] + rng.uniform(-2.0, 2.0, (12, 2))
    hall = 10.0 * ROOM_SEGMENTS
    points = rng.uniform(-15.0, 60.0, (1500, 2))
    points[:500] = np.round(points[:500] / 1.6) * 1.6
    for segments in (hall, stray, np.concatenate([hall, stray])):
        walls = SegmentMap(segments, is_one_sided=True)
        expected = one_by_one(walls, 0.1, points)
        np.testing.assert_array_equal(in_front_of(walls, 0.1)(points), expected)
        assert expected.any()
        assert not expected.all()


def test_in_front_of_walls_with_two_sides_is_everywhere():
    is_free = in_front_of(SegmentMap(CLUTTERED_ROOM), 0.1)
    assert is_free(np.array([[2.0, 1.5], [0.3, 1.5], [90.0, -50.0]])).all()


def test_map_without_walls_and_map_too_large_are_refused():
    surfels = SurfelGrid.of(SegmentMap(SYMMETRIC_ROOM))
    laser = LaserModel(searcher(SYMMETRIC_ROOM).laser.noise)
    with pytest.raises(ValueError, match="no walls"):
        Relocalizer.of(SegmentMap(np.empty((0, 2, 2)), is_one_sided=True), surfels, laser)
    # a million kilometres: refused before they are cut into pieces of 2.5 cm
    wide = SegmentMap([[[0.0, 0.0], [1e9, 0.0]], [[0.0, 0.0], [0.0, 1e9]]])
    with pytest.raises(ValueError, match="too large to search"):
        Relocalizer.of(wide, surfels, laser)


def fitted(walls: np.ndarray, config: RelocalizerConfig | None = None) -> Relocalizer:
    """The search of walls that are uncertain, as those of a map made of scans."""
    segment_map = SegmentMap(walls, np.full(len(walls), 0.02), is_one_sided=True)
    laser = LaserModel(RangeNoise(((1.0, 0.01),)), 0.02, 10.0)
    return Relocalizer.of(segment_map, SurfelGrid.of(segment_map), laser, None, config)


def test_along_a_corridor_the_middle_of_what_is_likely_is_found_and_in_a_room_the_pose_is_kept():
    true, relocalizer = SE2(0.1, 1.0, 0.0), fitted(CORRIDOR)
    beams = seen(CORRIDOR, true, np.random.default_rng(3))
    for off_m in (-0.15, -0.1, 0.1, 0.15):
        found = relocalizer.centred(beams, true @ SE2(off_m, 0.0, 0.0))
        # the likelihood falls by six, and differences of four may be chance
        assert abs(found.x - true.x) < 0.7 * abs(off_m)
        assert found.is_near(true, 0.15, 0.001)
    beams = seen(CLUTTERED_ROOM, SE2(2.2, 1.5, 0.5), np.random.default_rng(3))
    for off in (SE2.identity(), SE2(0.05, -0.03, 0.01)):
        pose = SE2(2.2, 1.5, 0.5) @ off
        assert fitted(CLUTTERED_ROOM).centred(beams, pose) == pose


def test_robot_that_finds_itself_on_a_map_of_scans_stands_in_the_middle_of_what_is_likely():
    relocalizer = fitted(CORRIDOR, RelocalizerConfig(loose_m=0.0))
    fast = FastMatcher(relocalizer.surfels, relocalizer.laser)
    matcher = LimitMatcher(relocalizer.segment_map, relocalizer.laser, fast)
    robot = Localizer(matcher, None, MOUNT, None, Guard(relocalizer))
    rng = np.random.default_rng(3)
    scan = scan_of(CORRIDOR, SE2(0.1, 1.0, 0.0), rng, 0.01, ANGLES_RAD, range_max_m=10.0)
    estimate = robot.update(Measurement(0.0, SE2.identity(), scan, np.zeros((3, 3))))
    best = estimate.verdict.hypotheses[0].T_map_base
    middle = relocalizer.centred(Beams.of(scan, MOUNT), best)
    assert middle != best
    assert estimate.T_map_base.is_near(middle, 1e-9, 1e-9)

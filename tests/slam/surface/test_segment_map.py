"""The ranges that a map of walls gives, against trying each beam with each wall."""

import numba
import numpy as np
import pytest

from slam.beams import Beams
from slam.kernels.ray_casting import cast_beside
from slam.measurements import LaserScan
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from tests.slam.slow_twins import cast_all
from tests.slam.synthetic import ANGLES_RAD, ROOM_CENTRE, ROOM_SEGMENTS, round_wall

LASER = SE2(0.19, 0.02, 0.3)


def fan(angles_rad: np.ndarray, origins_m: np.ndarray | None = None) -> Beams:
    count = len(angles_rad)
    origins = np.zeros((count, 2)) if origins_m is None else origins_m
    return Beams(origins, angles_rad, np.full(count, np.nan))


def swept(rng: np.random.Generator, angles_rad: np.ndarray, spread_m: float) -> Beams:
    """A scan whose origins lie on a way of that length, and a little beside it."""
    way = np.linspace(-0.5, 0.5, len(angles_rad))[:, np.newaxis] * rng.normal(size=2)
    return fan(angles_rad, spread_m * (way + 0.05 * rng.normal(size=(len(angles_rad), 2))))


def random_walls(rng: np.random.Generator, count: int) -> np.ndarray:
    middles = rng.uniform(-4.0, 4.0, (count, 1, 2))
    return middles + rng.normal(0.0, 1.0, (count, 2, 2)) * rng.choice([0.1, 1.0], (count, 1, 1))


def assert_same(segment_map: SegmentMap, beams: Beams, pose: SE2, reach_m: float = np.inf) -> None:
    ranges_m, walls = segment_map.ranges(beams, pose, reach_m)
    expected_m, expected_walls = cast_all(segment_map.segments, beams, pose, reach_m)
    # a beam within rounding of a wall's end may count to either side, in both versions: the walls
    # here are random, and none of these beams does
    np.testing.assert_allclose(ranges_m, expected_m, rtol=0.0, atol=1e-9)
    assert (walls == expected_walls).mean() > 0.99
    # where two walls cross at the very hit, either may be named: the range decides
    differ = walls != expected_walls
    assert np.array_equal(walls[differ] < 0, expected_walls[differ] < 0)


@pytest.mark.parametrize("is_one_sided", [True, False])
@pytest.mark.parametrize("seed", range(12))
def test_ranges_are_those_of_each_beam_tried_with_each_wall(seed, is_one_sided):
    rng = np.random.default_rng(seed)
    segment_map = SegmentMap(random_walls(rng, 60), is_one_sided=is_one_sided)
    pose = SE2(*rng.uniform(-3.0, 3.0, 2), rng.uniform(-3.1, 3.1))
    assert_same(segment_map, fan(ANGLES_RAD), pose)


@pytest.mark.parametrize("spread_m", [1e-3, 0.05, 0.5, 3.0])
@pytest.mark.parametrize("seed", range(6))
def test_ranges_of_a_swept_scan_are_so_too(seed, spread_m):
    # up to origins so far apart that walls lie between them
    rng = np.random.default_rng(100 + seed)
    segment_map = SegmentMap(random_walls(rng, 60), is_one_sided=True)
    pose = SE2(*rng.uniform(-3.0, 3.0, 2), rng.uniform(-3.1, 3.1))
    assert_same(segment_map, swept(rng, ANGLES_RAD, spread_m), pose)


@pytest.mark.parametrize("spread_m", [0.0, 0.1])
@pytest.mark.parametrize("widest_m", [1e-3, 0.05, 0.5])
@pytest.mark.parametrize("seed", range(4))
def test_beams_shifted_to_either_side_meet_what_two_casts_find(seed, widest_m, spread_m):
    rng = np.random.default_rng(200 + seed)
    segment_map = SegmentMap(random_walls(rng, 60), is_one_sided=True)
    beams = swept(rng, ANGLES_RAD, spread_m)
    shifts_m = rng.uniform(0.0, widest_m, len(beams))
    lefts_m, rights_m = np.empty(len(beams)), np.empty(len(beams))
    cast_beside(
        segment_map.vertices, segment_map.walls, beams.origins_m, beams.directions,
        beams.angles_rad, beams.middle_m, beams.spread_m + widest_m, np.inf, shifts_m,
        np.empty_like(segment_map.vertices), lefts_m, rights_m,
    )  # fmt: skip
    aside_m = shifts_m[:, np.newaxis] * beams.directions @ [[0.0, 1.0], [-1.0, 0.0]]
    for found_m, sign in ((lefts_m, 1.0), (rights_m, -1.0)):
        there = fan(ANGLES_RAD, beams.origins_m + sign * aside_m)
        expected_m, _ = segment_map.ranges(there, SE2.identity())
        assert np.isfinite(expected_m).sum() > 100
        np.testing.assert_allclose(found_m, expected_m, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("first_rad", [-np.pi, 0.0, 2.9, -7.0])
@pytest.mark.parametrize("spread_m", [0.0, 0.1, 1.0])
def test_full_circle_sees_all_around_wherever_it_begins(first_rad, spread_m):
    rng = np.random.default_rng(7)
    angles_rad = first_rad + np.arange(720) * (2.0 * np.pi / 720)
    segment_map = SegmentMap(random_walls(rng, 80), is_one_sided=False)
    for heading in (-3.0, 0.0, 2.0):
        assert_same(segment_map, swept(rng, angles_rad, spread_m), SE2(0.3, -0.2, heading))


def test_unevenly_spaced_beams_find_the_same_walls():
    rng = np.random.default_rng(3)
    angles_rad = np.sort(np.concatenate([rng.uniform(-2.0, -1.8, 200), rng.uniform(0.0, 2.5, 40)]))
    for _ in range(5):
        segment_map = SegmentMap(random_walls(rng, 60), is_one_sided=True)
        assert_same(segment_map, swept(rng, angles_rad, 0.1), SE2(0.0, 0.0, rng.uniform(-3, 3)))


@pytest.mark.parametrize("reach_m", [0.5, 1.5, 4.0])
def test_walls_beyond_the_reach_are_not_there(reach_m):
    rng = np.random.default_rng(11)
    segment_map = SegmentMap(random_walls(rng, 60))
    assert_same(segment_map, swept(rng, ANGLES_RAD, 0.2), SE2(0.1, 0.1, 0.2), reach_m)


def test_single_beam_and_no_beam_are_scans_too():
    room = SegmentMap(ROOM_SEGMENTS)
    ranges_m, walls = room.ranges(fan(np.zeros(1)), SE2(2.0, 1.0, 0.0))
    assert ranges_m == pytest.approx([4.0])  # the wall at x = 6
    assert room.segments[walls[0], :, 0].tolist() == [6.0, 6.0]
    ranges_m, walls = room.ranges(fan(np.empty(0)), SE2(2.0, 1.0, 0.0))
    assert ranges_m.shape == walls.shape == (0,)


def test_wall_is_seen_from_its_left_alone_unless_it_has_two_sides():
    wall = [[[2.0, -1.0], [2.0, 1.0]]]  # upwards: its left is towards the origin
    ahead = fan(np.zeros(1))
    for sides, facing, expected in [
        (True, wall, 2.0),
        (True, np.flip(wall, axis=1), np.inf),
        (False, np.flip(wall, axis=1), 2.0),
    ]:
        ranges_m, walls = SegmentMap(facing, is_one_sided=sides).ranges(ahead, SE2.identity())
        assert ranges_m[0] == expected
        assert (walls[0] == -1) == np.isinf(expected)


def test_beams_that_hit_nothing_are_inf_and_minus_one():
    behind = SegmentMap([[[-2.0, -1.0], [-2.0, 1.0]]])
    angles_rad = np.radians(np.arange(-90.0, 91.0))
    for segment_map in (behind, SegmentMap(np.empty((0, 2, 2)))):
        ranges_m, walls = segment_map.ranges(fan(angles_rad), SE2.identity())
        assert np.isinf(ranges_m).all()
        assert (walls == -1).all()


def test_no_beam_slips_between_two_walls_that_meet():
    # beams at the very corners of a round wall, from its middle and from beside it
    segment_map = SegmentMap(round_wall(2.0, 360))
    angles_rad = np.radians(np.arange(-180.0, 180.0, 0.5))
    for pose in (SE2.identity(), SE2(0.0, 0.0, np.radians(30.0)), SE2(0.5, 0.0, 0.0)):
        ranges_m, _ = segment_map.ranges(fan(angles_rad), pose)
        assert np.isfinite(ranges_m).all()
        # a facet's middle is r (1 - cos(0.5 degrees)) = 76 um inside the circle
        at_m = np.hypot(*(pose @ (ranges_m[:, None] * fan(angles_rad).directions)).T)
        assert at_m.min() > 2.0 - 1e-4
        assert at_m.max() < 2.0 + 1e-9


def test_origin_on_the_other_side_of_a_wall_sees_what_lies_there():
    # one scan on its way through a door's plane: half of its origins before, half behind it
    angles_rad = np.linspace(-0.05, 0.05, 11)
    origins_m = np.column_stack([np.linspace(-1.0, 1.0, 11), np.zeros(11)])
    segment_map = SegmentMap([[[0.1, -1.0], [0.1, 1.0]], [[5.0, -1.0], [5.0, 1.0]]])
    ranges_m, _ = segment_map.ranges(fan(angles_rad, origins_m), SE2.identity())
    far = origins_m[:, 0] > 0.1
    expected_m = (np.where(far, 5.0, 0.1) - origins_m[:, 0]) / np.cos(angles_rad)
    np.testing.assert_allclose(ranges_m, expected_m, atol=1e-12)


def test_known_map_has_the_same_ranges_with_fewer_walls():
    shares = np.linspace(0.0, 1.0, 11)[:, np.newaxis]
    lines = [a + shares * (b - a) for a, b in ROOM_SEGMENTS]
    pieces = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines])
    known = SegmentMap.known(pieces)
    assert len(known) == 2 * len(ROOM_SEGMENTS)
    assert known.is_exact
    expected_m, _ = SegmentMap(ROOM_SEGMENTS).ranges(fan(ANGLES_RAD), ROOM_CENTRE)
    ranges_m, _ = known.ranges(fan(ANGLES_RAD), ROOM_CENTRE)
    # joined to rounding; no beam of these passes within that of an edge
    np.testing.assert_allclose(ranges_m, expected_m, atol=1e-9)


def test_beams_of_a_mounted_laser_start_at_it_and_look_its_way():
    scan = LaserScan(0.0, ANGLES_RAD, np.full(len(ANGLES_RAD), 1.0))
    beams = Beams.of(scan, LASER)
    assert_same(SegmentMap(ROOM_SEGMENTS), beams, ROOM_CENTRE)
    np.testing.assert_allclose(beams.points, scan.points(LASER), atol=1e-12)
    assert beams.spread_m == pytest.approx(0.0, abs=1e-12)
    assert beams.middle_m == pytest.approx([LASER.x, LASER.y])


def test_sigma_of_a_wall_counts_on_both_of_its_sides_and_makes_the_map_inexact():
    segment_map = SegmentMap(ROOM_SEGMENTS[:2], [0.0, 0.01])
    assert segment_map.sigma_m.tolist() == [0.0, 0.01, 0.0, 0.01]
    assert not segment_map.is_exact
    assert SegmentMap(ROOM_SEGMENTS[:2]).is_exact


def test_normals_point_to_the_left():
    segment_map = SegmentMap(ROOM_SEGMENTS, is_one_sided=True)
    along = segment_map.segments[:, 1] - segment_map.segments[:, 0]
    lefts = along[:, 0] * segment_map.normals[:, 1] - along[:, 1] * segment_map.normals[:, 0]
    np.testing.assert_allclose(lefts, np.hypot(*along.T), rtol=1e-12)


def test_walls_without_length_are_left_out():
    dots = np.zeros((1, 2, 2))
    assert len(SegmentMap(np.concatenate([ROOM_SEGMENTS, dots]), is_one_sided=True)) == 10


@pytest.mark.parametrize(
    ("segments", "sigma_m", "said"),
    [
        (np.zeros((3, 4)), None, r"segments must have shape \(N, 2, 2\)"),
        (np.full((1, 2, 2), np.nan), None, "segments must be finite"),
        (np.full((1, 2, 2), np.inf), None, "segments must be finite"),
        (ROOM_SEGMENTS, [0.1], r"sigma_m must have shape \(10\)"),
    ],
)
def test_bad_walls_are_refused(segments, sigma_m, said):
    with pytest.raises(ValueError, match=said):
        SegmentMap(segments, sigma_m)


def test_known_walls_that_are_not_finite_are_refused_as_well():
    walls = ROOM_SEGMENTS.copy()
    walls[3, 0, 0] = np.nan
    with pytest.raises(ValueError, match="segments must be finite"):
        SegmentMap.known(walls)


def test_beams_of_another_shape_are_refused():
    with pytest.raises(ValueError, match="origins_m"):
        Beams(np.zeros((2, 2)), np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="ranges_m"):
        Beams(np.zeros((3, 2)), np.zeros(3), np.zeros(2))


def test_part_of_a_map_is_of_the_same_types_to_compiled_code_as_the_whole():
    # a writable array beside a read-only one had the likelihood's kernels compiled twice, 4 s late
    whole = SegmentMap(ROOM_SEGMENTS)
    part = whole.seen_from(fan(ANGLES_RAD), ROOM_CENTRE, 8.0)
    assert 0 < len(part) < len(whole)
    for name in ("vertices", "walls", "normals", "sigma_m"):
        assert numba.typeof(getattr(part, name)) == numba.typeof(getattr(whole, name))

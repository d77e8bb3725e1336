"""Surfaces averaged from many scans: both sides of a wall, what was passed, thin things, edges."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from slam.beams import Beams
from slam.kernels.visibility import COUNTS, MET, PASSED, SILENT, looks_into
from slam.se2 import SE2
from slam.surface.surface_cells import Seen, SurfaceCells, SurfacesConfig
from slam.surface.surface_map import faced
from slam.surface.surfaces import Surfaces, _is_of_what_went, surfaces_of
from slam.surface.views import Glances, View
from tests.slam.synthetic import box, room, scan_of

LASER = SE2.identity()
ROOM = room(0.0, 0.0, 6.0, 4.0)
# a wall of 10 cm from below, with a way round its upper end
WALL = box(3.0, 0.0, 3.1, 2.6)
LEG = box(1.5, 3.0, 1.53, 3.03)
PLACES = [SE2(x, y, turn) for x, y in ((1.0, 1.0), (2.0, 3.4), (4.0, 3.4), (5.0, 1.0), (3.0, 3.4))
          for turn in (-2.0, -0.4, 1.1, 2.6)]  # fmt: skip
SIGMA_M = 0.02
LOOKS_ALONE = SurfacesConfig(glances=0)
"""Of the scans between keyframes."""


def seen(walls, place, rng):
    beams = Beams.of(scan_of(walls, place, rng, SIGMA_M, range_max_m=8.0), LASER)
    return place, faced(beams.points, beams.middle_m), beams


def surfaces_from(worlds) -> Surfaces:
    rng = np.random.default_rng(5)
    return surfaces_of([seen(walls, place, rng) for walls, place in worlds])


def off_m(points, segments) -> np.ndarray:
    """(K,) from points (K, 2) to the nearest of segments (S, 2, 2)."""
    starts, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    share = np.einsum("pwi,wi->pw", points[:, None] - starts, along) / np.sum(along**2, axis=1)
    nearest = starts + np.clip(share, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1)


TRUE = np.concatenate([ROOM, WALL, LEG])


@pytest.fixture(scope="module")
def surfaces() -> Surfaces:
    return surfaces_from([(TRUE, place) for place in PLACES])


def test_noise_is_averaged(surfaces):
    off = off_m(surfaces.points(), TRUE)
    assert np.mean(off < 0.05) > 0.99
    assert np.median(off) < 0.3 * SIGMA_M


def test_what_was_seen_is_there(surfaces):
    sides = np.array([[[3.0, 0.3], [3.0, 2.5]], [[3.1, 0.3], [3.1, 2.5]], [[0.0, 0.2], [0.0, 3.8]]])
    share = np.linspace(0.0, 1.0, 60)[:, None]
    for start, end in sides:
        wanted = start + share * (end - start)
        found = np.linalg.norm(wanted[:, None] - surfaces.points()[None], axis=2).min(axis=1)
        assert found.max() < 0.05


def test_the_two_sides_of_a_wall_stay_apart(surfaces):
    points = surfaces.points()
    beside = points[
        (np.abs(points[:, 0] - 3.05) < 0.2) & (points[:, 1] > 0.3) & (points[:, 1] < 2.4)
    ]
    astray_m = np.abs(np.abs(beside[:, 0] - 3.05) - 0.05)
    assert np.quantile(astray_m, 0.95) < SIGMA_M
    assert astray_m.max() < 0.05


def test_a_thin_leg_stays(surfaces):
    assert (np.linalg.norm(surfaces.points() - [1.515, 3.015], axis=1) < 0.05).any()


def test_walls_are_seen_from_their_free_side(surfaces):
    along = surfaces.segments[:, 1] - surfaces.segments[:, 0]
    left = np.column_stack([-along[:, 1], along[:, 0]])
    middles = surfaces.segments.mean(axis=1)
    is_upright = np.abs(along[:, 1]) > 0.9 * np.hypot(*along.T)
    is_outer = (np.abs(middles[:, 0]) < 0.03) & is_upright
    assert is_outer.sum() > 30
    assert (left[is_outer, 0] > 0.0).all()


def test_whoever_has_gone_is_left_out():
    somebody = [box(x, 1.9, x + 0.1, 2.0) for x in (1.2, 1.6, 4.2, 4.6)]
    worlds = [
        (np.concatenate([TRUE, somebody[index % 4]]) if index < 4 else TRUE, place)
        for index, place in enumerate(PLACES)
    ]
    off = off_m(surfaces_from(worlds).points(), TRUE)
    assert np.mean(off < 0.05) > 0.99
    assert off.max() < 0.3


def test_whoever_stood_still_is_told_by_the_scans_between_the_keyframes():
    # met by all keyframes that look there; of the scans between them some saw him come
    somebody = np.concatenate([TRUE, box(1.2, 1.9, 1.3, 2.0)])
    rng = np.random.default_rng(6)
    scans = [seen(somebody, place, rng) for place in PLACES]
    before = [View.of(T, beams) for T, _, beams in (seen(TRUE, place, rng) for place in PLACES[:8])]
    alone = surfaces_of(scans).points()
    off = off_m(alone, TRUE)
    assert (off > 0.3).sum() > 5
    stayed = surfaces_of(scans, [before]).points()
    assert off_m(stayed, TRUE).max() < 0.3
    # and nothing else has gone
    missed_m, _ = cKDTree(surfaces_of(scans, [before * 4]).points()).query(alone[off < 0.05])
    assert np.mean(missed_m < 0.05) > 0.98


def test_what_keyframes_hardly_saw_is_told_by_the_scans_between_them():
    # along a wall few beams of a keyframe end on it
    far, rng = box(0.0, -1.0, 8.0, -0.9), np.random.default_rng(11)
    places = [SE2(x, -0.6, 0.0) for x in np.linspace(0.0, 0.3, 5)]
    first, *since = [seen(far, place, rng) for place in places]
    wall_m = np.column_stack([np.linspace(0.5, 1.8, 100), np.full(100, -0.9)])

    def recall(surfaces):
        return np.mean(cKDTree(surfaces.points()).query(wall_m)[0] < 0.05)

    alone = recall(surfaces_of([first]))
    assert (
        recall(surfaces_of([first], [[View.of(T, beams) for T, _, beams in since]])) > alone + 0.2
    )


def test_beams_fired_on_the_way_are_seen_from_their_middle():
    angles, ranges = np.radians(np.linspace(-90.0, 90.0, 181)), np.full(181, 2.0)
    ranges[[20, 90]] = np.nan, np.inf  # at 90 straight ahead: inf times 0
    origins = np.column_stack([np.linspace(-0.1, 0.1, 181), np.zeros(181)])
    beams = Beams(origins, angles, ranges)
    view = View.of(SE2.identity(), beams)
    assert np.all(np.diff(view.angles_rad) >= 0.0)
    assert np.isfinite(view.ranges_m).sum() == np.isfinite(ranges).sum()
    assert off_points(view.faced(40.0)[:, :2], beams.points) < 1e-9
    # as those of a scan at rest are: to numba that is another type, compiled anew in a trial
    assert not view.angles_rad.flags.writeable
    assert not view.ranges_m.flags.writeable
    glances = Glances()
    glances.take(SE2.identity(), beams)
    kept = glances.kept[0].view(SE2.identity())
    assert off_points(kept.faced(40.0)[:, :2], beams.points) < 1e-5
    # one beam's end close by may lie beside another's, in the other order: no other one moves
    ranges[30:40] = 0.02
    near = Beams(origins, angles, ranges)
    view = View.of(SE2.identity(), near)
    assert np.all(np.diff(view.angles_rad) >= 0.0)
    assert off_points(view.faced(40.0)[:, :2], near.points) < 1e-9


def off_points(points, others) -> float:
    """How far the farthest of points (N, 2) lies from the nearest of others."""
    assert len(points) == len(others)
    return float(cKDTree(others).query(points)[0].max())


def test_scans_of_one_keyframe_are_no_witnesses_of_their_own():
    # six points in a row: enough for all of it where each is a keyframe's, less where six of five
    # scans of one are
    config = SurfacesConfig()
    points = np.column_stack([np.linspace(1.0, 1.1, 6), np.full(6, 1.0), np.full(6, -np.pi / 2)])

    def pieces(scans):
        one = [Seen(LASER, points[k : k + 1], np.array([1.05, 0.0]), scans) for k in range(6)]
        return SurfaceCells.of(one, config).pieces(config)

    many = pieces(1)
    assert len(many[0]) >= 2
    assert len(pieces(5)[0]) < len(many[0])
    certain = replace(config, most_sigma_m=1.0)
    one, other = (
        SurfaceCells.of([Seen(LASER, points, np.array([1.05, 0.0]), scans)], certain).pieces(
            certain
        )[2]
        for scans in (1, 5)
    )
    assert np.allclose(one, 5.0 * other)


def test_of_many_scans_between_two_keyframes_four_are_taken(monkeypatch):
    taken, of = [], SurfaceCells.of
    monkeypatch.setattr(
        SurfaceCells,
        "of",
        staticmethod(lambda seen, config: taken.append(seen) or of(seen, config)),
    )
    scan = seen(TRUE, PLACES[0], np.random.default_rng(12))
    for count, expected in ((0, 1), (3, 4), (4, 5), (16, 5)):
        surfaces_of([scan], [[View.of(scan[0], scan[2])] * count])
        assert len(taken[-1]) == expected
        assert {one.scans for one in taken[-1]} == {expected}


def test_a_beam_from_nowhere_passed_what_returned_others_from_as_far():
    rng = np.random.default_rng(7)
    # a leg in the open: what is behind it is out of reach; the wall at the side is not
    wall = box(-1.0, 4.0, 1.0, 4.2)
    leg = np.concatenate([box(2.0, -0.1, 2.1, 0.1), wall])
    place = SE2.identity()
    scans = [seen(leg, place, rng) for _ in range(4)]
    empty = [View.of(T, beams) for T, _, beams in (seen(wall, place, rng) for _ in range(4))]
    assert (off_m(surfaces_of(scans).points(), leg) < 0.1).sum() >= 4
    near = np.hypot(*surfaces_of(scans, [empty]).points().T) < 3.0
    assert not near.any()
    # one in eight is what a thin leg does while it stands
    again = [View.of(T, beams) for T, _, beams in scans] * 6
    assert (off_m(surfaces_of(scans, [again + empty]).points(), leg) < 0.1).sum() >= 4
    assert (np.hypot(*surfaces_of(scans, [again + empty]).points().T) < 3.0).any()


def test_two_looks_through_somebody_outweigh_a_hundred_that_met_him():
    # he waits at one spot, goes for as long as two scans take, and comes back to it
    somebody = np.concatenate([TRUE, box(1.2, 1.9, 1.3, 2.0)])
    rng = np.random.default_rng(8)
    there = [seen(somebody, place, rng) for place in PLACES]
    gone = [seen(TRUE, PLACES[2], rng) for _ in range(2)]
    views = [View.of(T, beams) for T, _, beams in gone]
    waits = [[View.of(T, beams) for T, _, beams in there[:4]] * 10] * 3
    around = [*waits[:1], views, *waits[1:]]
    assert (off_m(surfaces_of(there, waits).points(), TRUE) > 0.3).sum() > 5
    assert off_m(surfaces_of(there, around).points(), TRUE).max() < 0.3
    # of a leg that ends at the height of the beams two looks of some hundreds see nothing
    long = [[View.of(T, beams) for T, _, beams in there[:4]] * 60] * 3
    rarely = surfaces_of(there, [*long[:1], views, *long[1:]]).points()
    assert (off_m(rarely, TRUE) > 0.3).sum() > 5
    # one look alone may have been of another spot
    assert (off_m(surfaces_of(there, [views[:1], *waits]).points(), TRUE) > 0.3).sum() > 5


def test_who_was_seen_through_goes_as_a_whole():
    segments = np.array([[[x, 0.0], [x + 0.03, 0.0]] for x in (0.0, 0.04, 0.08, 1.0, 1.04, 1.08)])
    stays = np.array([False, False, True, True, False, False])
    # of a leg of a chair most looks meet its front; what hardly any met tells nothing of it
    met = np.array([40, 40, 50, 90, 20, 20])
    seen = Surfaces(segments, np.full(6, 0.01), met, np.zeros(6, dtype=np.int64))
    every = np.ones(6, dtype=bool)
    assert _is_of_what_went(seen, stays, every).tolist() == [True] * 3 + [False] * 3
    none = np.zeros(0, dtype=bool)
    assert _is_of_what_went(surfaces_of([]), none, none).tolist() == []


def test_light_mixed_behind_a_leg_does_not_take_the_leg_along():
    # a leg of experiment 3, and two places behind it that beams were mixed to once or twice, but
    # which hundreds of looks were counted to have met
    segments = np.array([[[0.0, y], [0.03, y]] for y in (0.0, 0.08, 0.10)])
    met = np.array([245, 154, 119])
    seen = Surfaces(segments, np.full(3, 0.01), met, np.zeros(3, dtype=np.int64))
    stays = np.array([True, False, False])
    assert not _is_of_what_went(seen, stays, stays)[0]
    assert _is_of_what_went(seen, stays, np.ones(3, dtype=bool))[0]


@pytest.mark.parametrize(
    ("behind", "expected"),
    [
        ([3.5] * 9, (0, 1, 0)),
        # light mixed at a thin leg: the beam ends between the leg and what is behind it
        ([3.5] * 4 + [2.9] + [3.5] * 4, (0, 0, 0)),
        ([3.5] * 3 + [2.1] * 3 + [3.5] * 3, (1, 0, 0)),
        # a step behind it is none
        ([3.5] * 5 + [2.9] * 4, (0, 1, 0)),
    ],
)
def test_looks_of_one_scan_at_a_leg(behind, expected):
    counts = looked([behind], 2.0)
    assert tuple(counts[0, [MET, PASSED, SILENT]]) == expected


def test_silence_tells_as_far_as_beams_came_back_and_a_little_farther():
    met, none = [3.6] * 9, [np.inf] * 9
    # askew: what is far and met so is no certain thing
    askew = (-0.5, np.sqrt(0.75))
    for ahead_m, told in ((3.6, 1), (3.7, 1), (3.95, 0)):
        counts = looked([met, none], ahead_m, facing=askew, first_m=3.6)
        assert counts[0, SILENT] == told, ahead_m


def test_a_lone_point_beside_an_edge_is_no_surface_where_a_hundred_looks_met_the_edge():
    # a wall a metre ahead ends beside the robot; of light mixed there one beam ended beyond it
    rng = np.random.default_rng(9)
    y = rng.uniform(-0.6, 0.0, 60)
    wall = np.column_stack([np.full(60, 1.0), y, np.full(60, math.pi)])
    points = np.concatenate([wall, [[1.02, 0.03, math.pi]]])
    angles = np.radians(np.linspace(-40.0, 40.0, 321))
    beams = Beams(np.zeros((321, 2)), angles, 1.0 / np.cos(angles))
    place = SE2.identity()
    kept = []
    for looks in (20, 100):
        glances = [[View.of(place, beams)] * looks]
        found = surfaces_of([(place, points, beams)], glances, LOOKS_ALONE).points()
        kept.append((found[:, 1] > 0.002).any())
        assert (found[:, 1] < -0.5).any()
    assert kept == [True, False]


def test_a_leg_stays_though_lone_points_beside_it_go():
    rng = np.random.default_rng(10)
    y = np.concatenate([np.linspace(-0.045, -0.005, 6), [0.03, -0.07]])
    points = np.column_stack([1.0 + 0.002 * rng.standard_normal(8), y, np.full(8, math.pi)])
    angles = np.radians(np.linspace(-40.0, 40.0, 321))
    beams = Beams(np.zeros((321, 2)), angles, 1.0 / np.cos(angles))
    glances = [[View.of(SE2.identity(), beams)] * 100]
    found = surfaces_of([(SE2.identity(), points, beams)], glances, LOOKS_ALONE).points()
    assert len(found)
    assert ((found[:, 1] > -0.065) & (found[:, 1] < 0.025)).all()


def looked(scans, ahead_m, facing=(-1.0, 0.0), first_m=None, half_m=0.05, turned_deg=0.0):
    """What `looks_into` counts of a point so far ahead; first_m: as far as it is for the first; half_m: of
    its surface to either side; turned_deg: of the beams, half a degree apart."""
    angles = np.radians(np.linspace(-2.0, 2.0, 9) + turned_deg)
    hardest, counts = np.array([[0.0, 1.0]]), np.zeros((1, COUNTS), dtype=np.int64)
    for index, ranges in enumerate(scans):
        way = first_m if first_m is not None and index == 0 else ahead_m
        looks_into(
            np.array([[way, 0.0]]), np.array([facing]), np.array([half_m]), np.zeros(3), np.zeros(2), angles,
            np.array(ranges), 0.08, 0.02, 0.05, 4.0, hardest, counts,
        )  # fmt: skip
    return counts


@pytest.mark.parametrize(("half_m", "turned_deg", "passed"), [
    (0.0125, 0.25, 0), (0.0125, 0.05, 1), (0.05, 0.25, 1),
])  # fmt: skip
def test_beams_to_either_side_of_a_thin_leg_do_not_pass_through_it(half_m, turned_deg, passed):
    # of the legs of chairs, 2.6 cm thin, lasers with a beam each degree or half had lost most
    counts = looked([[9.0] * 9], 3.0, half_m=half_m, turned_deg=turned_deg)
    assert counts[0, PASSED] == passed


def test_surfaces_move_with_their_frame(surfaces):
    T = SE2(1.0, -2.0, 0.7)
    there = surfaces.moved(T)
    assert np.allclose(there.points(), T @ surfaces.points())
    assert there.sigma_m is surfaces.sigma_m


def test_nothing_seen_gives_nothing():
    nothing = surfaces_of([])
    assert len(nothing) == 0
    assert nothing.points().shape == (0, 2)
    with pytest.raises(ValueError, match="no surface"):
        nothing.walls()
    lost = Beams(np.zeros((3, 2)), np.array([0.0, 0.1, 0.2]), np.full(3, np.inf))
    assert len(surfaces_of([(SE2.identity(), np.zeros((0, 3)), lost)])) == 0


def test_equal_scans_give_equal_bytes():
    one, other = (surfaces_from([(TRUE, place) for place in PLACES[:6]]) for _ in range(2))
    assert one.segments.tobytes() == other.segments.tobytes()


def test_scans_since_a_keyframe_are_kept_evenly_and_sixteen_at_most():
    glances = Glances()
    beams = Beams(np.zeros((3, 2)), np.array([0.0, 0.1, 0.2]), np.array([1.0, np.inf, 2.0]))
    for k in range(1000):
        glances.take(SE2(0.001 * k, 0.0, 0.0), beams)
    at = np.array([glance.T_keyframe_base.x for glance in glances.kept]) / 0.001
    assert 8 < len(at) <= 16
    assert np.ptp(np.diff(at)) < 1e-6
    assert at[0] == 0.0
    assert at[-1] > 900.0
    view = glances.kept[0].view(SE2(1.0, 2.0, 0.0))
    assert view.T_map_base.y == 2.0
    assert view.ranges_m.tolist() == [1.0, np.inf, 2.0]


def test_scans_that_start_in_one_place_keep_their_directions_once():
    angles_rad = np.array([0.0, 0.1, 0.2])
    first = Beams(np.zeros((3, 2)), angles_rad, np.ones(3))
    origins = np.array([[0.0, 0.0], [0.1, 0.0], [0.2, 0.0]])
    glances = Glances()
    for beams in (
        first,
        first.with_ranges(np.full(3, 2.0)),
        Beams(origins, angles_rad, np.ones(3)),
    ):
        glances.take(SE2.identity(), beams)
    one, other, moving = glances.kept
    assert other.angles_rad is one.angles_rad
    np.testing.assert_allclose(one.angles_rad, angles_rad, atol=1e-7)
    # as seen from the middle of where they start
    assert not np.allclose(moving.angles_rad, angles_rad, atol=1e-3)

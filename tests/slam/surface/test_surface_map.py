"""Surfaces have two sides, and corners two walls: what a scan may be matched with, and what not."""

import math

import numpy as np
import pytest

from slam.beams import Beams
from slam.frontend.front_end import FrontEnd
from slam.kernels.surface_map import LEVEL, SIDE, STATE, USES, line_normal, place_of
from slam.kernels.surface_search import count_on_walls, peaks_into
from slam.measurements import LaserScan, Measurement
from slam.se2 import SE2
from slam.surface.surface_map import (
    SurfaceMap,
    SurfaceMapConfig,
    all_moved,
    faced,
    faced_ends,
    moved,
)
from tests.slam.synthetic import box, room, scan_of

WALL_M = 0.12
ALONG_M = np.linspace(0.5, 3.5, 151)


def wall(x_m: float) -> np.ndarray:
    return np.column_stack([np.full(len(ALONG_M), x_m), ALONG_M])


def seen(points: np.ndarray, seen_from: tuple[float, float]) -> np.ndarray:
    return faced(points, np.array(seen_from))


def match_of(surfaces: SurfaceMap, points: np.ndarray):
    start = SE2.identity()
    return surfaces.match(points, start, start, np.eye(3))


def test_a_wall_faces_the_laser():
    assert np.allclose(seen(wall(2.0), (0.0, 2.0))[:, 2] % math.tau, math.pi, atol=1e-6)
    assert np.allclose(seen(wall(2.0), (4.0, 2.0))[:, 2], 0.0, atol=1e-6)


@pytest.mark.parametrize("turned", [*np.linspace(-3.0, 3.0, 13), 0.5 * math.pi, math.pi])
def test_a_wall_faces_the_laser_whichever_way_it_runs(turned):
    c, s = math.cos(turned), math.sin(turned)
    points = wall(2.0) @ np.array([[c, s], [-s, c]])
    for side in (1.0, -1.0):
        laser = (2.0 - side) * np.array([c, s]) + 2.0 * np.array([-s, c])
        facing = faced(points, laser)[:, 2]
        assert (np.abs(facing) <= math.pi).all()
        towards = np.column_stack([np.cos(facing), np.sin(facing)])
        np.testing.assert_allclose(
            towards, np.tile([-side * c, -side * s], (len(points), 1)), atol=1e-6
        )


def test_a_lone_point_faces_the_laser():
    assert seen(np.array([[1.0, 1.0]]), (0.0, 0.0))[0, 2] == pytest.approx(-3 * math.pi / 4)


@pytest.mark.parametrize("count", [1, 12])
def test_ends_of_beams_are_faced_where_enough_of_them_are_not_close_by(count):
    """count: of beams that end far off; the others end at somebody who stands before the laser."""
    angles_rad = np.linspace(-1.0, 1.0, 60)
    ranges_m = np.where(np.arange(60) % (60 // count) == 0, 3.0, 0.4)
    ranges_m[[7, 8]] = np.inf, 50.0
    beams = Beams.of(LaserScan(0.0, angles_rad, ranges_m), SE2(0.1, 0.0, 0.0))
    points = beams.points_within(40.0)
    assert len(points) == 58
    faced_points = faced(points, beams.middle_m)
    np.testing.assert_array_equal(faced_ends(beams, 40.0, 0.6, count), faced_points)
    assert faced_ends(beams, 40.0, 0.6, count + 1).shape == (0, 3)


def test_a_wall_that_the_laser_looks_along_tells_nothing():
    points = seen(wall(2.0), (2.05, 0.0))
    assert np.isnan(points[:, 2]).all()
    surfaces = SurfaceMap()
    surfaces.add(points)
    assert match_of(surfaces, seen(wall(2.0), (0.0, 2.0))).seen_ratio == 0.0


def test_the_two_sides_of_a_wall_are_two_surfaces():
    surfaces = SurfaceMap()
    surfaces.add(seen(wall(2.0), (0.0, 2.0)))
    same = match_of(surfaces, seen(wall(2.0), (0.3, 1.0)))
    other = match_of(surfaces, seen(wall(2.0 + WALL_M), (4.0, 2.0)))
    assert same.seen_ratio == 1.0
    assert same.inlier_ratio == 1.0
    assert other.seen_ratio == 0.0


def test_what_was_added_can_be_taken_out():
    surfaces, points = SurfaceMap(), seen(wall(2.0), (0.0, 2.0))
    surfaces.add(points)
    surfaces.remove(points)
    assert match_of(surfaces, points).seen_ratio == 0.0


def test_points_make_the_same_surfaces_one_by_one_as_together():
    corner = np.concatenate([wall(2.0), wall(2.0)[:, ::-1]])
    points = seen(corner + 0.01 * np.random.default_rng(3).normal(size=corner.shape), (0.0, 0.0))
    points[::17, 2] = math.nan
    together, one_by_one = SurfaceMap(), SurfaceMap()
    together.add(points)
    for k in range(len(points)):
        one_by_one.add(points[k : k + 1])
    first, second = match_of(together, points), match_of(one_by_one, points)
    assert first.inlier_ratio > 0.9
    np.testing.assert_array_equal(first.information, second.information)
    # and what is taken out together leaves what was put in apart
    for surfaces in (together, one_by_one):
        surfaces.remove(points[:150])
    first, second = match_of(together, points), match_of(one_by_one, points)
    assert 0.2 < first.seen_ratio < 0.8
    np.testing.assert_array_equal(first.information, second.information)


def test_a_cleared_map_is_as_a_new_one():
    surfaces, new = SurfaceMap(), SurfaceMap()
    for k in range(5):
        # more than there was memory for, and some of it on the same places of the torus
        clouds = [
            moved(SE2(8.0 * k * j, 0.0, 0.3 * j), seen(wall(2.0), (0.0, 2.0))) for j in range(19)
        ]
        surfaces.add(np.concatenate(clouds))
        surfaces.clear()
        assert match_of(surfaces, clouds[0]).seen_ratio == 0.0
        assert surfaces.searched(clouds[0], SE2.identity(), 0.6, 0.2) == []
    grown = surfaces.memory_bytes
    points = seen(wall(1.5), (0.0, 2.0))
    surfaces.add(points)
    new.add(points)
    assert surfaces.memory_bytes == grown
    np.testing.assert_array_equal(match_of(surfaces, points).joined, match_of(new, points).joined)


def test_faced_points_turn_with_their_frame():
    turned = moved(SE2(1.0, 0.0, math.pi / 2), np.array([[1.0, 0.0, 0.25]]))
    assert turned == pytest.approx(np.array([[1.0, 1.0, 0.25 + math.pi / 2]]))


@pytest.mark.parametrize("slip", [0.98, 1.0, 1.02])
def test_a_door_is_passed_without_a_step(slip):
    # no surface across the way is seen from both rooms: the wall with the door has two sides
    thick = box(4.0, -0.5, 4.0 + WALL_M, 1.55), box(4.0, 2.45, 4.0 + WALL_M, 4.5)
    walls = np.concatenate([room(-2.0, -0.5, 10.0, 4.5), *thick])
    laser, rng = SE2(0.19, 0.0, 0.0), np.random.default_rng(3)
    front_end = FrontEnd(laser)
    step = SE2(0.02, 0.0, 0.0)
    pose = SE2(2.4, 2.0, 0.0)
    start = pose
    for index in range(150):
        scan = scan_of(walls, pose @ laser, rng, 0.02, range_max_m=3.5)
        told = SE2(0.02 * slip, 0.0, 0.0) if index else SE2.identity()
        noise = np.diag([0.001, 0.001, 0.001]) ** 2
        front_end.update(Measurement(0.1 * index, told, scan, noise))
        pose = pose @ step
    true = start.inverse() @ (pose @ step.inverse())
    off = true.inverse() @ front_end.T_map_base
    # the wheels alone, 2 % wrong, would be 6 cm off, and whatever matches the two sides of the wall 10
    assert abs(off.x) < 0.03
    assert abs(off.y) < 0.01


def test_a_map_that_rolls_along_takes_no_more_memory_and_forgets():
    cloud, start = seen(wall(2.0), (0.0, 2.0)), SE2.identity()
    surfaces = SurfaceMap()
    for k in range(60):  # 600 m: past the torus of the finest cells, and back to its start
        there = SE2(10.0 * k, 0.0, 0.1 * k)
        surfaces.add(moved(there, cloud))
        if k:
            surfaces.remove(moved(SE2(10.0 * (k - 1), 0.0, 0.1 * (k - 1)), cloud))
        assert surfaces.match(cloud, there, there, np.eye(3)).inlier_ratio > 0.9
    assert surfaces.memory_bytes < 20_000_000
    surfaces.remove(moved(there, cloud))
    assert surfaces.match(cloud, there, there, np.eye(3)).seen_ratio == 0.0
    assert surfaces.searched(cloud, start, 0.6, 0.2) == []


def test_more_cells_than_there_was_memory_for_are_all_kept():
    surfaces = SurfaceMap()
    clouds = [moved(SE2(5.0 * k, 0.0, 0.0), seen(wall(2.0), (0.0, 2.0))) for k in range(19)]
    before = surfaces.memory_bytes
    surfaces.add(np.concatenate(clouds))
    assert surfaces.memory_bytes > before
    for cloud in clouds:
        assert match_of(surfaces, cloud).inlier_ratio > 0.99


def test_search_counts_what_each_point_says():
    rng = np.random.default_rng(0)
    scan = scan_of(np.concatenate([room(-3.0, -2.0, 4.0, 3.0), box(1.0, 1.0, 2.0, 2.0)]),
                   SE2.identity(), rng, 0.01)  # fmt: skip
    points = faced(scan.points(SE2.identity()), np.zeros(2))
    surfaces = SurfaceMap()
    surfaces.add(points)
    off = SE2(0.37, -0.42, 0.17)
    found = surfaces.searched(moved(off.inverse(), points), SE2.identity(), 0.8, 0.3)
    assert any(pose.is_near(off, 0.2, 0.04) for pose in found)


def test_walls_that_go_on_beyond_what_is_known_tell_next_to_nothing_of_the_way():
    walls, half_circle = room(-9.0, -1.0, 9.0, 1.0), np.radians(np.arange(-90.0, 90.5, 0.5))
    facings, off_m = [], []
    for seed in range(12):
        rng, surfaces = np.random.default_rng(seed), SurfaceMap()

        def seen_at(x_m: float, rng: np.random.Generator = rng) -> np.ndarray:
            scan = scan_of(walls, SE2(x_m, 0.0, 0.0), rng, 0.01, half_circle, range_max_m=4.0)
            return faced(scan.points(SE2.identity()), np.zeros(2))

        for x_m in (0.0, -0.3, -0.6):
            surfaces.add(moved(SE2(x_m, 0.0, 0.0), seen_at(x_m)))
        there = SE2(-0.75, 0.0, 0.0)
        match = surfaces.match(seen_at(-0.75), there, there, np.diag([1e3, 1e4, 1e6]))
        facings.append(match.least_facing)
        off_m.append((there.inverse() @ match.T_map_base).x)
        assert np.linalg.eigvalsh(match.information).min() > 0.0
    # with what noise makes of it: 0.0007, and 12 mm back
    assert np.median(facings) < 3e-4
    assert abs(np.mean(off_m)) < 0.006


def test_match_along_a_wall_is_loosened_along_it_and_stays_where_it_is():
    surfaces, points = SurfaceMap(), seen(wall(2.0), (0.0, 2.0))
    surfaces.add(points)
    start = SE2.identity()
    match = surfaces.match(points, start, start, 1e4 * np.eye(3))
    loose = match.loosened_along_open(0.8)
    assert loose.T_map_base == match.T_map_base
    before, after = match.covariance, loose.covariance
    # the wall runs along y
    assert after[1, 1] - before[1, 1] == pytest.approx(0.8**2, rel=1e-3)
    assert after[0, 0] == pytest.approx(before[0, 0], rel=0.1)
    # nothing is known of a direction to begin with
    nothing = surfaces.match(points[:0], start, start, 1e4 * np.eye(3))
    assert nothing.loosened_along_open(0.8) is nothing


def sides_of(facing_rad: float) -> set[int]:
    """The two eighths of a turn nearest to a direction, the slow way."""
    off = [abs(math.remainder(facing_rad - math.tau * k / 8, math.tau)) for k in range(8)]
    return set(np.argsort(off)[:2].tolist())


def test_points_are_counted_on_walls_as_one_by_one():
    rng, level, cell_m = np.random.default_rng(5), 1, 0.4
    walls = np.column_stack([rng.uniform(-3.0, 3.0, (60, 2)), rng.uniform(-4.0, 4.0, 60)])
    points = np.column_stack([rng.uniform(-2.0, 2.0, (25, 2)), rng.uniform(-4.0, 4.0, 25)])
    points[3, 2] = math.nan
    surfaces = SurfaceMap()
    surfaces.add(walls)
    held: dict[tuple[int, int], set[int]] = {}
    for x, y, facing_rad in walls:
        cell = math.floor(x / cell_m), math.floor(y / cell_m)
        held.setdefault(cell, set()).update(sides_of(facing_rad))
    headings, counts = np.array([-0.3, 0.0, 1.1]), np.full((3, 7, 5), -1, np.int32)
    least = -0.613, -0.377
    count_on_walls(
        surfaces._heads, surfaces._sums, level, cell_m, points, *least, headings,
        counts,
    )  # fmt: skip
    for (k, u, v), count in np.ndenumerate(counts):
        pose = SE2(least[0] + u * cell_m / 2, least[1] + v * cell_m / 2, headings[k])
        told = moved(pose, points[~np.isnan(points[:, 2])])
        assert count == sum(
            not held.get((math.floor(x / cell_m), math.floor(y / cell_m)), set()).isdisjoint(
                sides_of(facing_rad)
            )
            for x, y, facing_rad in told
        )
    assert counts.max() > 5


def test_scans_are_moved_all_at_once_as_each():
    scans = [seen(wall(2.0), (0.0, 2.0)), np.empty((0, 3)), seen(wall(1.0), (3.0, 1.0))[:9]]
    poses = np.array([[0.3, -1.0, 3.0], [0.0, 0.0, 0.0], [-2.0, 0.5, -0.7]])
    each = [moved(SE2.from_array(pose), scan) for pose, scan in zip(poses, scans, strict=True)]
    assert (all_moved(poses, scans) == np.concatenate(each)).all()


def test_what_was_taken_out_leaves_nothing_to_be_matched_with():
    rng = np.random.default_rng(8)
    first, then = seen(wall(2.0), (0.0, 2.0)), seen(wall(2.0), (4.0, 2.0))
    slanted = np.column_stack([rng.uniform(1.0, 3.0, (80, 2)), np.full(80, 0.7)])
    for empty in (SurfaceMap.clear, lambda one: one.remove(first)):
        used, new = SurfaceMap(), SurfaceMap()
        used.add(first)
        assert match_of(used, first).seen_ratio == 1.0
        empty(used)
        for surfaces in (used, new):
            surfaces.add(then)
            surfaces.add(slanted)
        for points in (first, then, slanted):
            again, anew = match_of(used, points), match_of(new, points)
            assert again.T_map_base == anew.T_map_base
            assert (again.information == anew.information).all()
            assert again.seen_ratio == anew.seen_ratio


def test_both_sides_of_a_thin_wall_are_made_anew():
    # in one cell of all levels: asking for the one must not leave the other as it was
    near, far = seen(wall(2.02), (0.0, 2.0)), seen(wall(2.06), (4.0, 2.0))
    surfaces = SurfaceMap()
    for points in (near, far):
        surfaces.add(points)
        match_of(surfaces, points)
    moved_on = [moved(SE2(0.03, 0.0, 0.0), points) for points in (near, far)]
    for points in moved_on:
        surfaces.add(points)
    anew = SurfaceMap()
    for points in (near, far, *moved_on):
        anew.add(points)
    for points in (near, far):
        assert match_of(surfaces, points).T_map_base == match_of(anew, points).T_map_base


def test_each_cell_has_a_place_of_its_own_beside_its_neighbours():
    columns, rows = np.meshgrid(np.arange(-SIDE // 2, SIDE // 2), np.arange(7, SIDE + 7))
    places = np.vectorize(place_of.py_func)(columns[:, :96], rows[:, :96])
    assert len(np.unique(places)) == places.size
    assert 0 <= places.min() <= places.max() < SIDE * SIDE
    # a wall of 32 cells, either way, is on two pages of memory at most, of a thousand places each
    for wall_ in (places[:32, 5], places[5, :32]):
        assert len(np.unique(wall_ // 1024)) <= 2
        assert len(np.unique(wall_ // 16)) <= 9
    assert place_of(3, 4) == place_of(3 - SIDE, 4 + SIDE)


def test_more_points_than_a_map_begins_with_leave_it_as_if_there_had_been_room():
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-20.0, 20.0, (3000, 2)), rng.uniform(-3.0, 3.0, 3000)])
    grown, roomy = SurfaceMap(), SurfaceMap()
    for _ in range(8):
        roomy._grow()
    for surfaces in (grown, roomy):
        surfaces.add(points)
    assert len(grown._heads) < len(roomy._heads)
    for surfaces in (grown, roomy):  # each point once, at each of the levels
        counts = surfaces._sums[:, :, 0].sum(axis=1)
        for level in range(3):
            levels = surfaces._heads[:, STATE] >> LEVEL
            counted = counts[(surfaces._heads[:, USES] > 0) & (levels == level)].sum()
            assert counted == 2 * len(points)
    assert match_of(grown, points[:300]).T_map_base == match_of(roomy, points[:300]).T_map_base


def test_an_empty_map_is_all_zeros():
    # memory is so anyhow until somebody writes to it: people are asked for with a map of their own, and
    # to fill 12 MB with anything else took longer than to ask
    assert not SurfaceMap()._index.any()


@pytest.mark.parametrize(
    ("over", "cxy"),
    [
        (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1e-9), (-1.0, 1e-9), (-1.0, -1e-9),
        *np.random.default_rng(1).normal(size=(20, 2)).tolist(),
    ],
)  # fmt: skip
def test_the_normal_of_a_line_is_across_where_its_points_spread_most(over, cxy):
    normal = np.array(line_normal(over, cxy, math.hypot(over, cxy)))
    along = np.linalg.eigh(np.array([[over, cxy], [cxy, -over]]))[1][:, 1]
    assert normal @ normal == pytest.approx(1.0)
    assert normal @ along == pytest.approx(0.0, abs=1e-12)


def test_points_that_spread_alike_each_way_have_a_normal_all_the_same():
    assert line_normal(0.0, 0.0, 0.0) == (0.0, 1.0)


def test_the_best_of_several_starts_is_that_of_the_least_cost():
    surfaces, middle = SurfaceMap(), np.zeros(2)
    walls = np.concatenate([room(-4.0, -3.0, 4.0, 3.0), box(1.0, 1.0, 2.0, 1.5)])
    surfaces.add(faced(scan_of(walls, SE2.identity()).points(SE2.identity()), middle))
    points = faced(scan_of(walls, SE2(0.1, 0.05, 0.02)).points(SE2.identity()), middle)
    # the second ends where the first one did, and is not followed to the end; the others end elsewhere
    starts = [SE2(0.1, 0.0, 0.0), SE2(0.12, 0.02, 0.01), SE2(-0.1, 0.0, 3.1), SE2(1.5, 0.0, 1.6)]
    each = [surfaces.match_alone(points, start) for start in starts]
    assert each[1].T_map_base.is_near(each[0].T_map_base, 1e-3, 1e-3)
    assert each[0].cost < min(each[2].cost, each[3].cost) - 0.01
    for order, first in (([0, 1, 2, 3], 0), ([3, 1, 2, 0], 1), ([3], 3)):
        best, least = surfaces.best_alone(points, [starts[k] for k in order]), each[first]
        assert best.T_map_base == least.T_map_base
        assert (best.cost, best.seen_ratio, best.inlier_ratio) == (
            least.cost, least.seen_ratio, least.inlier_ratio,
        )  # fmt: skip
        np.testing.assert_array_equal(best.information, least.information)
        np.testing.assert_array_equal(best.joined, least.joined)


def test_points_are_looked_up_again_where_a_step_takes_them_elsewhere():
    around = np.linspace(-math.pi, math.pi, 400)
    ring = faced(2.0 * np.column_stack([np.cos(around), np.sin(around)]) + [0.5, 0.0], np.zeros(2))
    corner = faced(
        scan_of(room(-3.0, -4.0, 5.0, 4.0), SE2.identity()).points(SE2.identity()), np.zeros(2)
    )
    for points in (ring, corner):
        one, ten = (
            SurfaceMap(SurfaceMapConfig(finest=(2,), scales_m=(0.3,), max_steps=steps))
            for steps in (1, 10)
        )
        T = start = SE2(0.31, -0.23, 0.08)
        for surfaces in (one, ten):
            surfaces.add(points)
        for _ in range(10):
            before, T = T, one.match_alone(points, T).T_map_base
            if T.is_near(before, 7e-4, 5e-4):
                break
        assert not T.is_near(start, 0.2, 10.0)
        assert ten.match_alone(points, start).T_map_base.is_near(T, 1e-5, 1e-5)


def test_of_a_cell_that_holds_other_points_still_a_side_is_gone_with_its_own():
    surfaces = SurfaceMap()
    near, far = seen(wall(2.0), (0.0, 2.0)), seen(wall(2.0 + WALL_M), (4.0, 2.0))
    surfaces.add(near)
    surfaces.add(far)
    surfaces.remove(near)
    assert surfaces.searched(near, SE2.identity(), 0.1, 0.1) == []
    assert len(surfaces.searched(far, SE2.identity(), 0.1, 0.1)) > 0


def points_at(x_m: float, count: int) -> np.ndarray:
    """Faced points one beside the other in a cell."""
    return np.column_stack(
        [x_m + np.linspace(0.01, 0.09, count), np.full(count, 0.05), np.full(count, 0.1)]
    )


HELD = 1e9 * np.eye(3)
"""Information of odometry that no scan moves."""


def test_each_stage_looks_up_all_points_anew():
    # a piece beside the origin, whose cell there is the first one both of the fine and of the coarse level; the
    # coarse one holds another piece aside as well
    both, fine = (
        SurfaceMap(SurfaceMapConfig(finest=finest, scales_m=scales_m))
        for finest, scales_m in (((1, 2), (0.3, 0.0)), ((2,), (0.0,)))
    )
    piece, start = points_at(0.0, 9), SE2.identity()
    for surfaces in (both, fine):
        surfaces.add(piece)
        surfaces.add(piece + np.array([0.25, 0.25, 0.0]))
    at_once, alone = (one.match(piece, start, start, HELD) for one in (both, fine))
    assert alone.cost < 0.01
    assert at_once.cost == pytest.approx(alone.cost, abs=1e-6)


def test_a_point_that_turns_sees_what_faces_it_then():
    # a corner within a cell, about the middle of which a scan of it is turned: it ends along the one wall alone, and
    # nothing says where along that
    along = np.linspace(0.05, 0.35, 40)
    corner = np.concatenate(
        [
            np.column_stack([along, np.full(40, 0.05), np.full(40, 0.5 * math.pi)]),
            np.column_stack([np.full(40, 0.35), along, np.full(40, math.pi)]),
        ]
    )
    one, ten = (
        SurfaceMap(SurfaceMapConfig(finest=(1,), scales_m=(0.3,), max_steps=steps))
        for steps in (1, 10)
    )
    c, s = math.cos(1.0), math.sin(1.0)
    T = start = SE2(0.2 - c * 0.2 + s * 0.2, 0.2 - s * 0.2 - c * 0.2, 1.0)
    for surfaces in (one, ten):
        surfaces.add(corner)
    for _ in range(10):
        before, T = T, one.match_alone(corner, T).T_map_base
        if T.is_near(before, 7e-4, 5e-4):
            break
    assert ten.match_alone(corner, start).T_map_base.theta == pytest.approx(T.theta, abs=1e-3)


def test_points_taken_out_and_put_in_again_count_as_before_where_others_had_their_cell():
    # 1024 cells on, a point has the same place on the torus
    surfaces, first = SurfaceMap(), points_at(0.0, 5)
    for points in (first, points_at(102.4, 2), points_at(0.0, 3), points_at(0.1, 9)):
        surfaces.add(points)
    entry = surfaces._index[2, place_of(0, 0)]
    before = surfaces._sums[entry, 0].copy()
    surfaces.remove(first)
    surfaces.add(first)
    np.testing.assert_allclose(surfaces._sums[entry, 0], before, atol=1e-6)


def test_a_surface_is_made_of_no_points_a_turn_of_the_torus_away():
    tall = np.linspace(0.0, 3.0, 200)

    def wall_in(column: int) -> np.ndarray:
        return faced(
            np.column_stack([np.full(200, 0.1 * column + 0.05), tall]), np.array([-2.0, 1.5])
        )

    alone, both = SurfaceMap(), SurfaceMap()
    both.add(wall_in(11 + 1024))
    for surfaces in (alone, both):
        surfaces.add(wall_in(9))
    points = wall_in(10)
    start = SE2.identity()
    same, other = (one.match(points, start, start, HELD) for one in (alone, both))
    assert same.cost == other.cost
    np.testing.assert_array_equal(same.information, other.information)


def test_starts_that_lead_to_the_next_of_a_row_are_followed_too():
    row = [box(x, 0.7, x + 0.3, 1.0) for x in np.arange(-4.5, 4.6, 0.9)]
    corridor = np.concatenate([room(-30.0, -1.0, 30.0, 1.0), *row])
    points = faced(scan_of(corridor, SE2.identity()).points(SE2.identity()), np.zeros(2))
    surfaces = SurfaceMap()
    surfaces.add(points)
    beside, here = SE2(0.9, 0.0, 0.0), SE2(0.02, 0.0, 0.0)
    assert surfaces.match_alone(points, beside).T_map_base.is_near(beside, 0.01, 0.01)
    best = surfaces.best_alone(points, [beside, here])
    assert best.T_map_base.is_near(SE2.identity(), 0.01, 0.01)


def test_points_that_see_nothing_say_nothing_of_a_scan_without_noise():
    points = seen(wall(2.0), (0.0, 2.0))
    exact = SurfaceMap(SurfaceMapConfig(sigma_m=0.0))
    exact.add(
        points
        + np.column_stack([np.random.default_rng(2).normal(0.0, 0.01, (151, 2)), np.zeros(151)])
    )
    both = np.vstack([points, [[50.0, 50.0, 0.0]]])
    match = exact.match_alone(both, SE2(0.03, 0.0, 0.01))
    assert np.isfinite(match.T_map_base.as_array()).all()


def test_cells_that_do_not_lie_in_each_other_are_refused():
    with pytest.raises(ValueError, match="whole multiple"):
        SurfaceMapConfig(cells_m=(1.0, 0.3))
    with pytest.raises(ValueError, match="coarse to fine"):
        SurfaceMapConfig(cells_m=(0.1, 0.4))
    assert SurfaceMapConfig(cells_m=(0.9, 0.3)).cells_m == (0.9, 0.3)


def test_as_many_scans_are_moved_as_there_are_poses():
    scan = seen(wall(2.0), (0.0, 2.0))
    with pytest.raises(ValueError, match="pose of its own"):
        all_moved(np.zeros((1, 3)), [scan, scan])


def test_peaks_are_the_largest_and_lie_apart():
    counts = np.random.default_rng(9).integers(0, 60, (9, 12, 15)).astype(np.int32)
    left, expected = counts.copy(), []
    for _ in range(5):
        k, u, v = (int(i) for i in np.unravel_index(left.argmax(), left.shape))
        expected.append([k, u, v])
        left[max(k - 4, 0) : k + 5, max(u - 3, 0) : u + 4, max(v - 2, 0) : v + 3] = 0
    peaks = np.empty((5, 3), np.int64)
    assert peaks_into(counts.copy(), (4, 3, 2), peaks) == 5
    assert peaks.tolist() == expected
    assert peaks_into(np.zeros_like(counts), (4, 3, 2), peaks) == 0
    alone = np.zeros_like(counts)
    alone[8, 0, 14] = 1
    assert peaks_into(alone, (4, 3, 2), peaks) == 1
    assert peaks[0].tolist() == [8, 0, 14]

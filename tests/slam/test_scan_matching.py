"""Fast scan matching on a grid of surfels: no bias from its cells, and the sums that it says."""

import math
from dataclasses import replace

import numpy as np
import pytest

from slam.beams import Beams
from slam.scan_matching import SurfelMatch, SurfelMatchConfig, match_surfels
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from slam.surface.surfel_grid import SurfelGrid
from tests.slam.synthetic import ANGLES_RAD, ROOM_CENTRE, ROOM_SEGMENTS, box, scan_of

CELL_M = 0.02
NOISE = np.array([[1.0, 0.01], [5.0, 0.05]])
RECTANGLE = np.array(
    [
        [[-2.0, -1.5], [3.0, -1.5]],
        [[3.0, -1.5], [3.0, 2.0]],
        [[3.0, 2.0], [-2.0, 2.0]],
        [[-2.0, 2.0], [-2.0, -1.5]],
    ]
)
ORIGIN = np.zeros(2)


def points_at(pose: SE2, segments: np.ndarray = ROOM_SEGMENTS) -> np.ndarray:
    return Beams.of(scan_of(segments, pose), SE2.identity()).points


def moved(segments: np.ndarray, pose: SE2) -> np.ndarray:
    return (pose @ segments.reshape(-1, 2)).reshape(-1, 2, 2)


def off_m(a: SE2, b: SE2) -> tuple[float, float]:
    change = a.inverse() @ b
    return math.hypot(change.x, change.y), abs(change.theta)


@pytest.mark.parametrize("turn_rad", [0.0, 0.01, 0.35, math.pi / 4])
@pytest.mark.parametrize("tenths", range(0, 11))
def test_wall_anywhere_within_its_cells_leaves_no_bias(tenths, turn_rad):
    # half a cell in steps of a twentieth of it: a distance sampled at cells would be off by up to
    # a cell's quarter
    shift = SE2(tenths * 0.001, tenths * 0.0007, turn_rad)
    grid = SurfelGrid.of(SegmentMap(moved(RECTANGLE, shift), is_one_sided=True), CELL_M)
    true = shift @ SE2(0.3, 0.1, 0.4)
    start = true @ SE2(0.03, -0.02, 0.02)
    points = points_at(SE2(0.3, 0.1, 0.4), RECTANGLE)
    match = match_surfels(points, ORIGIN, grid, NOISE, start, SurfelMatchConfig())
    position_m, turn = off_m(true, match.T_map_base)
    assert match.is_settled
    # the last step is below 0.05 mm; the offset of a surfel is a float32 of metres, 0.2 um
    assert position_m < 1e-4
    assert turn < 1e-4


@pytest.mark.parametrize("seed", range(6))
def test_scan_finds_home_from_20_cm_and_10_degrees(seed):
    rng = np.random.default_rng(seed)
    grid = SurfelGrid.of(SegmentMap(ROOM_SEGMENTS))
    start = ROOM_CENTRE @ SE2(*rng.uniform(-0.14, 0.14, 2), rng.uniform(-0.17, 0.17))
    match = match_surfels(points_at(ROOM_CENTRE), ORIGIN, grid, NOISE, start, SurfelMatchConfig())
    position_m, turn = off_m(ROOM_CENTRE, match.T_map_base)
    # points in the corners lie in cells that the other wall has, and pull by a little
    assert position_m < 5e-4
    assert turn < 5e-4
    assert match.cost < 0.05
    assert match.point_count == len(ANGLES_RAD)


def slow_step(
    points: np.ndarray, grid: SurfelGrid, pose: SE2, scale_m: float, stride: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Information (3, 3), pull (3,) and mean cost of one look, point by point."""
    information, pull, cost = np.zeros((3, 3)), np.zeros(3), 0.0
    rows = len(grid.surfels) // grid.columns
    chosen = points[::stride]
    turn = np.array(
        [
            [math.cos(pose.theta), -math.sin(pose.theta)],
            [math.sin(pose.theta), math.cos(pose.theta)],
        ]
    )

    def surface_at(position: np.ndarray) -> np.ndarray | None:
        column, row = np.floor((position - grid.origin_m) / grid.cell_m).astype(int)
        if not (0 <= column < grid.columns and 0 <= row < rows):
            return None
        surfel = grid.surfels[row * grid.columns + column].astype(float)
        return surfel if surfel[3] > 0.0 else None

    for point in chosen:
        at = np.array([pose.x, pose.y]) + turn @ point
        range_m = np.hypot(*point)
        beam = turn @ point / range_m
        range_sigma = np.interp(range_m, NOISE[:, 0], NOISE[:, 1])
        # the nearest surface; where that shows its back, the first front on the way to the laser
        steps = range(4) if grid.is_one_sided and surface_at(at) is not None else range(1)
        fronts = [
            surface
            for surface in (surface_at(at - step * range_sigma * beam) for step in steps)
            if surface is not None and not (grid.is_one_sided and surface[:2] @ beam > 0.0)
        ]
        if not fronts:
            cost += 1.0
            continue
        nx, ny, offset, sigma_m = fronts[0]
        cosine = nx * beam[0] + ny * beam[1]
        residual = nx * at[0] + ny * at[1] - offset
        # the noise is that at the range where the surface is, within a fifth of its variance
        slope_m = np.interp(range_m + range_sigma, NOISE[:, 0], NOISE[:, 1]) - range_sigma
        there = range_sigma**2 - 2.0 * slope_m * residual * cosine / max(cosine**2, 0.09)
        range_variance = np.clip(there, 0.8 * range_sigma**2, 1.2 * range_sigma**2)
        variance = range_variance * max(cosine**2, 0.09) + sigma_m**2
        limit = scale_m**2 + 6.0 * variance
        share = limit / (limit + residual**2)  # Geman, McClure
        cost += 1.0 - share
        # of the residual by a motion (x, y, theta) of the base in its own frame
        normal_base = turn.T @ [nx, ny]
        slope = np.append(normal_base, normal_base[1] * point[0] - normal_base[0] * point[1])
        information += share**2 / variance * np.outer(slope, slope)
        pull -= share**2 / variance * residual * slope
    return information, pull, cost / len(points) * stride


@pytest.mark.parametrize("is_one_sided", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_one_step_is_that_of_the_obvious_sums(seed, is_one_sided):
    rng = np.random.default_rng(seed)
    walls = RECTANGLE if is_one_sided else ROOM_SEGMENTS
    grid = SurfelGrid.of(SegmentMap(walls, is_one_sided=is_one_sided))
    inside = SE2(0.5, 0.3, 0.4) if is_one_sided else ROOM_CENTRE
    pose = inside @ SE2(*rng.uniform(-0.1, 0.1, 2), rng.uniform(-0.1, 0.1))
    points = points_at(inside, walls) + rng.normal(0.0, 0.02, (len(ANGLES_RAD), 2))
    for scale_m, stride in ((0.1, 1), (0.3, 3), (0.0, 1)):
        config = SurfelMatchConfig(scales_m=(scale_m,), strides=(stride,), max_steps=1)
        match = match_surfels(points, ORIGIN, grid, NOISE, pose, config)
        information, pull, cost = slow_step(points, grid, pose, scale_m, stride)
        # surfels are float32, 6e-8 of metres: 0.2 um of residuals that are 20 mm wide
        np.testing.assert_allclose(
            match.information, information, rtol=2e-4, atol=2e-4 * abs(information).max()
        )
        assert match.cost == pytest.approx(cost, abs=2e-4)
        expected = pose @ SE2.exp(np.linalg.solve(information, pull))
        position_m, turn = off_m(expected, match.T_map_base)
        # the step is damped by 1e-4 of itself, and starts up to 15 cm off
        assert position_m < 1e-4
        assert turn < 5e-5
        assert match.steps == 1


def test_thin_things_draw_the_pose_to_neither_side():
    # 30 posts of 4 cm, thinner than the noise: a point behind a front is nearest to the back
    rng = np.random.default_rng(5)
    bearings = np.radians(np.linspace(-75.0, 75.0, 30))
    posts = [
        box(x - 0.02, y - 0.02, x + 0.02, y + 0.02)
        for x, y in 2.5 * np.column_stack([np.cos(bearings), np.sin(bearings)])
    ]
    walls = np.concatenate(posts)
    grid = SurfelGrid.of(SegmentMap(walls, is_one_sided=True))
    angles_rad = np.radians(np.linspace(-90.0, 90.0, 1081))
    found = []
    for _ in range(60):
        scan = scan_of(walls, SE2.identity(), rng, 0.03, angles_rad)
        points = Beams.of(scan, SE2.identity()).points
        match = match_surfels(
            points, ORIGIN, grid, np.array([[1.0, 0.03]]), SE2.identity(), SurfelMatchConfig()
        )
        found.append(match.T_map_base.log())
    sure_m = np.std(found, axis=0)[0] / math.sqrt(len(found))
    # 39 mm without the look at what lies before
    assert abs(np.mean(found, axis=0)[0]) < max(4.0 * sure_m, 0.002)


def test_ranges_that_noise_made_short_weigh_no_more_than_others():
    # noise of 3 % of the range, all ahead: by where the beams end, near ends weigh more
    rng = np.random.default_rng(6)
    wall = np.array([[[4.0, 3.0], [4.0, -3.0]]])
    grid = SurfelGrid.of(SegmentMap(wall), reach_m=1.0)
    angles_rad = np.radians(np.linspace(-30.0, 30.0, 241))
    noise, found = np.array([[0.1, 0.003], [10.0, 0.3]]), []
    for _ in range(200):
        scan = scan_of(wall, SE2.identity(), None, 0.0, angles_rad)
        ranges_m = scan.ranges_m * (1.0 + 0.03 * rng.normal(size=len(angles_rad)))
        points = Beams.of(replace(scan, ranges_m=ranges_m), SE2.identity()).points
        match = match_surfels(points, ORIGIN, grid, noise, SE2.identity(), SurfelMatchConfig())
        found.append(match.T_map_base.x)
    assert abs(np.mean(found)) < 0.002


def test_information_is_that_of_the_noise_at_the_true_pose():
    rng = np.random.default_rng(1)
    grid = SurfelGrid.of(SegmentMap(ROOM_SEGMENTS))
    sigma_m, found = 0.01, []
    for _ in range(300):
        scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE, rng, sigma_m)
        points = Beams.of(scan, SE2.identity()).points
        match = match_surfels(
            points, ORIGIN, grid, np.array([[1.0, sigma_m]]), ROOM_CENTRE, SurfelMatchConfig()
        )
        off = (match.T_map_base.inverse() @ ROOM_CENTRE).log()
        found.append(off @ match.information @ off)
    # the kernel and the floor of the incidence make it no exact likelihood: within a factor of 2
    assert 1.5 < np.mean(found) < 6.0


WALL = np.array([[[2.0, -3.0], [2.0, 3.0]]])


def matched_with_a_wall(start: SE2) -> SurfelMatch:
    grid = SurfelGrid.of(SegmentMap(WALL))
    points = points_at(SE2.identity(), WALL)
    return match_surfels(points, ORIGIN, grid, NOISE, start, SurfelMatchConfig())


def test_single_wall_is_found_and_tells_nothing_along_itself():
    match = matched_with_a_wall(SE2(0.05, 0.1, 0.02))
    values = np.linalg.eigvalsh(match.information)
    assert values[0] < 1e-6 * values[1]
    # across it and in heading the scan is found: the last step is below 0.05 mm
    assert abs(match.T_map_base.x) < 1e-4
    assert abs(match.T_map_base.theta) < 1e-4


def test_single_wall_leaves_the_scan_where_it_was_along_itself():
    match = matched_with_a_wall(SE2(0.05, 0.1, 0.02))
    # points 2 m ahead turn by 0.02 rad: 4 cm, if the turn is made about the base
    assert abs(match.T_map_base.y - 0.1) < 0.05


def test_points_where_no_surface_is_near_cost_one_and_say_nothing():
    grid = SurfelGrid.of(SegmentMap(ROOM_SEGMENTS))
    far = SE2(50.0, 50.0, 0.0)
    match = match_surfels(points_at(ROOM_CENTRE), ORIGIN, grid, NOISE, far, SurfelMatchConfig())
    assert match.cost == pytest.approx(1.0)
    assert not match.information.any()
    assert match.T_map_base == far


def test_scan_without_points_is_not_settled():
    grid = SurfelGrid.of(SegmentMap(ROOM_SEGMENTS))
    match = match_surfels(np.empty((0, 2)), ORIGIN, grid, NOISE, ROOM_CENTRE, SurfelMatchConfig())
    assert not match.is_settled
    assert match.point_count == 0
    assert match.T_map_base == ROOM_CENTRE


def test_grid_knows_the_nearest_wall_and_its_open_side():
    grid = SurfelGrid.of(SegmentMap(RECTANGLE, is_one_sided=True), CELL_M, reach_m=0.3)
    rows = len(grid.surfels) // grid.columns
    middles = grid.origin_m + CELL_M * (
        np.stack(np.meshgrid(np.arange(grid.columns), np.arange(rows)), axis=-1) + 0.5
    ).reshape(-1, 2)
    a, along = RECTANGLE[:, 0], RECTANGLE[:, 1] - RECTANGLE[:, 0]
    share = np.einsum("kij,ij->ki", middles[:, None] - a, along) / np.sum(along**2, axis=1)
    feet = a + np.clip(share, 0.0, 1.0)[..., None] * along
    distance_m = np.hypot(*np.moveaxis(middles[:, None] - feet, 2, 0)).min(axis=1)
    has = grid.surfels[:, 3] > 0.0
    # the walls are looked at in points half a cell apart, off their ends
    assert has[distance_m < 0.29].all()
    assert not has[distance_m > 0.3].any()
    normals, offsets = grid.surfels[has, :2].astype(float), grid.surfels[has, 2].astype(float)
    off = np.abs(np.sum(normals * middles[has], axis=1) - offsets)
    # beyond a wall's end its line may pass nearer than its end; never farther
    assert (off <= distance_m[has] + 1e-3).all()
    inside = (np.abs(middles[has] - [0.5, 0.25]) < [2.49, 1.74]).all(axis=1)
    aside = np.sum(normals * middles[has], axis=1) - offsets
    assert (aside[inside] > -1e-3).all()


def test_large_map_gets_larger_cells(monkeypatch):
    monkeypatch.setattr("slam.surface.surfel_grid._MAX_CELLS", 10_000)
    wide = SurfelGrid.of(SegmentMap(RECTANGLE), CELL_M)
    # 6 x 4.5 m with the reach around it, in 10 000 cells; one more row and column than fit
    assert wide.cell_m == pytest.approx(math.sqrt(6.0 * 4.5 / 10_000))
    assert len(wide.surfels) < 10_000 * 1.05


def test_map_without_walls_has_no_grid():
    with pytest.raises(ValueError, match="no walls"):
        SurfelGrid.of(SegmentMap(np.empty((0, 2, 2))))


@pytest.mark.parametrize(
    "wrong",
    [{"scales_m": ()}, {"scales_m": (-0.1,)}, {"strides": (1, 1)}, {"strides": (4, 2, 0)}],
)
def test_search_that_cannot_be_is_refused(wrong):
    with pytest.raises(ValueError, match=r"scales_m|strides"):
        SurfelMatchConfig(**wrong)

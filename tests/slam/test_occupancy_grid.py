"""Grids of cells: where their walls are, and what scans make of them."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from slam.beam_likelihood import match_beams
from slam.beams import Beams
from slam.laser_model import LaserModel
from slam.occupancy_grid import OccupancyGrid
from slam.range_noise import RangeNoise
from slam.se2 import SE2
from tests.slam.synthetic import ROOM_CENTRE, ROOM_SEGMENTS, scan_of

IDENTITY = SE2.identity()
TURNED = SE2(3.0, -2.0, 2.1)
ALL_AROUND_RAD = np.radians(np.arange(-180.0, 180.0, 1.0))
SQUARE = np.array(
    [
        [[0.0, 0.0], [4.0, 0.0]],
        [[4.0, 0.0], [4.0, 4.0]],
        [[4.0, 4.0], [0.0, 4.0]],
        [[0.0, 4.0], [0.0, 0.0]],
    ]
)


def grid_of(rows: list[str], pose: SE2 = IDENTITY, resolution_m: float = 0.1) -> OccupancyGrid:
    """A grid drawn as on paper, the highest y first: `#` occupied, `.` free, a space unknown."""
    values = {"#": 100, ".": 0, " ": -1}
    return OccupancyGrid(
        np.array([[values[c] for c in row] for row in rows[::-1]]), resolution_m, pose
    )


def one_beam(range_m: float, angle_rad: float = 0.0) -> Beams:
    return Beams(np.zeros((1, 2)), np.array([angle_rad]), np.array([range_m]))


def room_scans(segments: np.ndarray, count: int, seed: int) -> list[tuple[SE2, Beams]]:
    """Scans from all over the middle of a 4 x 4 m room, with a centimetre of noise."""
    rng = np.random.default_rng(seed)
    scans = []
    for _ in range(count):
        pose = SE2(*rng.uniform(1.0, 3.0, 2), rng.uniform(-3.0, 3.0))
        scan = scan_of(segments, pose, rng, 0.01, ALL_AROUND_RAD)
        scans.append((pose, Beams.of(scan, IDENTITY)))
    return scans


@pytest.mark.parametrize(
    ("cells", "resolution_m", "message"),
    [
        (np.zeros(3, dtype=int), 0.1, r"shape \(rows, columns\), not \(3,\)"),
        (np.zeros((0, 4), dtype=int), 0.1, r"not \(0, 4\)"),
        (np.full((2, 2), 101), 0.1, "between -1 and 100, found 101 to 101"),
        (np.full((2, 2), -2), 0.1, "found -2"),
        (np.zeros((2, 2)), 0.1, "integers from -1 to 100, not float64"),
        (np.zeros((2, 2), dtype=int), 0.0, "above 0, not 0.0"),
        (np.zeros((2, 2), dtype=int), math.nan, "above 0, not nan"),
    ],
)
def test_cells_that_are_none_are_refused(cells, resolution_m, message):
    with pytest.raises(ValueError, match=message):
        OccupancyGrid(cells, resolution_m, IDENTITY)


def test_pose_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="T_map_grid must be finite"):
        OccupancyGrid(np.zeros((1, 1), dtype=int), 0.1, SE2(math.inf, 0.0, 0.0))


def test_cells_are_a_read_only_copy():
    cells = np.zeros((2, 3), dtype=np.int64)
    grid = OccupancyGrid(cells, 0.1, IDENTITY)
    cells[0, 0] = 100
    assert grid.cells[0, 0] == 0
    assert grid.cells.dtype == np.int8
    with pytest.raises(ValueError, match="read-only"):
        grid.cells[0, 0] = 1


def test_first_row_is_lowest_and_columns_run_along_x():
    grid = grid_of(["#..", "..."], SE2(1.0, 2.0, 0.0))
    np.testing.assert_array_equal(grid.cells_of([[1.05, 2.15], [1.25, 2.05]]), [[1, 0], [0, 2]])
    np.testing.assert_array_equal(grid.value_at([[1.05, 2.15], [1.25, 2.05]]), [100, 0])
    np.testing.assert_allclose(grid.centres_of([[1, 0]]), [[1.05, 2.15]])


def test_heading_of_the_grid_counts():
    grid = grid_of(["..#"], SE2(1.0, 2.0, math.pi / 2.0))
    # the third column is now the third upwards, to the left of the corner
    np.testing.assert_allclose(grid.centres_of([[0, 2]]), [[0.95, 2.25]])
    assert grid.value_at([[0.95, 2.25]]) == 100


def test_outside_is_unknown_however_far():
    grid = grid_of(["#"])
    points = [[-0.01, 0.05], [0.05, 0.11], [1e300, -1e300], [0.05, 0.05]]
    np.testing.assert_array_equal(grid.value_at(points), [-1, -1, -1, 100])
    assert grid.cells_of([[-0.01, 0.05]]).tolist() == [[0, -1]]
    with pytest.raises(ValueError, match="finite"):
        grid.value_at([[math.nan, 0.0]])
    assert grid.value_at(np.empty((0, 2))).shape == (0,)


@given(
    st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-4.0, 4.0), st.floats(0.01, 2.0),
    st.integers(-500, 500), st.integers(-500, 500),
)  # fmt: skip
def test_centre_of_a_cell_lies_in_it(x, y, theta, resolution_m, row, column):
    grid = OccupancyGrid(np.zeros((1, 1), dtype=int), resolution_m, SE2(x, y, theta))
    assert grid.cells_of(grid.centres_of([[row, column]])).tolist() == [[row, column]]


def test_thresholds_are_those_of_map_saver():
    grid = OccupancyGrid(np.array([[-1, 0, 25, 26, 64, 65, 100]]), 0.1, IDENTITY)
    assert grid.is_free.tolist() == [[False, True, True, False, False, False, False]]
    assert grid.is_occupied.tolist() == [[False, False, False, False, False, True, True]]


def test_points_of_a_thick_wall_are_its_surface():
    grid = grid_of([".....", "#####", "#####", "#####", "     "])
    np.testing.assert_allclose(grid.points()[:, 1], 0.35)
    assert len(grid.points()) == 5


def test_cell_that_touches_free_space_at_a_corner_is_surface():
    grid = grid_of(["##", "#."])
    assert len(grid.points()) == 3


def test_without_free_cells_all_occupied_ones_are_points():
    assert len(grid_of(["###", "# #"]).points()) == 5


@pytest.mark.parametrize("pose", [IDENTITY, TURNED])
def test_walls_lie_where_the_cells_are(pose):
    grid = grid_of(["......"] * 4 + ["######"] * 3, pose)
    walls = grid.walls()
    ends = pose.inverse() @ walls.segments.reshape(-1, 2)
    np.testing.assert_allclose(ends[:, 1], 0.25, atol=1e-6)
    # what is left of a cell's side when it is read as one number: evenly spread over it
    assert walls.sigma_m == pytest.approx(0.1 / math.sqrt(12.0))


def test_both_sides_of_a_wall_have_lines_of_their_own():
    grid = grid_of(["." * 20] * 3 + ["#" * 20] * 3 + ["." * 20] * 3)
    heights_m = grid.walls().segments[..., 1]
    np.testing.assert_allclose(np.unique(heights_m.round(6)), [0.35, 0.55])


def test_wall_one_cell_thick_is_its_middle():
    grid = grid_of(["." * 20] * 3 + ["#" * 20] + ["." * 20] * 3)
    np.testing.assert_allclose(grid.walls().segments[..., 1], 0.35, atol=1e-6)


@pytest.mark.parametrize("slope", [0.0, 0.2, 0.5, 0.7, 1.0])
def test_slanted_wall_is_met_by_beams_from_either_side(slope):
    cells = np.zeros((60, 60), dtype=int)
    columns = np.arange(5, 55)
    cells[np.floor(5.5 + slope * (columns - 5)).astype(int), columns] = 100
    walls = OccupancyGrid(cells, 0.1, IDENTITY).walls()
    x = np.linspace(1.0, 5.0, 400)
    y = 0.6 + slope * (x - 0.55)
    normal = np.array([-slope, 1.0]) / math.hypot(slope, 1.0)
    for side in (1.0, -1.0):
        angle = math.atan2(-side * normal[1], -side * normal[0])
        ranges_m = []
        for point in np.column_stack([x, y]) + side * normal:
            ranges, _ = walls.ranges(one_beam(1.0), SE2(*point, angle), 3.0)
            ranges_m.append(ranges[0])
        # cells of 10 cm know a line to half of that, and a bit more where it is cut to few of them
        np.testing.assert_allclose(ranges_m, 1.0, atol=0.07)


@pytest.mark.parametrize("pose", [IDENTITY, TURNED])
@pytest.mark.parametrize(
    ("rows", "size_m"), [(["#"], 0.1), (["##"], 0.2), (["##", "##"], 0.2), (["#.", ".#"], 0.2)]
)
def test_leg_is_a_cross_that_is_seen_from_all_around(rows, size_m, pose):
    around = ["." * 12] * 5
    drawn = [*around, *("." * 5 + row + "." * (7 - len(row)) for row in rows), *around]
    grid = grid_of(drawn, pose)
    walls = grid.walls()
    assert len(walls) == 4  # two pieces, each seen from either side
    lengths_m = np.hypot(*(walls.segments[:, 1] - walls.segments[:, 0]).T)
    assert lengths_m.max() == pytest.approx(size_m)
    middle = walls.segments.reshape(-1, 2).mean(axis=0)
    for angle in np.linspace(0.1, 2.0 * math.pi, 12):
        T_map_base = SE2(*(middle - np.array([math.cos(angle), math.sin(angle)])), angle)
        assert walls.ranges(one_beam(1.0), T_map_base, 3.0)[0] == pytest.approx(1.0, abs=1e-6)


def test_no_surface_is_farther_from_a_wall_than_a_cell():
    rng = np.random.default_rng(2)
    cells = np.where(rng.uniform(size=(60, 80)) < 0.08, 100, 0)
    cells[20:30, 10:60], cells[40, :] = 100, 100
    grid = OccupancyGrid(cells, 0.1, TURNED)
    segments = grid.walls().segments
    start, along = segments[None, :, 0], segments[None, :, 1] - segments[None, :, 0]
    offset = grid.points()[:, None] - start
    share = np.clip(np.sum(offset * along, axis=2) / np.sum(along**2, axis=2), 0.0, 1.0)
    distances_m = np.linalg.norm(offset - share[..., None] * along, axis=2).min(axis=1)
    assert distances_m.max() <= 0.06 + 1e-9


def test_grid_without_occupied_cells_has_no_walls():
    with pytest.raises(ValueError, match="none of 1 x 2 cells is occupied"):
        grid_of([".."]).walls()
    assert grid_of([".."]).points().shape == (0, 2)


def test_free_space_keeps_clear_of_what_is_occupied():
    grid = grid_of(["." * 21] * 10 + ["." * 10 + "#" + "." * 10] + ["." * 21] * 10)
    is_clear = grid.free_space(0.5)
    centres = grid.centres_of(np.argwhere(np.ones(grid.cells.shape)))
    square = np.maximum(np.abs(centres - [1.05, 1.05]) - 0.05, 0.0)
    distances_m = np.hypot(*square.T).reshape(grid.cells.shape)
    # never nearer than asked, and no more than a fifth of a cell given away
    assert distances_m[is_clear].min() >= 0.5
    assert is_clear[distances_m >= 0.5 + 0.021].all()
    assert (grid.free_space(0.0) == grid.is_free).all()


def test_free_space_has_no_unknown_cells_and_needs_no_walls():
    np.testing.assert_array_equal(grid_of([". ."]).free_space(5.0), [[True, False, True]])
    with pytest.raises(ValueError, match="must not be negative"):
        grid_of(["."]).free_space(-0.1)


def test_beam_clears_its_way_and_ends_in_a_wall():
    grid = OccupancyGrid.of_scans([(SE2(0.05, 0.05, 0.0), one_beam(0.4))], 0.1)
    np.testing.assert_array_equal(grid.cells, [[25, 25, 25, 25, 90]])
    assert grid.T_map_grid == IDENTITY
    assert grid.is_free.tolist() == [[True] * 4 + [False]]


def test_beam_without_return_clears_as_far_as_it_is_trusted():
    pose = SE2(0.05, 0.05, 0.0)
    grid = OccupancyGrid.of_scans([(pose, one_beam(math.inf))], 0.1, free_range_m=0.3)
    np.testing.assert_array_equal(grid.cells, [[25] * 4])
    with pytest.raises(ValueError, match="no beam of the scans tells anything"):
        OccupancyGrid.of_scans([(pose, one_beam(math.inf))], 0.1)


@pytest.mark.parametrize("range_m", [math.nan, -math.inf, 0.0, 2e5])
def test_invalid_beams_tell_nothing(range_m):
    with pytest.raises(ValueError, match="tells anything"):
        OccupancyGrid.of_scans([(IDENTITY, one_beam(range_m))], 0.1, free_range_m=5.0)


def test_scan_counts_once_for_a_cell_and_its_hit_goes_first():
    ranges = np.array([1.0, 1.0, 2.0])
    beams = Beams(np.zeros((3, 2)), np.array([0.0, 0.001, 0.002]), ranges)
    grid = OccupancyGrid.of_scans([(SE2(0.05, 0.05, 0.0), beams)], 0.1)
    assert grid.value_at([[1.05, 0.05], [0.55, 0.05], [2.05, 0.05]]).tolist() == [90, 25, 90]


def test_what_went_away_is_free_and_what_came_back_is_not():
    pose = SE2(0.05, 0.05, 0.0)
    ghost = [(pose, one_beam(0.5))] + [(pose, one_beam(1.0))] * 4
    assert OccupancyGrid.of_scans(ghost, 0.1).value_at([[0.55, 0.05]]) <= 25
    half = [(pose, one_beam(0.5))] * 4 + [(pose, one_beam(1.0))] * 4
    assert OccupancyGrid.of_scans(half, 0.1).value_at([[0.55, 0.05]]) >= 65


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
@example(89586)
def test_cells_of_a_beam_are_those_that_it_runs_through(seed):
    rng = np.random.default_rng(seed)
    pose = SE2(*rng.uniform(-3.0, 3.0, 2), rng.uniform(-3.0, 3.0))
    range_m = rng.uniform(0.01, 4.0)
    grid = OccupancyGrid.of_scans([(pose, one_beam(range_m))], 0.1)
    # the slow obvious way: points so near to each other that a missed cell is touched at a corner
    steps = np.linspace(0.0, range_m, 40_000)
    along = np.column_stack(
        [pose.x + steps * math.cos(pose.theta), pose.y + steps * math.sin(pose.theta)]
    )
    found, counts = np.unique(grid.cells_of(along), axis=0, return_counts=True)
    expected = np.full(grid.cells.shape, -1)
    expected[tuple(found.T)] = 25
    expected[tuple(grid.cells_of(along[-1:]).T)] = 90
    differing = np.argwhere(expected != grid.cells)
    at_corner = {tuple(cell) for cell, count in zip(found, counts, strict=True) if count < 3}
    for cell in {tuple(cell) for cell in differing} - at_corner:
        # a corner so small that it lies between two of the points
        to_cell_m = np.maximum(np.abs(along - grid.centres_of([cell])) - 0.05, 0.0)
        assert np.hypot(*to_cell_m.T).min() < steps[1]
        assert cell not in set(map(tuple, found))


def test_room_is_found_where_it_is_and_nothing_behind_its_walls():
    grid = OccupancyGrid.of_scans(room_scans(SQUARE, 60, seed=1), 0.05)
    points = grid.points()
    to_wall_m = np.minimum(np.abs(points), np.abs(points - 4.0)).min(axis=1)
    # a cell and what the noise adds
    assert to_wall_m.max() < 0.05 + 0.03
    inside = np.stack(np.meshgrid(*[np.arange(0.1, 3.95, 0.05)] * 2), axis=-1).reshape(-1, 2)
    assert (grid.value_at(inside) <= 25).all()
    assert (grid.value_at(inside) >= 0).all()
    around = np.arange(0.2, 3.8, 0.01)
    for wall in (0.0, 4.0):
        for swap in (slice(None), slice(None, None, -1)):
            near = [
                np.column_stack([around, np.full(len(around), wall + d)])[:, swap]
                for d in (-0.025, 0.025)
            ]
            # the wall runs between two cells: one of them has it
            assert (np.maximum(*(grid.value_at(p) for p in near)) >= 65).mean() > 0.99
    outside = np.array([[-0.2, 2.0], [4.2, 2.0], [2.0, -0.2], [2.0, 4.2], [20.0, 20.0]])
    assert (grid.value_at(outside) == -1).all()


def test_pose_is_found_on_the_walls_of_a_grid_of_scans():
    rng = np.random.default_rng(3)
    poses = [ROOM_CENTRE @ SE2(*rng.uniform(-0.8, 0.8, 2), rng.uniform(-3, 3)) for _ in range(60)]
    scans = [(pose, Beams.of(scan_of(ROOM_SEGMENTS, pose, rng, 0.01), IDENTITY)) for pose in poses]
    walls = OccupancyGrid.of_scans(scans, 0.05).walls()
    model = LaserModel(RangeNoise(((0.0, 0.01),)), range_max_m=10.0)
    for pose, beams in scans[:5]:
        match = match_beams(beams, walls, model, pose @ SE2(0.03, -0.03, 0.01))
        error = pose.inverse() @ match.T_map_base
        # a fifth of a cell
        assert math.hypot(error.x, error.y) < 0.01
        assert abs(error.theta) < 0.005
        assert match.inlier_ratio > 0.95


def test_scans_that_span_too_much_or_have_no_pose_are_refused():
    far = [(IDENTITY, one_beam(5e4, 0.7))]
    with pytest.raises(ValueError, match=r"span 38242\.2 x .* m, too many cells of 0\.05 m"):
        OccupancyGrid.of_scans(far, 0.05)
    with pytest.raises(ValueError, match="must be finite"):
        OccupancyGrid.of_scans([(SE2(math.nan, 0.0, 0.0), one_beam(1.0))], 0.05)
    for resolution_m, free_range_m in ((0.0, 1.0), (0.1, -1.0), (0.1, math.inf)):
        with pytest.raises(ValueError, match="must be"):
            OccupancyGrid.of_scans([(IDENTITY, one_beam(1.0))], resolution_m, free_range_m)
    with pytest.raises(ValueError, match="tells anything"):
        OccupancyGrid.of_scans([])

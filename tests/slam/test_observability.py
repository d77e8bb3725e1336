"""Scans that leave a direction open: nothing is believed along it, and the rest is corrected."""

import math

import numpy as np
import pytest

from slam.known_map import KnownMap
from slam.localization import LocalizerConfig
from slam.measurements import Measurement
from slam.observability import held
from slam.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from slam.point_map import PointMap
from slam.scan_match import MatchStatus
from slam.se2 import SE2
from slam.surface.surface_map import faced
from tests.slam.all_methods import MODEL, SIGMA_M, localizer, matchers
from tests.slam.synthetic import ROOM_CENTRE, ROOM_SEGMENTS, round_wall, sampled, scan_of

REACH_M = 5.6
LASER = SE2(0.19, 0.0, 0.0)
CORRIDOR = np.array([[[-15.0, 1.0], [15.0, 1.0]], [[-15.0, -1.0], [15.0, -1.0]]])
WALL = np.array([[[2.0, -9.0], [2.0, 9.0]]])
# facets of 3 mm: what their directions tell of a heading, 240 beams in all, is half a radian
CIRCLE = round_wall(2.5, 5760)
# a laser in the middle of the circle, so that turns about it are turns of the base
CENTRED = SE2.identity()
STEP = SE2(0.05, 0.0, 0.0)


@pytest.fixture(scope="module")
def of_corridor() -> dict:
    return matchers(CORRIDOR)


@pytest.fixture(scope="module")
def of_wall() -> dict:
    return matchers(WALL)


@pytest.fixture(scope="module")
def of_circle() -> dict:
    return matchers(CIRCLE)


def followed(name, matcher, segments, true, off, mount=LASER, count=5):
    """Estimates of a robot that stands, its belief wrong at first by off."""
    rng = np.random.default_rng(1)
    robot = localizer(name, matcher, true @ off, mount)
    estimates = []
    for i in range(count):
        scan = scan_of(segments, true @ mount, rng, SIGMA_M, range_max_m=REACH_M)
        estimates.append(robot.update(Measurement(0.1 * i, SE2.identity(), scan)))
    return estimates


BLIND = ["paper", "open3d", "fast", "limit"]


@pytest.mark.parametrize(
    ("name", "heading"),
    [
        *[(name, heading) for name in ("paper", "open3d") for heading in (0.0, 0.6, math.pi / 2)],
        *[(name, heading) for name in ("fast", "limit") for heading in (0.0, 0.6, math.pi / 2)],
    ],
)
def test_corridor_without_an_end_is_never_matched_and_the_way_along_it_is_kept(
    name, heading, of_corridor
):
    true, off = SE2(0.3, 0.2, heading), SE2(0.04, 0.05, 0.02)
    start = true @ off
    for estimate in followed(name, of_corridor[name], CORRIDOR, true, off):
        assert not estimate.is_matched
        # the prediction, but for its turn by 0.02 rad about the points, whose middle is up to a metre
        # away
        assert abs(estimate.T_map_base.x - start.x) < 0.02
    assert estimate.match.status is MatchStatus.DEGENERATE
    # across the corridor and in heading it is right: paper's ends 3 cm off by its stop rule
    limit = 0.03 if name == "paper" else 0.005
    assert abs(estimate.T_map_base.y - true.y) < limit
    assert abs((true.inverse() @ estimate.T_map_base).theta) < limit


@pytest.mark.parametrize("name", ["paper", "open3d", "fast", "limit"])
def test_single_wall_is_never_matched_and_holds_what_it_can(name, of_wall):
    true, off = SE2(0.5, 0.4, 0.1), SE2(-0.05, 0.06, -0.02)
    start = true @ off
    for estimate in followed(name, of_wall[name], WALL, true, off):
        assert not estimate.is_matched
        # 1.5 m from the wall, turned by 0.02 rad: 3 cm if it is turned about the points
        assert abs(estimate.T_map_base.y - start.y) < 0.05
    assert estimate.match.status is MatchStatus.DEGENERATE
    limit = 0.03 if name == "paper" else 0.006
    assert abs(estimate.T_map_base.x - true.x) < limit
    assert abs((true.inverse() @ estimate.T_map_base).theta) < limit


@pytest.mark.parametrize(
    "name",
    [
        *(pytest.param(one, marks=pytest.mark.slow) for one in ("paper", "open3d", "fast")),
        "limit",
    ],
)
def test_round_wall_is_never_matched_and_leaves_the_heading(name, of_circle):
    true, off = SE2(0.0, 0.0, 0.8), SE2(0.05, -0.04, 0.03)
    start = true @ off
    for estimate in followed(name, of_circle[name], CIRCLE, true, off, CENTRED):
        assert not estimate.is_matched
        # half a radian in a scan, joined with a tenth of a radian: it moves by some hundredths
        assert abs((start.inverse() @ estimate.T_map_base).theta) < 0.1
    assert estimate.match.status is MatchStatus.DEGENERATE
    # the belief was 64 mm off; with the heading open, limit does not believe its position either
    assert math.hypot(estimate.T_map_base.x, estimate.T_map_base.y) < 0.065


@pytest.mark.parametrize("name", ["fast", "limit"])
def test_variance_along_the_corridor_grows_with_the_way_and_shrinks_across(name, of_corridor):
    rng = np.random.default_rng(2)
    true = SE2(-1.0, 0.2, 0.0)
    robot = localizer(name, of_corridor[name], true, LASER, LocalizerConfig())
    noise = np.diag([0.002, 0.002, 0.002]) ** 2
    deviations = []
    for i in range(20):
        true = true @ STEP
        scan = scan_of(CORRIDOR, true @ LASER, rng, SIGMA_M, range_max_m=REACH_M)
        estimate = robot.update(Measurement(0.1 * i, STEP, scan, noise))
        deviations.append(np.sqrt(np.diag(estimate.covariance)))
    along, across = np.array(deviations)[:, 0], np.array(deviations)[:, 1]
    # nothing tells of it: it never gets smaller than at first, 10 cm
    assert (np.diff(along) > 0.0).all()
    assert along[0] > 0.1
    # 481 beams of 10 mm: below 2 mm at once, and one scan after the other less
    assert across[-1] < 0.002


def turned(turn, segments):
    """Walls (S, 2, 2), each moved so."""
    return (turn @ segments.reshape(-1, 2)).reshape(-1, 2, 2)


def known_grid(segments, turn, lower_m, upper_m):
    """The occupancy grid, cells of 5 cm, of walls about a rectangle that is free, moved so."""
    points = turn @ sampled(segments, 0.01)
    corner_m = points.min(axis=0) - 0.5
    columns, rows = np.ceil((points.max(axis=0) + 0.5 - corner_m) / 0.05).astype(int)
    cells = np.full((rows, columns), UNKNOWN, dtype=np.int8)
    y, x = np.mgrid[:rows, :columns]
    centres = corner_m + 0.05 * (np.column_stack([x.ravel(), y.ravel()]) + 0.5)
    inside = turn.inverse() @ centres
    is_free = ((inside > lower_m) & (inside < upper_m)).all(axis=1)
    cells[is_free.reshape(rows, columns)] = FREE
    at = np.floor((points - corner_m) / 0.05).astype(int)
    cells[at[:, 1], at[:, 0]] = OCCUPIED
    return KnownMap.of_grid(OccupancyGrid(cells, 0.05, SE2(*corner_m, 0.0)))


@pytest.mark.parametrize("heading", [0.06, 0.1, 0.14])
def test_stairs_that_cells_make_of_a_slanted_wall_hold_nothing_along_it(heading):
    turn = SE2(0.3, 0.7, heading)
    known = known_grid(CORRIDOR, turn, (-15.0, -0.97), (15.0, 0.97))
    for name in ("fast", "limit"):
        rng, true = np.random.default_rng(7), turn @ SE2(0.0, -0.1, 0.05)
        robot = localizer(name, known.matcher(name), true, LASER)
        for i in range(8):
            scan = scan_of(turned(turn, CORRIDOR), true @ LASER, rng, SIGMA_M, range_max_m=8.0)
            # wheels that tell twice and a half what was driven: 4 cm off in each step
            step = SE2(0.075, 0.0, 0.0) if i else SE2.identity()
            estimate = robot.update(Measurement(0.1 * i, step, scan))
            assert estimate.match.status is MatchStatus.DEGENERATE
            true = true @ SE2(0.03, 0.0, 0.0)


@pytest.mark.parametrize("name", ["fast", "limit"])
@pytest.mark.parametrize("beam_count", [481, 60, 24])
def test_ends_of_a_slanted_corridor_on_a_grid_hold_the_way_along_it(name, beam_count):
    walls = np.concatenate([CORRIDOR, [[[4.0, -1.0], [4.0, 1.0]]]])
    turn = SE2(0.3, 0.7, 0.1)
    known = known_grid(walls, turn, (-15.0, -0.97), (3.97, 0.97))
    true = turn @ SE2(0.5, -0.1, 0.05)
    rng, angles_rad = np.random.default_rng(7), np.linspace(-2.1, 2.1, beam_count)
    scan = scan_of(turned(turn, walls), true @ LASER, rng, SIGMA_M, angles_rad, 8.0)
    robot = localizer(name, known.matcher(name), true @ SE2(0.05, 0.03, 0.02), LASER)
    estimate = robot.update(Measurement(0.0, SE2.identity(), scan))
    assert estimate.match.status is MatchStatus.MATCHED
    off = true.inverse() @ estimate.T_map_base
    # a third of a cell
    assert math.hypot(off.x, off.y) < 0.017


@pytest.mark.parametrize("name", BLIND)
def test_room_holds_every_direction(name):
    matcher = matchers(ROOM_SEGMENTS)[name]
    estimate = followed(name, matcher, ROOM_SEGMENTS, ROOM_CENTRE, SE2(0.03, -0.03, 0.02))[-1]
    assert estimate.match.status is MatchStatus.MATCHED


@pytest.mark.parametrize(
    ("segments", "true", "open_axis"),
    [(CORRIDOR, SE2(0.3, 0.2, 0.0), 0), (WALL, SE2(0.5, 0.4, 0.0), 1), (CIRCLE, SE2(0, 0, 0), 2)],
)
def test_held_takes_the_prediction_along_the_open_direction_alone(segments, true, open_axis):
    points = faced(scan_of(segments, true, range_max_m=REACH_M).points(SE2.identity()), np.zeros(2))
    point_map = PointMap(sampled(segments, 0.01), 0.01)
    slide = np.zeros(3)
    slide[open_axis] = 0.1
    predicted = SE2.from_array(true.as_array() + slide)
    pose, is_open = held(points, point_map, predicted, true)
    assert is_open
    # the open direction is found by shifts of 0.2 m of points 1 cm apart: to a tenth of the slide
    np.testing.assert_allclose(pose.as_array(), predicted.as_array(), atol=0.01)
    # and what the scan does hold is not taken from the prediction
    wrong = SE2.from_array(predicted.as_array() + np.roll([0.05, 0.0, 0.0], (open_axis + 1) % 3))
    pose, _ = held(points, point_map, wrong, true)
    held_axis = (open_axis + 1) % 3
    assert abs(pose.as_array()[held_axis] - true.as_array()[held_axis]) < 0.01


def test_held_leaves_a_pose_in_a_room_as_it_is():
    points = faced(scan_of(ROOM_SEGMENTS, ROOM_CENTRE).points(SE2.identity()), np.zeros(2))
    point_map = PointMap(sampled(ROOM_SEGMENTS, 0.01), 0.01)
    predicted = ROOM_CENTRE @ SE2(0.2, 0.2, 0.2)
    assert held(points, point_map, predicted, ROOM_CENTRE) == (ROOM_CENTRE, False)


def test_too_few_points_or_no_map_hold_nothing():
    point_map = PointMap(sampled(ROOM_SEGMENTS, 0.01), 0.01)
    predicted = SE2(1.0, 1.0, 0.0)
    assert held(np.zeros((2, 3)), point_map, predicted, ROOM_CENTRE) == (predicted, True)
    empty = PointMap(np.empty((0, 2)), 0.01)
    assert held(np.zeros((9, 3)), empty, predicted, ROOM_CENTRE) == (predicted, True)


def test_laser_model_reaches_beyond_what_these_scans_do():
    # else the walls' ends would be told by the ranges that are missing
    assert MODEL.range_max_m > REACH_M

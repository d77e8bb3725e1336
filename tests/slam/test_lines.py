"""The laboratory's earlier method: lines of the scan on known walls."""

import math

import numpy as np
import pytest

from slam.beams import Beams
from slam.line_extraction import LineExtractionConfig, extract_lines
from slam.lines import LineConfig, LineMap, match_lines
from slam.measurements import LaserScan
from slam.scan_match import MatchStatus
from slam.se2 import SE2
from tests.slam.synthetic import ANGLES_RAD, ROOM_CENTRE, ROOM_SEGMENTS, round_wall, scan_of

SIGMA_M = 0.01


def test_lines_of_a_scan_lie_on_the_walls_of_the_room():
    scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE, np.random.default_rng(0), SIGMA_M)
    lines = extract_lines(Beams.of(scan, SE2.identity()), LineExtractionConfig())
    walls = LineMap(ROOM_SEGMENTS)
    assert len(lines) >= 5
    for line in lines:
        centre = (ROOM_CENTRE @ np.array([line.centre]))[0]
        offsets = np.abs(np.sum((centre - walls.segments[:, 0]) * walls.normals, axis=1))
        turn = line.direction_rad + ROOM_CENTRE.theta
        angles = np.abs(np.sin(np.arctan2(*walls.directions.T[::-1]) - turn))
        # the fit's own sigmas, five of them, and a corner's point or two taken along
        fits = (offsets < 5.0 * line.sigma_offset_m + 0.01) & (
            angles < 5.0 * line.sigma_direction_rad + 0.01
        )
        assert fits.any()


def test_sigmas_of_a_line_are_those_seen_over_many_scans():
    wall = [[[2.0, -1.0], [2.0, 1.5]]]
    rng = np.random.default_rng(1)
    found = [
        extract_lines(Beams.of(scan_of(wall, SE2.identity(), rng, 0.02), SE2.identity()), config)
        for config in [LineExtractionConfig(range_sigma_m=0.02)]
        for _ in range(300)
    ]
    lines = [lines[0] for lines in found if len(lines) == 1]
    assert len(lines) > 280
    directions = np.array([line.direction_rad % math.pi for line in lines])
    # noise is along the beam, so up to 36 degrees here less of it is across the wall; 300 draws
    # tell a standard deviation to 4 %
    assert 0.7 < directions.std() / lines[0].sigma_direction_rad < 1.15


@pytest.mark.parametrize(
    "radius_m",
    [pytest.param(1.0, marks=pytest.mark.slow), 2.0, pytest.param(3.0, marks=pytest.mark.slow)],
)
def test_round_wall_gives_no_line(radius_m):
    rng = np.random.default_rng(2)
    count = 0
    for _ in range(50):
        pose = SE2(*rng.uniform(-0.4, 0.4, 2) * radius_m, rng.uniform(-3.0, 3.0))
        scan = scan_of(round_wall(radius_m), pose, rng, SIGMA_M)
        count += len(extract_lines(Beams.of(scan, SE2.identity()), LineExtractionConfig()))
    # one in fifty scans may keep a stump too short to show its bow
    assert count <= 1


def test_curved_panel_standing_alone_is_told_from_a_flat_one():
    # 1.4 m of a wall of 5 m radius: 5 cm of bow, which no point leaves by four sigmas
    angles = np.radians(np.linspace(-8.0, 8.0, 60))
    arc = np.column_stack([5.0 * np.cos(angles) - 3.0, 5.0 * np.sin(angles)])
    curved = np.stack([arc[:-1], arc[1:]], axis=1)
    flat = [[[2.0, -0.7], [2.0, 0.7]]]
    found = [
        len(
            extract_lines(
                Beams.of(scan_of(panel, SE2.identity(), rng, 0.02), SE2.identity()), config
            )
        )
        for rng in [np.random.default_rng(0)]
        for config in [LineExtractionConfig(range_sigma_m=0.02)]
        for panel in [curved] * 20 + [flat] * 20
    ]
    assert found == [0] * 20 + [1] * 20


def test_short_or_broken_pieces_are_no_lines():
    pieces = [[[2.0, y], [2.0, y + 0.3]] for y in np.arange(-2.0, 2.0, 0.7)]
    scan = scan_of(pieces, SE2.identity(), np.random.default_rng(0), SIGMA_M)
    assert extract_lines(Beams.of(scan, SE2.identity()), LineExtractionConfig()) == ()


def test_scan_without_hits_has_no_lines():
    scan = LaserScan(0.0, ANGLES_RAD, np.full(len(ANGLES_RAD), np.inf))
    assert extract_lines(Beams.of(scan, SE2.identity()), LineExtractionConfig()) == ()


def test_collinear_pieces_are_one_wall_and_corners_are_not():
    wall = LineMap(
        [
            [[0.0, 0.0], [1.0, 0.0]],
            [[2.0, 0.001], [1.02, 0.0]],
            [[2.0, 0.0], [2.0, 1.0]],
            [[0.0, 1.0], [0.0, 1.2]],
        ]
    )
    assert sorted(wall.lengths_m) == pytest.approx([1.0, 2.0], abs=1e-3)


def test_facets_of_a_round_wall_do_not_merge_into_walls():
    assert len(LineMap(round_wall(3.0, 180))) == 0
    assert len(LineMap(round_wall(3.0, 720))) == 0


@pytest.mark.parametrize("seed", range(8))
def test_match_by_lines_undoes_a_shift_of_the_odometry(seed):
    rng = np.random.default_rng(seed)
    laser = SE2(0.1, 0.0, 0.0)
    scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE @ laser, rng, SIGMA_M)
    start = ROOM_CENTRE @ SE2(*rng.uniform(-0.1, 0.1, 2), rng.uniform(-0.087, 0.087))
    match = match_lines(Beams.of(scan, laser), LineMap(ROOM_SEGMENTS), start, LineConfig())
    change = ROOM_CENTRE.inverse() @ match.T_map_base
    assert match.is_matched
    # 1 mm and 1 mrad rms over rooms and poses; six of these
    assert math.hypot(change.x, change.y) < 0.006
    assert abs(change.theta) < 0.006


def test_parallel_walls_alone_are_lost():
    corridor = [[[-20.0, 1.0], [20.0, 1.0]], [[-20.0, -1.0], [20.0, -1.0]]]
    scan = scan_of(corridor, SE2.identity(), np.random.default_rng(0), SIGMA_M, range_max_m=4.0)
    match = match_lines(
        Beams.of(scan, SE2.identity()), LineMap(corridor), SE2.identity(), LineConfig()
    )
    assert match.status is MatchStatus.LOST
    assert match.pair_count >= 2


def test_round_room_is_lost_without_a_line():
    scan = scan_of(round_wall(3.0), SE2(0.5, 0.3, 0.0), np.random.default_rng(3), SIGMA_M)
    walls = LineMap(round_wall(3.0))
    match = match_lines(Beams.of(scan, SE2.identity()), walls, SE2(0.5, 0.3, 0.0), LineConfig())
    assert (match.status, match.pair_count, match.error_m2) == (MatchStatus.LOST, 0, math.inf)


def test_kidnapped_robot_is_lost_or_far_from_sure():
    # a metre and a quarter turn off: the gates of the odometry exclude the right walls
    scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE, np.random.default_rng(0), SIGMA_M)
    start = ROOM_CENTRE @ SE2(0.0, -1.0, 0.8)
    match = match_lines(Beams.of(scan, SE2.identity()), LineMap(ROOM_SEGMENTS), start, LineConfig())
    assert not match.is_matched


def test_walls_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"segments must have shape \(N, 2, 2\)"):
        LineMap(np.zeros((3, 4)))


def test_many_returns_from_one_spot_are_no_line():
    # some drivers send 0.0 for "invalid": a hundred points in one place
    ranges_m = np.full(181, 2.0)
    ranges_m[40:140] = 0.0
    angles_rad = np.radians(np.arange(-90.0, 91.0))
    scan = LaserScan(0.0, angles_rad, ranges_m)
    lines = extract_lines(Beams.of(scan, SE2.identity()), LineExtractionConfig())
    assert all(line.length_m > 0.0 for line in lines)

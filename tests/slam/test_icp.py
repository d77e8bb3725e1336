"""The paper's ICP and the coarse-to-fine one, in a room of exact segments."""

import itertools
import math

import numpy as np
import pytest

from slam.icp import (
    CoarseToFineConfig,
    IcpConfig,
    MatchStatus,
    StopRule,
    error_floor_m2,
    match_scan,
    match_scan_coarse_to_fine,
)
from slam.open3d_backend import registration_icp
from slam.point_map import PointMap
from slam.se2 import SE2
from tests.slam.synthetic import ROOM_CENTRE, ROOM_SEGMENTS, sampled, scan_of

SPACING_M = 0.01
CONVERGED = IcpConfig(stop_rule=StopRule.CONVERGED)
STARTS = [
    SE2(x, y, theta) for x in (-0.1, 0.0, 0.1) for y in (-0.1, 0.1) for theta in (-0.087, 0.087)
]


@pytest.fixture(scope="module")
def room() -> PointMap:
    """The database of the room, a point per centimetre."""
    return PointMap(sampled(ROOM_SEGMENTS, SPACING_M), SPACING_M)


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    """A scan from the room's centre, 1 cm noise, base frame."""
    scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE, np.random.default_rng(0), 0.01)
    return scan.points(SE2.identity())


def error(found: SE2, true: SE2 = ROOM_CENTRE) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses."""
    change = true.inverse() @ found
    return math.hypot(change.x, change.y), abs(change.theta)


@pytest.mark.parametrize("start", STARTS)
def test_known_shift_is_undone_to_the_noise_by_both(room, points, start):
    # 480 beams of 1 cm noise fix the pose to about 1 mm and 0.4 mrad; four of these
    for match in (
        match_scan(points, room, ROOM_CENTRE @ start, CONVERGED),
        match_scan_coarse_to_fine(points, room, ROOM_CENTRE @ start, CoarseToFineConfig()),
    ):
        assert match.is_matched
        distance_m, angle_rad = error(match.T_map_base)
        assert distance_m < 0.004
        assert angle_rad < 0.0016


@pytest.mark.parametrize("start", STARTS[::5])
def test_map_registered_on_the_scan_is_the_inverse(room, points, start):
    forward = match_scan(points, room, ROOM_CENTRE @ start, CONVERGED).T_map_base
    # the other way round: the part of the map that the scan saw, found on the scan as the map
    seen = room.points[room.nearest(ROOM_CENTRE @ points, 0.05).map_ids]
    backward = match_scan(
        seen, PointMap(points, SPACING_M), (ROOM_CENTRE @ start).inverse(), CONVERGED
    )
    assert backward.is_matched
    # each with its own pairs, on a scan whose points lie 1 to 4 cm apart: millimetres
    distance_m, angle_rad = error(backward.T_map_base @ forward, SE2.identity())
    assert distance_m < 0.008
    assert angle_rad < 0.003


def test_match_without_pairs_is_lost_with_infinite_error(room, points):
    far = SE2(100.0, 100.0, 0.0)
    for match in (
        match_scan(points, room, far, IcpConfig()),
        match_scan_coarse_to_fine(points, room, far, CoarseToFineConfig()),
        match_scan(points, PointMap(np.empty((0, 2)), 0.1), far, IcpConfig()),
    ):
        assert (match.status, match.error_m2, match.pair_count) == (MatchStatus.LOST, math.inf, 0)


def test_scan_without_hits_is_lost(room):
    nothing = np.empty((0, 2))
    assert not match_scan(nothing, room, ROOM_CENTRE, IcpConfig()).is_matched
    assert not match_scan_coarse_to_fine(
        nothing, room, ROOM_CENTRE, CoarseToFineConfig()
    ).is_matched


def test_few_pairs_that_fit_perfectly_are_no_match(room, points):
    # 20 of 480 points on the map, the rest far outside: F over the 20 is tiny
    outliers = points + 50.0
    mixed = np.vstack([points[:20], outliers[20:]])
    match = match_scan(mixed, room, ROOM_CENTRE, IcpConfig())
    assert match.error_m2 < 1e-3
    assert match.status is MatchStatus.LOST


def test_first_below_leaves_millimetres_and_converged_does_not(room, points):
    start = ROOM_CENTRE @ SE2(0.08, -0.06, 0.05)
    first = match_scan(points, room, start, IcpConfig(stop_rule=StopRule.FIRST_BELOW))
    settled = match_scan(points, room, start, CONVERGED)
    assert first.is_matched
    assert settled.is_matched
    assert len(first.history) < len(settled.history)
    # F may be 1e-3 m2, 3 cm rms, at the end of the one; noise alone is left at the end of the other
    assert error(first.T_map_base)[0] > 0.005
    assert error(settled.T_map_base)[0] < 0.002


def test_history_starts_at_the_prediction_and_its_error_falls(room, points):
    start = ROOM_CENTRE @ SE2(0.1, 0.1, 0.05)
    history = match_scan(points, room, start, CONVERGED).history
    assert history[0].T_map_base == start
    errors = [step.error_m2 for step in history]
    # each step lowers F or leaves it (Besl and McKay), up to pairs that come within reach
    assert all(b <= a * 1.001 for a, b in itertools.pairwise(errors))


def test_error_at_the_true_pose_is_the_derived_floor(room):
    rng = np.random.default_rng(2)
    scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE, rng, 0.01).points(SE2.identity())
    match = match_scan(scan, room, ROOM_CENTRE, CONVERGED)
    # the floor counts all noise as across the wall; at 45 degrees half of its variance is
    floor = error_floor_m2(SPACING_M, 0.01)
    assert 0.5 * floor < match.error_m2 < floor


def test_threshold_below_the_floor_never_matches(room, points):
    config = IcpConfig(threshold_m2=0.3 * error_floor_m2(SPACING_M, 0.01))
    match = match_scan(points, room, ROOM_CENTRE, config)
    assert match.status is MatchStatus.LOST


def test_too_few_iterations_are_not_called_converged(room, points):
    start = ROOM_CENTRE @ SE2(0.03, 0.02, 0.01)
    config = IcpConfig(stop_rule=StopRule.CONVERGED, max_iterations=2, threshold_m2=1e-2)
    assert match_scan(points, room, start, config).status is MatchStatus.NOT_CONVERGED


def test_converged_match_is_where_open3d_ends(room, points):
    start = ROOM_CENTRE @ SE2(0.08, -0.06, 0.05)
    ours = match_scan(points, room, start, CONVERGED).T_map_base
    theirs = registration_icp(
        points, room, start, CONVERGED.max_pair_distance_m, 500, tolerance=1e-15
    )
    # same pairs, same fit; our loop stops when a step is below 1e-5, up to ten times that away
    assert error(ours, theirs)[0] < 1e-4
    assert error(ours, theirs)[1] < 1e-4


@pytest.mark.parametrize("seed", range(5))
def test_facing_a_single_wall_neither_method_flips(seed):
    rng = np.random.default_rng(seed)
    wall = PointMap(sampled([[[2.0, -30.0], [2.0, 30.0]]], SPACING_M), SPACING_M)
    ranges_m = 2.0 + rng.normal(0.0, 0.01, 200)
    points = np.column_stack([ranges_m, np.linspace(-1.5, 1.5, 200)])
    start = SE2(0.05, 0.0, 0.05)
    for match in (
        match_scan(points, wall, start, CONVERGED),
        match_scan_coarse_to_fine(points, wall, start, CoarseToFineConfig()),
    ):
        # along the wall nothing is known; across it and in heading all is: 1 cm, 200 points
        assert abs(match.T_map_base.x) < 0.01
        assert abs(match.T_map_base.theta) < 0.01


def test_coarse_to_fine_leaves_out_what_the_map_does_not_know(room, points):
    # a person's legs in front of every tenth beam
    occluded = points.copy()
    occluded[::10] *= 0.5
    start = ROOM_CENTRE @ SE2(0.08, -0.06, 0.05)
    match = match_scan_coarse_to_fine(occluded, room, start, CoarseToFineConfig())
    assert match.is_matched
    # the noise's 1 mm, and a little from the legs that pass near walls
    assert error(match.T_map_base)[0] < 0.005


def test_scan_of_another_place_is_lost(room):
    elsewhere = scan_of(sampled_triangle(), SE2.identity(), np.random.default_rng(0), 0.01).points(
        SE2.identity()
    )
    match = match_scan_coarse_to_fine(elsewhere, room, ROOM_CENTRE, CoarseToFineConfig())
    assert match.status is MatchStatus.LOST
    assert match.pair_count < 0.7 * len(elsewhere)


def sampled_triangle() -> np.ndarray:
    """Walls of a place that is not the room."""
    corners = np.array([[4.0, 0.0], [-2.0, 3.5], [-2.0, -3.5]])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


@pytest.mark.parametrize("offset", [SE2(0.5, -0.5, 1.4), SE2(0.5, 0.5, -1.4)])
def test_second_heading_is_tried_when_the_first_ends_badly(room, points, offset):
    # 80 degrees off, from where the straight way leads into another corner
    start = ROOM_CENTRE @ offset
    alone = CoarseToFineConfig(start_headings_rad=(0.0,))
    assert match_scan_coarse_to_fine(points, room, start, alone).status is MatchStatus.LOST
    match = match_scan_coarse_to_fine(points, room, start, CoarseToFineConfig())
    assert match.is_matched
    assert error(match.T_map_base)[0] < 0.004


def test_same_scan_gives_the_same_bits(room, points):
    start = ROOM_CENTRE @ SE2(0.1, 0.05, -0.06)
    matches = [
        match_scan_coarse_to_fine(points, room, start, CoarseToFineConfig()) for _ in range(3)
    ]
    assert matches[0] == matches[1] == matches[2]


def test_config_without_a_stage_a_start_or_pairs_is_refused():
    with pytest.raises(ValueError, match="pair_distances_m"):
        CoarseToFineConfig(pair_distances_m=())
    with pytest.raises(ValueError, match="start_headings_rad"):
        CoarseToFineConfig(start_headings_rad=())
    with pytest.raises(ValueError, match="2 pairs"):
        CoarseToFineConfig(min_pairs=0)
    with pytest.raises(ValueError, match="2 pairs"):
        IcpConfig(min_pairs=1)

"""Maps of points made into maps of short walls, and what the matchers find on them."""

import math

import numpy as np
import pytest

from slam.beam_likelihood import match_beams
from slam.beams import Beams
from slam.laser_model import LaserModel
from slam.range_noise import RangeNoise
from slam.se2 import SE2
from slam.surface.surfels import SurfelConfig, surfel_map
from tests.slam.synthetic import ROOM_CENTRE, ROOM_SEGMENTS, sampled, scan_of

MODEL = LaserModel(RangeNoise(((0.0, 0.01),)), range_max_m=10.0)


def distances_m(points: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """(K,) distance of each point from the nearest segment, the slow obvious way."""
    start, along = segments[None, :, 0], segments[None, :, 1] - segments[None, :, 0]
    share = np.sum((points[:, None] - start) * along, axis=2) / np.sum(along**2, axis=2)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1)


def test_pieces_lie_on_the_walls_and_cover_them():
    points = sampled(ROOM_SEGMENTS, 0.02)
    walls = surfel_map(points)
    middles = walls.segments.mean(axis=1)
    # but for corners, where a line is fitted to both walls: half a cell
    assert np.quantile(distances_m(middles, ROOM_SEGMENTS), 0.8) < 1e-6
    assert distances_m(middles, ROOM_SEGMENTS).max() < 0.05
    # where a diagonal piece cuts a corner of the room: a cell at most
    assert distances_m(points, walls.segments).max() < 0.1


def test_sigma_is_the_roughness_of_the_points():
    rng = np.random.default_rng(0)
    points = sampled([[[0.0, 0.0], [4.0, 0.0]]], 0.005) + rng.normal(0.0, [0.0, 0.02], (801, 2))
    walls = surfel_map(points)
    assert not walls.is_exact
    assert np.median(walls.sigma_m) == pytest.approx(0.02, rel=0.1)


def test_points_too_few_for_a_line_are_refused():
    with pytest.raises(ValueError, match="make no line"):
        surfel_map(np.array([[0.0, 0.0], [5.0, 5.0]]))
    with pytest.raises(ValueError, match="above 0"):
        SurfelConfig(cell_m=0.0)


def test_pose_is_found_on_a_map_made_of_noisy_points():
    rng = np.random.default_rng(3)
    points = sampled(ROOM_SEGMENTS, 0.01)
    walls = surfel_map(points + rng.normal(0.0, 0.01, points.shape))
    for _ in range(5):
        scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE, rng, 0.01)
        start = ROOM_CENTRE @ SE2(*rng.uniform(-0.02, 0.02, 2), rng.uniform(-0.01, 0.01))
        match = match_beams(Beams.of(scan, SE2.identity()), walls, MODEL, start)
        error = ROOM_CENTRE.inverse() @ match.T_map_base
        # lines fitted to points 1 cm rough are millimetres off
        assert math.hypot(error.x, error.y) < 0.006
        assert match.inlier_ratio > 0.95


def test_thing_on_the_map_that_has_gone_hides_no_wall():
    stray = np.array([[2.0, 2.3], [2.02, 2.31], [2.04, 2.3], [2.01, 2.32]])
    walls = surfel_map(np.concatenate([sampled(ROOM_SEGMENTS, 0.01), stray + np.array([1.2, 0.0])]))
    scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE, np.random.default_rng(4), 0.01)
    match = match_beams(Beams.of(scan, SE2.identity()), walls, MODEL, ROOM_CENTRE)
    # each beam is compared with the wall on its way that is nearest to what it measured
    assert match.inlier_ratio > 0.97

"""A map made of scans is wrong in places, and the laser's beams do not average that out."""

import numpy as np
import pytest

from slam import SE2, FastMatcher, LimitMatcher, Localizer, Measurement, SegmentMap, SurfelGrid
from slam.beams import Beams
from slam.laser_model import LaserModel
from slam.map_errors import MetSurfaces
from slam.range_noise import RangeNoise
from slam.surface.surfels import surfel_map
from tests.slam.synthetic import ANGLES_RAD, ROOM_CENTRE, ROOM_SEGMENTS, sampled, scan_of

SIGMA_M = 0.01
SHARP = LaserModel(RangeNoise(((1.0, 0.002),)), 0.02, 10.0)
LASER = SE2.identity()
NORTH, EAST = SE2(0.0, 0.0, np.pi / 2.0), SE2.identity()


def wall(count: int, along_m: float, sigma_m: float = SIGMA_M) -> MetSurfaces:
    """So many beams, evenly on a wall 2 m ahead, to both sides of x."""
    y = np.linspace(-along_m, along_m, count)
    points = np.column_stack([np.full(count, 2.0), y])
    normals = np.tile([-1.0, 0.0], (count, 1))
    sigmas = np.full(count, sigma_m)
    return MetSurfaces(points, normals, np.zeros(count), sigmas, sigmas**-2)


@pytest.mark.parametrize("count", [10, 100, 1000])
def test_beams_on_the_same_stretch_share_its_error_however_many_they_are(count):
    # all within one square of 0.3 m, with the base in its middle
    covariance = wall(count, 0.1).pose_covariance(SE2(0.0, 0.15, 0.0))
    assert covariance[0, 0] == pytest.approx((0.3 * SIGMA_M) ** 2, rel=1e-3)
    assert covariance[1, 1] == pytest.approx(0.0, abs=1e-12)


def test_error_of_stretches_far_apart_averages_out():
    # 3 m of wall are ten stretches
    covariance = wall(1000, 1.5).pose_covariance(EAST)
    assert covariance[0, 0] == pytest.approx((0.3 * SIGMA_M) ** 2 / 10.0, rel=0.02)


def test_covariance_is_seen_from_the_base_whichever_way_it_looks():
    turned = wall(400, 1.5).pose_covariance(NORTH)
    # the stretches are those of the map, and lie a little differently about the base
    np.testing.assert_allclose(turned, wall(400, 1.5).pose_covariance(EAST), atol=5e-8)


def test_patches_that_pull_different_ways_tell_of_errors_that_no_sigma_knows():
    met = wall(1000, 3.0)
    # metre by metre 2 cm in front or behind of where the map has it
    off_m = np.where(np.floor(met.points[:, 1]) % 2 == 0, 0.02, -0.02)
    uneven = MetSurfaces(met.points, met.normals, off_m, met.sigma_m, met.weights)
    level, seen = met.pose_covariance(EAST), uneven.pose_covariance(EAST)
    # six patches of standard deviation 2 cm: 8 mm of their mean
    assert level[0, 0] < 0.001**2
    assert 0.006**2 < seen[0, 0] < 0.02**2


def test_scan_that_meets_nothing_has_no_error_of_the_map():
    none = MetSurfaces(np.empty((0, 2)), np.empty((0, 2)), *(np.empty(0) for _ in range(3)))
    assert not none.pose_covariance(EAST).any()


@pytest.fixture(scope="module")
def rough_map() -> SegmentMap:
    """The room as scans show it: each half metre of its walls off by 6 mm, its points by 5 mm."""
    rng = np.random.default_rng(5)
    points = sampled(ROOM_SEGMENTS, 0.02)
    stretches, of_point = np.unique(np.floor(points / 0.5), axis=0, return_inverse=True)
    shifts = rng.normal(0.0, 0.006, (len(stretches), 2))
    return surfel_map(points + shifts[of_point.ravel()] + rng.normal(0.0, 0.005, points.shape))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fast", "limit"])
def test_robot_that_stands_on_a_rough_map_knows_how_sure_it_is(name, rough_map):
    fast = FastMatcher(SurfelGrid.of(rough_map), SHARP)
    matcher = fast if name == "fast" else LimitMatcher(rough_map, SHARP, fast)
    rng, first, tenth = np.random.default_rng(1), [], []
    for _ in range(30):
        true = SE2(*rng.uniform([1.5, 1.2], [4.5, 2.8]), rng.uniform(-np.pi, np.pi))
        localizer = Localizer(matcher, true @ SE2(*rng.normal(0.0, 0.02, 3)), LASER)
        for j in range(10):
            scan = scan_of(ROOM_SEGMENTS, true, rng, 0.002)
            estimate = localizer.update(Measurement(0.1 * j, SE2.identity(), scan))
            assert estimate.is_matched
            assert estimate.covariance is not None
            off = (estimate.T_map_base.inverse() @ true).log()
            squared = off @ np.linalg.solve(estimate.covariance, off)
            if j in (0, 9):
                (tenth if j else first).append(squared)
    # 3 where all is as assumed: the map's errors are those of one room, and much the same in all
    # its poses. Counted beam by beam it would be 14 and 12 after one scan
    assert 1.0 < np.mean(first) < 6.0
    assert 1.0 < np.mean(tenth) < 6.0


def test_fast_and_limit_see_the_same_surfaces(rough_map):
    beams = Beams.of(scan_of(ROOM_SEGMENTS, ROOM_CENTRE), LASER)
    by_points = MetSurfaces.of_points(beams, SurfelGrid.of(rough_map), SHARP.noise, ROOM_CENTRE)
    by_beams = MetSurfaces.of_beams(beams, rough_map, SHARP, ROOM_CENTRE)
    assert len(by_beams.points) > 0.95 * len(ANGLES_RAD)
    assert len(by_points.points) > 0.95 * len(ANGLES_RAD)
    for met in (by_points, by_beams):
        # of walls 1 cm off; those beside an edge are as far off as it is wide
        assert np.median(np.abs(met.residuals_m)) < 0.01
        sigmas_m = np.sqrt(np.diag(met.pose_covariance(ROOM_CENTRE))[:2])
        assert (sigmas_m > 0.0005).all()
        assert (sigmas_m < 0.01).all()

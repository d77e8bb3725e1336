"""What is usual on a map, learnt from virtual scans of it."""

import math

import numpy as np
import pytest

from slam.beams import Beams
from slam.guard.verdict_limits import VerdictLimits, virtual_scan
from slam.laser_model import LaserModel
from slam.range_noise import RangeNoise
from slam.relocalization import Relocalizer
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from slam.surface.surfel_grid import SurfelGrid
from tests.slam.synthetic import CLUTTERED_ROOM, SYMMETRIC_ROOM, scan_of, searcher

ANGLES_RAD = np.radians(np.arange(-120.0, 121.0, 2.0))
ASKED = Beams(np.zeros((121, 2)), ANGLES_RAD, np.full(121, np.nan))
CORRIDOR = np.array([[[-30.0, -1.0], [30.0, -1.0]], [[30.0, 1.0], [-30.0, 1.0]]])
POSE = SE2(2.6, 1.3, 0.7)


@pytest.fixture(scope="module")
def in_clutter() -> Relocalizer:
    return searcher(CLUTTERED_ROOM)


@pytest.fixture(scope="module")
def usual(in_clutter) -> VerdictLimits:
    return VerdictLimits.calibrated(in_clutter, ASKED)


def quiet(walls: np.ndarray, range_min_m: float = 0.02, range_max_m: float = 10.0) -> Relocalizer:
    """As `searcher`, of a laser whose noise is a picometre."""
    segment_map = SegmentMap(walls, is_one_sided=True)
    laser = LaserModel(RangeNoise(((1.0, 1e-12),)), range_min_m, range_max_m)
    return Relocalizer.of(segment_map, SurfelGrid.of(segment_map), laser)


def test_same_map_and_laser_have_the_same_limits(in_clutter, usual):
    assert VerdictLimits.calibrated(in_clutter, ASKED) == usual
    # of the beams their directions alone
    measured = Beams.of(scan_of(CLUTTERED_ROOM, POSE, angles_rad=ANGLES_RAD), SE2.identity())
    assert VerdictLimits.calibrated(in_clutter, measured) == usual


def test_limits_are_found_once_for_a_map_and_a_laser_however_the_robot_moves(in_clutter):
    rng = np.random.default_rng(0)
    turning = Beams(rng.normal(0.0, 0.01, (121, 2)), ANGLES_RAD + 0.02, ASKED.ranges_m)
    of_one = VerdictLimits.usual_for(in_clutter, turning)
    assert VerdictLimits.usual_for(in_clutter, ASKED) is of_one
    assert VerdictLimits.usual_for(searcher(CLUTTERED_ROOM), ASKED) == of_one
    half = Beams(ASKED.origins_m[::2], ANGLES_RAD[::2], ASKED.ranges_m[::2])
    assert VerdictLimits.usual_for(in_clutter, half) is not of_one


def test_far_more_beams_fit_at_right_poses_than_at_wrong_ones(usual):
    # three people hide a sixth of the beams once in a hundred scans; at a wrong pose a beam in four
    # fits by chance
    assert 0.7 < usual.usual_inlier_ratio < 0.95
    assert 0.05 < usual.wrong_inlier_ratio < 0.5
    # 5 mm and 2 mrad off, a beam in fifty passes an edge that it should have met
    assert 0.0 <= usual.usual_violation_ratio < 0.05


def test_limits_are_what_one_in_a_hundred_fresh_scans_exceeds(in_clutter, usual):
    rng = np.random.default_rng(99)
    inliers, violations, wrong, last = [], [], [], None
    for _ in range(300):
        true = SE2(*rng.uniform([0.9, 0.7], [3.0, 2.0]), rng.uniform(-math.pi, math.pi))
        scan = virtual_scan(in_clutter, ASKED, true, rng, people=3)
        found = in_clutter.at(scan, true).evidence
        inliers.append(found.inlier_ratio)
        violations.append(found.violation_ratio)
        if last is not None:
            wrong.append(in_clutter.at(last, true).evidence.inlier_ratio)
        last = scan
    # 1 % of 300, and as many again by chance and for the 150 that the limits are made of
    assert np.mean(np.array(inliers) < usual.usual_inlier_ratio) < 0.04
    assert np.mean(np.array(violations) > usual.usual_violation_ratio) < 0.04
    assert np.mean(np.array(wrong) > usual.wrong_inlier_ratio) < 0.05


def test_people_make_fewer_inliers_usual(in_clutter, usual):
    alone = VerdictLimits.calibrated(in_clutter, ASKED, people=0)
    # noise alone is beyond four sigmas once in 16 000 beams; the rest pass edges
    assert alone.usual_inlier_ratio > 0.9
    assert alone.usual_inlier_ratio > usual.usual_inlier_ratio + 0.1


@pytest.mark.parametrize(
    ("walls", "is_free"),
    [
        (CORRIDOR, None),
        (CORRIDOR[:1], None),
        (CLUTTERED_ROOM, lambda points: np.zeros(len(points), dtype=bool)),
        (CLUTTERED_ROOM, lambda points: (points[:, 0] < 1.1) & (points[:, 0] > 1.0)),
    ],
    ids=["corridor", "wall", "nothing free", "a column of cells free"],
)
def test_map_that_is_no_room_has_limits_all_the_same(walls, is_free):
    limits = VerdictLimits.calibrated(searcher(walls, is_free), ASKED)
    assert 0.0 < limits.wrong_inlier_ratio < limits.usual_inlier_ratio <= 1.0
    assert 0.0 <= limits.usual_violation_ratio < 0.5


def test_laser_too_short_for_the_room_has_limits_all_the_same():
    limits = VerdictLimits.calibrated(searcher(SYMMETRIC_ROOM, range_max_m=0.3), ASKED)
    assert all(0.0 <= limit <= 1.0 for limit in vars(limits).values())


def test_scan_without_beams_has_limits_all_the_same(in_clutter):
    none = Beams(np.empty((0, 2)), np.empty(0), np.empty(0))
    limits = VerdictLimits.calibrated(in_clutter, none)
    assert all(0.0 <= limit <= 1.0 for limit in vars(limits).values())


def test_virtual_scan_without_noise_and_people_is_the_scan(in_clutter):
    expected = scan_of(CLUTTERED_ROOM, POSE, angles_rad=ANGLES_RAD, range_max_m=10.0)
    found = virtual_scan(quiet(CLUTTERED_ROOM), ASKED, POSE, np.random.default_rng(0))
    # a picometre of noise, at most a dozen sigmas
    np.testing.assert_allclose(found.ranges_m, expected.ranges_m, atol=1e-10)
    np.testing.assert_array_equal(found.angles_rad, ANGLES_RAD)


def test_virtual_scan_ends_where_the_laser_does():
    walls = quiet(SYMMETRIC_ROOM, 0.7, 1.4)
    pose = SE2(1.0, 0.9, 0.3)
    found = virtual_scan(walls, ASKED, pose, np.random.default_rng(0)).ranges_m
    true = scan_of(SYMMETRIC_ROOM, pose, angles_rad=ANGLES_RAD).ranges_m
    np.testing.assert_array_equal(np.isinf(found), true > 1.4)
    np.testing.assert_array_equal(np.isnan(found), true < 0.7)
    assert np.isfinite(found).any()


def test_virtual_scan_is_as_noisy_as_the_laser_and_the_walls_are():
    segment_map = SegmentMap(SYMMETRIC_ROOM, np.full(4, 0.04), is_one_sided=True)
    laser = LaserModel(RangeNoise(((1.0, 0.03),)), 0.02, 10.0)
    relocalizer = Relocalizer.of(segment_map, SurfelGrid.of(segment_map), laser)
    rng, pose = np.random.default_rng(0), SE2(0.3, 0.2, 1.0)
    true = scan_of(SYMMETRIC_ROOM, pose, angles_rad=ANGLES_RAD).ranges_m
    off = [virtual_scan(relocalizer, ASKED, pose, rng).ranges_m - true for _ in range(100)]
    # 12 100 beams: 0.6 % of sigma
    assert np.std(off) == pytest.approx(0.05, rel=0.03)
    assert np.mean(off) == pytest.approx(0.0, abs=0.002)


def test_people_stand_before_walls_and_never_behind_them():
    rng, relocalizer = np.random.default_rng(0), quiet(CLUTTERED_ROOM)
    alone = virtual_scan(relocalizer, ASKED, POSE, rng).ranges_m
    shares = []
    for _ in range(50):
        among = virtual_scan(relocalizer, ASKED, POSE, rng, people=3).ranges_m
        assert (among <= alone + 1e-9).all()
        assert among.min() >= min(0.5, alone.min() - 1e-9)
        shares.append(np.mean(among < alone - 1e-6))
    # six legs, each 2 atan(6 cm / 0.5 to 3 m) wide: 9 degrees of a turn at a median of 0.8 m
    assert 0.02 < np.mean(shares) < 0.2
    assert max(shares) < 0.4

"""What a scan says for a pose: the same as beam by beam, and what it makes of each kind of beam."""

import math

import numpy as np
import pytest

from slam.beams import Beams
from slam.evidence import Evidence, EvidenceConfig, evidence_of
from slam.laser_model import LaserModel
from slam.range_noise import RangeNoise
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from tests.slam.slow_twins import evidence_by_beam
from tests.slam.synthetic import CLUTTERED_ROOM, ROOM_SEGMENTS, legs, room, scan_of

LASER = LaserModel(RangeNoise(((1.0, 0.005), (5.0, 0.03))), 0.05, 5.0)
WIDE = LaserModel(RangeNoise(((1.0, 0.01),)), 0.05, 30.0)
ANGLES_RAD = np.radians(np.arange(-120.0, 121.0, 2.0))
DEGREES_RAD = np.radians(np.arange(-90.0, 91.0))
POSE = SE2(2.6, 1.3, 0.7)
# what may be where the map has none: 1.05 of odds in all, 0.05 of them that it is so
ELSEWHERE = math.log(0.05 / 1.05)


def beams_at(pose: SE2, segments=CLUTTERED_ROOM, angles_rad=DEGREES_RAD, **kwargs) -> Beams:
    return Beams.of(scan_of(segments, pose, angles_rad=angles_rad, **kwargs), SE2.identity())


def with_ranges(beams: Beams, ranges_m: np.ndarray) -> Beams:
    return Beams(beams.origins_m, beams.angles_rad, ranges_m)


def odd_beams(rng: np.random.Generator) -> tuple[Beams, SE2]:
    """A scan with everything that can be wrong with one, and a pose that is nearly right."""
    true = SE2(*rng.uniform([1.2, 1.0], [3.5, 2.5]), rng.uniform(-3.0, 3.0))
    scan = scan_of(ROOM_SEGMENTS, true, rng, 0.02, ANGLES_RAD)
    beams = Beams.of(scan, SE2(0.1, -0.05, 0.3))
    ranges_m = beams.ranges_m.copy()
    ranges_m += np.where(rng.random(len(beams)) < 0.3, rng.uniform(-1.0, 1.5, len(beams)), 0.0)
    odd = rng.random(len(beams)) < 0.2
    ranges_m[odd] = rng.choice([np.inf, np.nan, -np.inf, 0.0, 1e9, 5.1, 0.01], odd.sum())
    off = SE2(*rng.uniform(-0.03, 0.03, 2), rng.uniform(-0.02, 0.02))
    return with_ranges(beams, ranges_m), true @ SE2(0.1, -0.05, 0.3).inverse() @ off


def assert_equal_evidence(found: Evidence, expected: Evidence) -> None:
    # the same formulas, in another order of the products
    for name in vars(expected):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), abs=1e-8), name


@pytest.mark.parametrize("seed", range(8))
def test_evidence_on_an_exact_map_is_that_of_the_first_walls_beam_by_beam(seed):
    rng = np.random.default_rng(seed)
    segment_map = SegmentMap(ROOM_SEGMENTS)
    config = EvidenceConfig(thickness_m=rng.choice([0.0, 0.2]))
    beams, pose = odd_beams(rng)
    found = evidence_of(beams, segment_map, LASER, pose, config)
    assert min(vars(found).values(), key=abs) != 0.0  # every kind of beam is in it
    assert_equal_evidence(found, evidence_by_beam(beams, segment_map, LASER, pose, config))


@pytest.mark.parametrize("seed", range(8))
def test_evidence_on_a_fitted_map_is_that_of_the_nearest_walls_beam_by_beam(seed):
    rng = np.random.default_rng(seed)
    # walls behind walls: half a metre and less, some of them not there at all
    behind = ROOM_SEGMENTS + rng.uniform(-0.5, 0.5, (len(ROOM_SEGMENTS), 1, 2))
    walls = np.concatenate([ROOM_SEGMENTS, behind])
    segment_map = SegmentMap(walls, rng.uniform(0.005, 0.05, len(walls)))
    config = EvidenceConfig.fit_for(segment_map)
    beams, pose = odd_beams(rng)
    found = evidence_of(beams, segment_map, LASER, pose)
    assert found.violation_ratio > 0.01
    assert_equal_evidence(found, evidence_by_beam(beams, segment_map, LASER, pose, config))


def test_perfect_scan_is_entirely_likely():
    found = evidence_of(beams_at(POSE), SegmentMap(CLUTTERED_ROOM, is_one_sided=True), WIDE, POSE)
    # a range of 5 m is 1e-15 of itself off: (1e-14 / 14 mm) squared
    assert found.log_likelihood == pytest.approx(0.0, abs=1e-12)
    assert found.inlier_ratio == pytest.approx(1.0)
    assert found.used == pytest.approx(len(DEGREES_RAD))
    assert (found.violation_ratio, found.short_ratio, found.missed_ratio) == (0.0, 0.0, 0.0)


def test_each_beam_that_is_off_costs_and_somebody_in_the_way_costs_the_same():
    segment_map = SegmentMap(CLUTTERED_ROOM, is_one_sided=True)
    beams = beams_at(POSE)
    laser = LaserModel(WIDE.noise, 0.05, 30.0, mixed_ratio=0.0)
    for count in (1, 2, 5, 40):
        for short_m in (0.3, 0.6):
            ranges_m = beams.ranges_m.copy()
            ranges_m[:count] -= short_m
            found = evidence_of(with_ranges(beams, ranges_m), segment_map, laser, POSE)
            assert found.log_likelihood == pytest.approx(count * ELSEWHERE)
            assert found.short_ratio == pytest.approx(count / len(beams))
            assert found.inlier_ratio == pytest.approx(1.0 - count / len(beams))


def test_pose_farther_off_is_less_likely():
    segment_map = SegmentMap(CLUTTERED_ROOM, is_one_sided=True)
    beams = beams_at(POSE)
    likelihoods = [
        evidence_of(beams, segment_map, WIDE, POSE @ SE2(off, 0.0, 0.0)).log_likelihood
        for off in (0.0, 0.005, 0.01, 0.02, 0.05, 0.2)
    ]
    assert (np.diff(likelihoods) < 0.0).all()


ACROSS = np.array([[[2.0, -9.0], [2.0, 9.0]], [[6.0, -9.0], [6.0, 9.0]]])
AHEAD_RAD = np.radians(np.arange(-10.0, 11.0))


def at_wall(depth_m: float, config: EvidenceConfig, sigma_m: float = 0.0) -> Evidence:
    """Of beams that end so far behind a wall 2 m ahead; another stands 4 m behind it."""
    beams = beams_at(SE2.identity(), ACROSS[:1] + np.array([depth_m, 0.0]), AHEAD_RAD)
    segment_map = SegmentMap(ACROSS, np.full(2, sigma_m))
    return evidence_of(beams, segment_map, WIDE, SE2.identity(), config)


def test_beams_that_pass_a_wall_violate_it_and_those_before_it_do_not():
    config = EvidenceConfig()
    for depth_m, passed, short in [(0.5, 1.0, 0.0), (-0.5, 0.0, 1.0), (0.02, 0.0, 0.0)]:
        found = at_wall(depth_m, config)
        assert (found.violation_ratio, found.short_ratio) == (passed, short)
        assert found.inlier_ratio == 1.0 - passed - short


def test_beams_within_the_thickness_of_a_wall_have_not_passed_it():
    thick = EvidenceConfig(thickness_m=0.3)
    # four sigmas of noise and blur beyond: 4 * 14 mm = 6 cm
    assert at_wall(0.28, thick).violation_ratio == 0.0
    assert at_wall(0.28, thick).short_ratio == pytest.approx(1.0)
    assert at_wall(0.45, thick).violation_ratio == pytest.approx(1.0)
    assert at_wall(0.28, EvidenceConfig()).violation_ratio == pytest.approx(1.0)


def test_beams_through_a_wall_to_another_are_likelier_than_to_nowhere_on_a_fitted_map():
    config = EvidenceConfig.fit_for(SegmentMap(ACROSS, np.full(2, 0.02)))
    to_another, to_nowhere = at_wall(4.0, config, 0.02), at_wall(2.0, config, 0.02)
    assert to_another.violation_ratio == to_nowhere.violation_ratio == 1.0
    through = (config.through_odds + config.elsewhere_odds) / (1.0 + config.elsewhere_odds)
    behind = config.behind_odds / (1.0 + config.elsewhere_odds)
    count = len(AHEAD_RAD)
    assert to_another.log_likelihood == pytest.approx(count * math.log(through))
    assert to_nowhere.log_likelihood == pytest.approx(count * math.log(behind))


def test_beam_without_return_costs_only_where_a_wall_is_in_reach():
    segment_map = SegmentMap(ACROSS[:1])
    silent = Beams(np.zeros((21, 2)), AHEAD_RAD, np.full(21, np.inf))
    near = evidence_of(silent, segment_map, WIDE, SE2.identity())
    assert near.missed_ratio == pytest.approx(1.0)
    assert near.log_likelihood == pytest.approx(21 * math.log(EvidenceConfig().silent_odds))
    far = evidence_of(silent, segment_map, WIDE, SE2(-40.0, 0.0, 0.0))
    assert vars(far) == vars(Evidence(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("sigma_m", [0.0, 0.02])
def test_ranges_that_are_none_are_no_evidence_and_never_a_nan(sigma_m):
    segment_map = SegmentMap(CLUTTERED_ROOM, np.full(len(CLUTTERED_ROOM), sigma_m))
    beams = beams_at(POSE)
    whole = evidence_of(beams, segment_map, WIDE, POSE)
    for nothing in (np.nan, -np.inf):
        ranges_m = beams.ranges_m.copy()
        ranges_m[::2] = nothing
        found = evidence_of(with_ranges(beams, ranges_m), segment_map, WIDE, POSE)
        assert found.used == pytest.approx(len(beams) // 2)
        assert found.inlier_ratio == pytest.approx(whole.inlier_ratio, abs=0.02)
    for huge in (np.inf, 31.0, 1e9, 1e308):
        ranges_m = beams.ranges_m.copy()
        ranges_m[::2] = huge
        found = evidence_of(with_ranges(beams, ranges_m), segment_map, WIDE, POSE)
        assert found.missed_ratio == pytest.approx(0.5, abs=0.01)
        assert math.isfinite(found.log_likelihood)
    at_once = evidence_of(with_ranges(beams, np.zeros(len(beams))), segment_map, WIDE, POSE)
    assert at_once.short_ratio == pytest.approx(1.0)
    assert math.isfinite(at_once.log_likelihood)


@pytest.mark.parametrize("sigma_m", [0.0, 0.02])
def test_empty_scan_says_nothing(sigma_m):
    segment_map = SegmentMap(CLUTTERED_ROOM, np.full(len(CLUTTERED_ROOM), sigma_m))
    none = Beams(np.empty((0, 2)), np.empty(0), np.empty(0))
    found = evidence_of(none, segment_map, WIDE, POSE)
    assert vars(found) == vars(Evidence(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    one = Beams(np.zeros((1, 2)), np.zeros(1), np.ones(1))
    assert evidence_of(one, segment_map, WIDE, POSE).used == 1.0


def test_map_without_a_wall_in_reach_explains_no_beam():
    found = evidence_of(beams_at(POSE), SegmentMap(ACROSS), WIDE, SE2(500.0, 0.0, 0.0))
    assert found.short_ratio == pytest.approx(1.0)
    assert found.log_likelihood == pytest.approx(len(DEGREES_RAD) * ELSEWHERE)


@pytest.mark.parametrize("sigma_m", [0.0, 0.02])
def test_room_says_the_same_by_180_and_by_720_beams(sigma_m):
    segment_map = SegmentMap(CLUTTERED_ROOM, np.full(len(CLUTTERED_ROOM), sigma_m))
    somebody = np.concatenate([CLUTTERED_ROOM, legs(POSE, [-1.0, 0.3])])
    found = []
    for count in (180, 720):
        angles_rad = np.linspace(-math.pi / 2.0, math.pi / 2.0, count)
        beams = beams_at(POSE, somebody, angles_rad)
        found.append(evidence_of(beams, segment_map, WIDE, POSE))
    few, many = found
    # the last beam counts as much as the others: 180 and 720 shares of 180 / 179 and 180 / 719
    assert many.used == pytest.approx(few.used, rel=0.01)
    # legs 4 degrees wide and a few shadows: a beam more or less on either side of each
    assert many.log_likelihood == pytest.approx(few.log_likelihood, rel=0.1)
    assert few.log_likelihood < -30.0


def test_walls_as_uncertain_as_they_are_wrong_are_no_contradiction():
    moved = SegmentMap(room(0.0, 0.0, 4.06, 3.06), np.full(4, 0.06), is_one_sided=True)
    beams = beams_at(SE2(2.0, 1.5, 0.3), room(0.0, 0.0, 4.0, 3.0))
    found = evidence_of(beams, moved, WIDE, SE2(2.0, 1.5, 0.3))
    assert found.inlier_ratio == 1.0
    exact = SegmentMap(room(0.0, 0.0, 4.06, 3.06), is_one_sided=True)
    assert evidence_of(beams, exact, WIDE, SE2(2.0, 1.5, 0.3)).inlier_ratio < 0.7


@pytest.mark.parametrize("odds", [0.0, 1.0, -0.1, 2.0])
def test_odds_that_are_none_are_refused(odds):
    for name in ("elsewhere_odds", "through_odds", "behind_odds", "silent_odds"):
        with pytest.raises(ValueError, match="between 0 and 1"):
            EvidenceConfig(**{name: odds})

"""A laser whose ranges are all too long or too short by the same: scans of one surface show by how much."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from slam.beams import Beams
from slam.frontend.keyframes import Keyframe
from slam.map_checks.range_offset import RangeOffset, range_offset, said_of_ranges
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper
from slam.measurements import LaserScan
from slam.se2 import SE2
from tests.slam import ring
from tests.slam.corridors import PILLARS, mapped
from tests.slam.synthetic import ROOM_SEGMENTS, round_wall, scan_of

POSES = [
    SE2(x, y, theta)
    for x, y, theta in np.random.default_rng(5).uniform((1.2, 0.9, -3.0), (3.6, 3.0, 3.0), (48, 3))
]


def keyframes(
    walls: np.ndarray = ROOM_SEGMENTS, offset_m: float = 0.0, longer: float = 1.0, seed: int = 1
) -> list[Keyframe]:
    """Scans with 1 cm of noise, and ranges that are wrong by a share beside the offset."""
    rng, found = np.random.default_rng(seed), []
    for k, pose in enumerate(POSES):
        scan = scan_of(walls, pose, rng, sigma_m=0.01).shortened(-offset_m)
        scan = replace(scan, ranges_m=longer * scan.ranges_m)
        beams = Beams.of(scan, SE2.identity())
        one = Keyframe(float(k), pose, SE2.identity(), np.eye(3), beams.points, beams, False)
        found.append(one)
    return found


def poses(longer: float = 1.0, seed: int = 2, sigma_m: float = 0.04) -> np.ndarray:
    """(K, 3) as well known as a map by bent walls is."""
    rng = np.random.default_rng(seed)
    off = rng.normal(0.0, (sigma_m, sigma_m, 0.01), (len(POSES), 3))
    true = np.array([pose.as_array() for pose in POSES])
    return true * (longer, longer, 1.0) + off


@pytest.mark.parametrize("offset_m", [-0.15, -0.05, 0.0, 0.05, 0.15])
def test_offset_is_found_whatever_the_poses_were_off_by(offset_m):
    found = range_offset(keyframes(offset_m=offset_m), poses())
    # 4 mm is what the last step may have been
    assert found.offset_m == pytest.approx(offset_m, abs=0.006)
    assert found.sigma_m < 0.005
    assert found.is_shown is (offset_m != 0.0)


def test_poses_may_be_off_by_more_than_the_offset():
    found = range_offset(keyframes(offset_m=0.05), poses(sigma_m=0.1))
    assert found.offset_m == pytest.approx(0.05, abs=0.01)


def test_it_scatters_as_it_says():
    found = [range_offset(keyframes(seed=seed), poses(seed=seed)) for seed in range(10, 18)]
    squared = [(one.offset_m / one.sigma_m) ** 2 for one in found]
    assert 0.05 < np.mean(squared) < 16.0


def test_one_wall_that_all_beams_meet_alike_tells_nothing():
    origins_m = np.column_stack([np.zeros(180), np.linspace(-2.0, 2.0, 180)])
    found = []
    for k in range(len(POSES)):
        beams = Beams(origins_m, 1e-9 * np.arange(180), np.full(180, 3.0))
        pose = SE2(0.0, 0.6 * k, 0.0)
        one = Keyframe(float(k), pose, SE2.identity(), np.eye(3), beams.points, beams, False)
        found.append(one)
    at = np.array([one.T_map_base.as_array() for one in found])
    assert range_offset(found, at) is None


def test_ranges_that_are_wrong_by_a_share_have_no_offset():
    found = range_offset(keyframes(longer=1.05), poses(longer=1.05))
    assert abs(found.offset_m) < 0.006


def test_walls_need_not_be_straight():
    # of a round room every scan sees an arc, which an offset would bend otherwise
    walls = round_wall(3.0) + np.array([2.4, 2.0])
    for offset_m in (0.0, 0.1):
        found = range_offset(keyframes(walls, offset_m), poses())
        assert found.offset_m == pytest.approx(offset_m, abs=0.015)


def test_what_near_scans_see_behind_and_far_ones_before_is_no_offset():
    # pillars each half metre: the faces of these, and recesses between; it was 0.031 +- 0.001 m
    true_m = np.arange(0.0, 14.0, 0.2)
    slam_map, _ = mapped(true_m, np.append(0.0, np.diff(true_m)), 0.01, lambda _: PILLARS)
    found = range_offset(slam_map.keyframes, slam_map.poses)
    assert found is None or abs(found.offset_m) < 0.015


def test_it_is_that_of_the_last_session():
    before = keyframes(offset_m=0.1)
    since = [replace(one, session=1) for one in keyframes(seed=3)]
    both = np.concatenate([poses(), poses(seed=4)])
    assert abs(range_offset([*before, *since], both).offset_m) < 0.006
    later = [replace(one, session=1) for one in before]
    assert range_offset([*keyframes(), *later], both).offset_m == pytest.approx(0.1, abs=0.006)


def few(count: int) -> Sequence[Keyframe]:
    return [
        one if k < count else one.place_alone() for k, one in enumerate(keyframes(offset_m=0.1))
    ]


def test_few_scans_say_nothing():
    assert range_offset([], np.empty((0, 3))) is None
    # of real logs without an offset, stretches of 8 to 16 keyframes showed up to 0.12 m
    assert range_offset(few(36), poses()) is None
    assert range_offset(few(44), poses()) is not None
    # and none that see nothing of what the others saw
    far = poses() + np.column_stack([3.0 * np.arange(len(POSES)), *np.zeros((2, len(POSES)))])
    assert range_offset(keyframes(), far) is None


@pytest.mark.parametrize(
    ("offset_m", "sigma_m", "is_shown"),
    [(0.041, 0.002, True), (-0.041, 0.002, True), (0.039, 0.002, False), (0.05, 0.011, False)],
)
def test_offset_is_worth_a_word_where_it_bends_the_map_and_is_beyond_doubt(
    offset_m, sigma_m, is_shown
):
    assert RangeOffset(offset_m, sigma_m).is_shown is is_shown


def test_it_is_told_in_metres_and_which_way():
    assert said_of_ranges(keyframes(), poses()) == []
    for offset_m, words in ((0.1, "0.1 m too long"), (-0.1, "0.1 m too short")):
        (said,) = said_of_ranges(keyframes(offset_m=offset_m), poses())
        told_m = float(said.split()[3])
        assert said.replace(f"{told_m:.3f}", "0.1").startswith(f"all ranges are {words}")
        assert told_m == pytest.approx(0.1, abs=0.006)


@pytest.mark.parametrize(("known_m", "is_good"), [(0.0, False), (0.1, True)])
def test_map_by_ranges_that_are_too_long_fails_unless_they_are_known_to_be(known_m, is_good):
    drive = ring.drive(ring.way(0.5), np.random.default_rng(3))
    mapper = Mapper(ring.T_BASE_LASER, MapperConfig(range_offset_m=known_m))
    for measurement in drive:
        mapper.update(measurement.shortened(-0.1))
    reasons = mapper.finish().verdict.reasons
    assert ("all ranges are" in " ".join(reasons)) is not is_good
    if is_good:
        assert reasons == ()


def test_shortened_scan_keeps_what_did_not_return_and_has_no_range_below_none():
    scan = LaserScan(0.0, [0.0, 1.0, 2.0, 3.0], [1.0, 0.1, np.inf, np.nan])
    shorter = scan.shortened(0.2).ranges_m
    np.testing.assert_allclose(shorter, [0.8, -np.inf, np.inf, np.nan])
    assert scan.shortened(0.0) is scan

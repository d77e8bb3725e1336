"""Whatever a laser sends: nothing raises, the pose stays finite, no wrong one is sure of itself."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from slam.laser_model import LaserModel
from slam.localization import Estimate
from slam.matchers import Matcher
from slam.measurements import LaserScan, Measurement
from slam.range_noise import RangeNoise
from slam.se2 import SE2
from tests.slam.all_methods import METHODS, SIGMA_M, localizer, matchers
from tests.slam.synthetic import ANGLES_RAD, ROOM_CENTRE, ROOM_SEGMENTS, scan_of

LASER = SE2(0.12, 0.0, 0.0)
STEP = SE2(0.02, 0.0, 0.01)
NOISE = np.diag([0.002, 0.001, 0.002]) ** 2
ROOM = matchers(ROOM_SEGMENTS)
OPEN3D_IS_SLOW = [
    pytest.param(name, marks=pytest.mark.slow) if name == "open3d" else name for name in METHODS
]
FEW = settings(
    max_examples=12, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)

RANGES_M = st.one_of(
    st.sampled_from([math.nan, math.inf, -math.inf, 0.0, 5e-324, 1e-9, 1e6, 1e12]),
    st.floats(0.0, 12.0),
)

# what drivers write where a beam has no time
NO_TIME_S = st.sampled_from([math.nan, math.inf, -math.inf, 0.0, 1e9, -1e300])


def fan(count: int) -> np.ndarray:
    return np.linspace(-2.1, 2.1, count)


def assert_sane(estimate: Estimate, true: SE2, name: str) -> None:
    """A finite pose, and no claim of it that is wrong."""
    error = (estimate.T_map_base.inverse() @ true).log()
    assert np.isfinite(error).all()
    covariance = estimate.covariance
    if covariance is not None:
        assert not np.isnan(covariance).any()
        assert (np.linalg.eigvalsh(covariance) > 0.0).all()
    if estimate.is_matched:
        assert math.hypot(error[0], error[1]) <= 0.05, name
        assert abs(error[2]) <= math.radians(2.0), name
        if covariance is not None:
            assert error @ np.linalg.solve(covariance, error) < 50.0, name


def after(name: str, scans: list[LaserScan], told: SE2 = STEP) -> list[tuple[Estimate, SE2]]:
    """Estimates and true poses of a robot that first saw its room, then these scans, a STEP between
    each two; told: what the wheels make of such a step."""
    matcher: Matcher = ROOM[name]
    robot, true = localizer(name, matcher, ROOM_CENTRE, LASER), ROOM_CENTRE
    good = scan_of(ROOM_SEGMENTS, true @ LASER, np.random.default_rng(0), SIGMA_M)
    assert robot.update(Measurement(0.0, SE2.identity(), good, NOISE)).is_matched
    pairs = []
    for i, scan in enumerate(scans):
        true = true @ STEP
        pairs.append((robot.update(Measurement(0.1 * (i + 1), told, scan, NOISE)), true))
    return pairs


@pytest.mark.parametrize("name", OPEN3D_IS_SLOW)
@FEW
@given(ranges_m=st.lists(RANGES_M, max_size=160))
def test_any_mixture_of_ranges_leaves_a_sane_pose(name, ranges_m):
    scan = LaserScan(0.0, fan(len(ranges_m)), np.array(ranges_m))
    for estimate, true in after(name, [scan, scan]):
        assert_sane(estimate, true, name)


@pytest.mark.parametrize("name", OPEN3D_IS_SLOW)
@FEW
@given(
    ranges_m=st.lists(RANGES_M, min_size=2, max_size=160),
    spread_s=st.floats(0.0, 0.1),
    wrong=st.lists(st.tuples(st.integers(0, 159), NO_TIME_S), max_size=160),
)
def test_so_do_scans_with_beam_times(name, ranges_m, spread_s, wrong):
    times_s = np.linspace(0.1 - spread_s, 0.1, len(ranges_m))
    for index, time_s in wrong:
        times_s[index % len(times_s)] = time_s
    scan = LaserScan(0.1, fan(len(ranges_m)), np.array(ranges_m), times_s)
    for estimate, true in after(name, [scan]):
        assert_sane(estimate, true, name)


@pytest.mark.parametrize("name", OPEN3D_IS_SLOW)
@FEW
@given(
    wrong=st.lists(st.tuples(st.integers(0, len(ANGLES_RAD) - 1), RANGES_M), max_size=150),
    seed=st.integers(0, 1000),
)
def test_good_scan_with_bad_beams_gives_no_sure_wrong_pose(name, wrong, seed):
    true = ROOM_CENTRE @ STEP
    good = scan_of(ROOM_SEGMENTS, true @ LASER, np.random.default_rng(seed), SIGMA_M)
    ranges_m = good.ranges_m.copy()
    for index, range_m in wrong:
        ranges_m[index] = range_m
    for estimate, at in after(name, [LaserScan(0.0, ANGLES_RAD, ranges_m)]):
        assert_sane(estimate, at, name)


@pytest.mark.parametrize("name", OPEN3D_IS_SLOW)
@FEW
@given(
    wrong=st.lists(st.tuples(st.integers(0, len(ANGLES_RAD) - 1), NO_TIME_S), max_size=150),
    seed=st.integers(0, 1000),
)
def test_good_scan_with_bad_beam_times_is_still_matched(name, wrong, seed):
    true = ROOM_CENTRE @ STEP
    good = scan_of(ROOM_SEGMENTS, true @ LASER, np.random.default_rng(seed), SIGMA_M)
    times_s = np.full(len(ANGLES_RAD), 0.1)
    for index, time_s in wrong:
        times_s[index] = time_s
    for estimate, at in after(name, [LaserScan(0.1, ANGLES_RAD, good.ranges_m, times_s)]):
        assert estimate.is_matched
        assert_sane(estimate, at, name)


@pytest.mark.parametrize("reach_m", [0.3, pytest.param(3.0, marks=pytest.mark.slow), 10.0, 100.0])
@pytest.mark.parametrize("name", OPEN3D_IS_SLOW)
def test_random_ranges_match_nothing(name, reach_m):
    rng = np.random.default_rng(0)
    scans = [
        LaserScan(0.0, ANGLES_RAD, rng.uniform(0.0, reach_m, len(ANGLES_RAD))) for _ in range(4)
    ]
    for estimate, true in after(name, scans):
        assert not estimate.is_matched
        assert_sane(estimate, true, name)


@pytest.mark.parametrize("value_m", [math.nan, math.inf, -math.inf, 0.0, 1e-9, 2.0, 1e6, 1e300])
@pytest.mark.parametrize("name", METHODS)
def test_same_range_everywhere_matches_nothing(name, value_m):
    scan = LaserScan(0.0, ANGLES_RAD, np.full(len(ANGLES_RAD), value_m))
    ((estimate, true),) = after(name, [scan])
    assert not estimate.is_matched
    assert_sane(estimate, true, name)
    # the prediction stands; what a matcher finds and disowns is not taken over
    error = (estimate.T_map_base.inverse() @ true).log()
    assert np.hypot(*error[:2]) < 0.05


@pytest.mark.parametrize("name", METHODS)
def test_scan_without_beams_matches_nothing(name):
    scan = LaserScan(0.0, np.empty(0), np.empty(0), np.empty(0))
    for estimate, true in after(name, [scan, scan, scan]):
        assert not estimate.is_matched
        assert_sane(estimate, true, name)


def on_the_wall(name: str, end_m: float) -> list[tuple[Estimate, SE2]]:
    """Where all beams but those on one wall, up to x = end_m, are lost, and the wheels tell 50 mm
    for each 20: in the end they are 22 cm off along that wall, which nothing corrects."""
    true, scans = ROOM_CENTRE, []
    rng = np.random.default_rng(2)
    for _ in range(8):
        true = true @ STEP
        scan = scan_of(ROOM_SEGMENTS, true @ LASER, rng, SIGMA_M)
        points = true @ scan.points(LASER)
        on_wall = (np.abs(points[:, 1]) < 0.1) & (points[:, 0] < end_m)
        scans.append(LaserScan(0.0, ANGLES_RAD, np.where(on_wall, scan.ranges_m, np.nan)))
        assert on_wall.sum() > 20
    return after(name, scans, told=STEP @ SE2(0.03, 0.0, 0.0))


# free of all else, and up to 10 cm before a box
@pytest.mark.parametrize("end_m", [3.6, 3.9])
@pytest.mark.parametrize("name", METHODS)
def test_one_wall_out_of_a_room_is_not_sure_of_a_wrong_pose(name, end_m):
    pairs = on_the_wall(name, end_m)
    for estimate, at in pairs:
        assert not estimate.is_matched
        assert_sane(estimate, at, name)
    estimate, at = pairs[-1]
    assert abs(estimate.T_map_base.x - at.x) > 0.15


@pytest.mark.parametrize(("half_m", "off_m"), [(3.0, 0.5), (8.0, 2.0), (20.0, 2.0)])
@pytest.mark.parametrize("name", METHODS)
def test_one_wall_whose_ends_are_in_reach_is_not_sure_of_a_wrong_pose(name, half_m, off_m):
    # so far along it points stand alone, and were taken to face the laser: to hold the way there
    wall = np.array([[[-half_m, 0.0], [half_m, 0.0]]])
    model = LaserModel(RangeNoise(((1.0, SIGMA_M),)), 0.02, 30.0)
    true, rng = SE2(0.0, off_m, -1.5), np.random.default_rng(5)
    robot = localizer(name, matchers(wall, model)[name], true, LASER)
    for k in range(9):
        scan = scan_of(wall, true @ LASER, rng, SIGMA_M, range_max_m=30.0)
        told = SE2(0.03, 0.03, 0.0) if k else SE2.identity()
        assert_sane(robot.update(Measurement(0.1 * k, told, scan, NOISE)), true, name)
        true = true @ SE2(0.02, 0.0, 0.0)


@pytest.mark.parametrize("name", METHODS)
def test_wall_up_to_the_foot_of_a_box_is_not_sure_of_a_wrong_pose(name):
    # points of the wall that slid to the box are next to its side, and seemed to be held by it
    for estimate, at in on_the_wall(name, 4.1):
        assert_sane(estimate, at, name)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("how", ["alone", "between blanks", "two in turn", "flickering"])
def test_frozen_scan_is_no_sure_wrong_pose_while_the_wheels_turn(name, how):
    frozen = scan_of(ROOM_SEGMENTS, ROOM_CENTRE @ LASER, np.random.default_rng(0), SIGMA_M)
    blank = LaserScan(0.0, frozen.angles_rad, np.full(len(frozen.angles_rad), np.inf))
    second = ROOM_CENTRE @ STEP @ STEP
    other = scan_of(ROOM_SEGMENTS, second @ LASER, np.random.default_rng(1), SIGMA_M)
    flickering = [
        np.where(np.arange(len(ANGLES_RAD)) == k, np.nan, frozen.ranges_m) for k in range(12)
    ]
    scans = {
        "alone": [frozen] * 12,
        "between blanks": [frozen, blank] * 6,
        "two in turn": [frozen, other] * 6,
        "flickering": [LaserScan(0.0, ANGLES_RAD, ranges_m) for ranges_m in flickering],
    }[how]
    for k, (estimate, true) in enumerate(after(name, scans)):
        assert_sane(estimate, true, name)
        is_new = how == "two in turn" and k == 1
        assert estimate.is_matched == is_new


@pytest.mark.parametrize("name", METHODS)
def test_scan_of_another_size_after_the_last_is_no_repetition(name):
    true = ROOM_CENTRE @ STEP
    half = scan_of(
        ROOM_SEGMENTS, true @ LASER, np.random.default_rng(1), SIGMA_M, ANGLES_RAD[::2].copy()
    )
    ((estimate, at),) = after(name, [half])
    assert estimate.is_matched
    assert_sane(estimate, at, name)

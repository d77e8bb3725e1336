"""The methods that know their covariance, and how a `Localizer` fuses, deskews and judges them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from slam.beams import Beams
from slam.localization import Estimate, Localizer, LocalizerConfig
from slam.match_verdict import VerdictConfig
from slam.matchers import Matcher
from slam.measurements import LaserScan, Measurement
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2
from tests.slam.all_methods import METHODS, SIGMA_M, localizer, matchers
from tests.slam.slow_twins import cast_all
from tests.slam.synthetic import ANGLES_RAD, ROOM_CENTRE, ROOM_SEGMENTS, box, scan_of

LASER = SE2(0.19, 0.0, 0.0)
STEP = SE2(0.03, 0.0, 0.02)
STEP_COVARIANCE = np.diag([0.002, 0.001, 0.002]) ** 2
WALLS = np.concatenate([ROOM_SEGMENTS, ROOM_SEGMENTS[:, ::-1]])


@pytest.fixture(scope="module")
def room() -> dict:
    return matchers(ROOM_SEGMENTS)


def off(a: SE2, b: SE2) -> tuple[float, float]:
    change = a.inverse() @ b
    return math.hypot(change.x, change.y), abs(change.theta)


def at_once(scan: LaserScan, time_s: float) -> LaserScan:
    """The scan with all of its beams fired at one instant."""
    return replace(scan, time_s=time_s, beam_times_s=np.full(len(scan.angles_rad), time_s))


def drive(robot: Localizer, true: SE2, count: int, seed: int = 0, start_s: float = 0.0):
    """The estimates and true poses along an arc, wheels as noisy as they say."""
    rng = np.random.default_rng(seed)
    estimates, poses = [], []
    for i in range(count):
        true = true @ STEP @ SE2.exp(rng.multivariate_normal(np.zeros(3), STEP_COVARIANCE))
        scan = scan_of(ROOM_SEGMENTS, true @ LASER, rng, SIGMA_M)
        measurement = Measurement(
            start_s + 0.1 * i, STEP, at_once(scan, start_s + 0.1 * i), STEP_COVARIANCE
        )
        estimates.append(robot.update(measurement))
        poses.append(true)
    return estimates, poses


@pytest.mark.parametrize(("name", "limit_m"), [("fast", 0.006), ("limit", 0.003)])
def test_robot_is_followed_to_millimetres(name, limit_m, room):
    estimates, poses = drive(localizer(name, room[name], ROOM_CENTRE, LASER), ROOM_CENTRE, 30)
    assert all(estimate.is_matched for estimate in estimates)
    # one scan tells about 1 mm and 0.5 mrad
    assert (
        max(off(pose, e.T_map_base)[0] for pose, e in zip(poses, estimates, strict=True)) < limit_m
    )
    assert all(estimate.warnings == () for estimate in estimates)


def test_fused_limit_is_consistent_and_better_than_each_scan_alone(room):
    values, fused_m2, alone_m2 = [], [], []
    for seed in range(12):
        robot = localizer("limit", room["limit"], ROOM_CENTRE, LASER)
        estimates, poses = drive(robot, ROOM_CENTRE, 15, seed)
        error = (estimates[-1].T_map_base.inverse() @ poses[-1]).log()
        values.append(error @ np.linalg.solve(estimates[-1].covariance, error))
        for estimate, pose in list(zip(estimates, poses, strict=True))[5:]:
            fused_m2.append(off(pose, estimate.T_map_base)[0] ** 2)
            alone_m2.append(off(pose, estimate.match.T_map_base)[0] ** 2)
    # 12 draws of chi-square(3): a mean of 3 to 0.7, three of these
    assert 0.9 < np.mean(values) < 5.2
    assert np.mean(fused_m2) < np.mean(alone_m2)


def test_claims_of_covariance_are_those_of_the_method(room):
    for name in METHODS:
        robot = localizer(name, room[name], ROOM_CENTRE, LASER)
        estimates, _ = drive(robot, ROOM_CENTRE, 2)
        assert all(estimate.is_matched for estimate in estimates), name
        claimed = estimates[-1].covariance
        if name in ("line", "paper", "open3d"):
            assert claimed is None, name
        else:
            assert (np.linalg.eigvalsh(claimed) > 0.0).all(), name
            # one scan tells about 1 mm; 10 mm is no claim worth the name
            assert np.sqrt(np.diag(claimed)).max() < 0.01, name


def test_repeated_scans_are_not_looked_at_and_do_not_make_sure(room):
    robot = localizer("limit", room["limit"], ROOM_CENTRE, LASER)
    scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE @ LASER, np.random.default_rng(0), SIGMA_M)
    first = robot.update(Measurement(0.0, SE2.identity(), scan, STEP_COVARIANCE))
    assert first.is_matched
    volume = np.linalg.det(first.covariance)
    for i in range(1, 10):
        again = robot.update(Measurement(0.1 * i, SE2.identity(), scan, STEP_COVARIANCE))
        assert again.match.status is MatchStatus.NOT_ATTEMPTED
        assert np.linalg.det(again.covariance) > volume
        volume = np.linalg.det(again.covariance)
    # and a fresh scan is looked at again
    fresh = scan_of(ROOM_SEGMENTS, ROOM_CENTRE @ LASER, np.random.default_rng(1), SIGMA_M)
    assert robot.update(Measurement(1.0, SE2.identity(), fresh, STEP_COVARIANCE)).is_matched


@pytest.mark.parametrize("name", METHODS)
def test_frozen_laser_on_a_moving_robot_leaves_the_wheels_word(name, room):
    robot = localizer(name, room[name], ROOM_CENTRE, LASER)
    scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE @ LASER, np.random.default_rng(0), SIGMA_M)
    robot.update(Measurement(0.0, SE2.identity(), scan, STEP_COVARIANCE))
    expected = robot.T_map_base
    for i in range(1, 8):
        estimate = robot.update(Measurement(0.1 * i, STEP, scan, STEP_COVARIANCE))
        expected = expected @ STEP
        assert not estimate.is_matched
    # the wheels' learnt errors are a priori none, and nothing was learnt from one scan
    assert off(expected, estimate.T_map_base)[0] < 1e-3


@pytest.mark.parametrize("time_s", [0.4, 0.5, -1e6])
def test_stamps_that_repeat_or_jump_back_are_no_end(time_s, room):
    robot = localizer("limit", room["limit"], ROOM_CENTRE, LASER)
    _, poses = drive(robot, ROOM_CENTRE, 5)
    true = poses[-1]
    scan = scan_of(ROOM_SEGMENTS, true @ LASER, np.random.default_rng(9), SIGMA_M)
    estimate = robot.update(Measurement(time_s, SE2.identity(), scan, STEP_COVARIANCE))
    assert estimate.is_matched
    error_m, _ = off(true, estimate.T_map_base)
    assert error_m < 0.01


BACK, ASIDE, AHEAD = SE2(-1.0, 0.0, 0.0), SE2(0.0, -1.0, 0.0), SE2(1.0, 0.0, 0.5)


@pytest.mark.parametrize(
    ("name", "kidnap"),
    [
        *[(name, kidnap) for name in METHODS for kidnap in (BACK, ASIDE, AHEAD)],
    ],
)
def test_robot_carried_a_metre_is_lost_or_found_and_never_fused_quietly(name, kidnap, room):
    robot = localizer(name, room[name], ROOM_CENTRE, LASER)
    _, poses = drive(robot, ROOM_CENTRE, 5)
    true = poses[-1] @ kidnap
    scan = scan_of(ROOM_SEGMENTS, true @ LASER, np.random.default_rng(9), SIGMA_M)
    estimate = robot.update(Measurement(9.0, SE2.identity(), scan, STEP_COVARIANCE))
    error_m, error_rad = off(true, estimate.T_map_base)
    if estimate.is_matched:
        # the paper's own stops at the first pose whose F is below the threshold
        assert error_m < (0.1 if name == "paper" else 0.05)
        assert error_rad < math.radians(2.0)
        # a jump of a metre against millimetres: no average of the two
        assert estimate.nis is None or estimate.nis > 30.0
    else:
        # the prediction stands, in full
        assert off(estimate.T_predicted, estimate.T_map_base)[0] < 0.02


def test_match_that_contradicts_the_prediction_is_believed_alone():
    there = SE2(3.0, 1.0, 0.2)
    information = np.diag([1e6, 1e6, 1e6])

    def sure(beams: Beams, T_predicted: SE2) -> ScanMatch:
        return ScanMatch(there, MatchStatus.MATCHED, information=information)

    robot = Localizer(sure, ROOM_CENTRE, LASER)
    scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE)
    estimate = robot.update(Measurement(0.0, SE2.identity(), scan))
    assert estimate.nis > 30.0
    assert estimate.T_map_base == there
    np.testing.assert_allclose(estimate.covariance, np.eye(3) * 1e-6)


def test_degenerate_match_that_contradicts_the_prediction_moves_nothing():
    def sliding(beams: Beams, T_predicted: SE2) -> ScanMatch:
        information = np.diag([1e6, 0.0, 1e6])
        return ScanMatch(SE2(3.0, 1.0, 0.2), MatchStatus.DEGENERATE, information=information)

    robot = Localizer(sliding, SE2.identity(), LASER)
    scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE)
    estimate = robot.update(Measurement(0.0, SE2.identity(), scan))
    assert estimate.nis > 30.0
    assert estimate.T_map_base == SE2.identity()


def test_without_fusion_the_match_replaces_the_prediction(room):
    unfused = LocalizerConfig(fuse=False)
    robot = localizer("limit", room["limit"], ROOM_CENTRE, LASER, unfused)
    estimates, _ = drive(robot, ROOM_CENTRE, 6)
    for estimate in estimates:
        assert estimate.is_matched
        assert estimate.nis is None
        assert estimate.T_map_base == estimate.match.T_map_base
        covariance = np.linalg.inv(estimate.match.information)
        np.testing.assert_allclose(estimate.covariance, covariance, rtol=1e-6, atol=1e-15)
    fused, _ = drive(localizer("limit", room["limit"], ROOM_CENTRE, LASER), ROOM_CENTRE, 6)
    assert fused[-1].T_map_base != fused[-1].match.T_map_base
    assert np.linalg.det(fused[-1].covariance) < np.linalg.det(estimates[-1].covariance)


def test_without_deskewing_a_turning_robot_sees_a_turned_room(room):
    twist = np.array([0.0, 0.0, 0.1])  # 1 rad/s
    times_s = 0.1 * np.arange(len(ANGLES_RAD)) / len(ANGLES_RAD)
    error_rad = {}
    for deskew in (True, False):
        rng = np.random.default_rng(0)
        config = LocalizerConfig(deskew=deskew, fuse=False)
        robot = localizer("limit", room["limit"], ROOM_CENTRE, LASER, config)
        robot.update(
            Measurement(
                0.0, SE2.identity(), scan_of(ROOM_SEGMENTS, ROOM_CENTRE @ LASER, rng, SIGMA_M)
            )
        )
        lasers = [ROOM_CENTRE @ SE2.exp(twist * (t / 0.1)) @ LASER for t in times_s]
        fired = Beams(
            np.array([[laser.x, laser.y] for laser in lasers]),
            np.array([laser.theta for laser in lasers]) + ANGLES_RAD,
            np.full(len(lasers), np.nan),
        )
        ranges_m = cast_all(WALLS, fired, SE2.identity())[0] + rng.normal(0.0, SIGMA_M, len(lasers))
        scan = LaserScan(0.1, ANGLES_RAD, ranges_m, times_s)
        estimate = robot.update(Measurement(0.1, SE2.exp(twist), scan, STEP_COVARIANCE))
        error_rad[deskew] = off(ROOM_CENTRE @ SE2.exp(twist), estimate.T_map_base)[1]
    # 1 rad/s in 0.1 s: the middle beams were fired 50 mrad before the stamp
    assert error_rad[True] < 0.003
    assert error_rad[False] > 0.03


def test_scan_of_too_few_beams_is_lost(room):
    scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE @ LASER, np.random.default_rng(0), SIGMA_M)
    ranges_m = np.full(len(ANGLES_RAD), np.nan)
    ranges_m[::40] = scan.ranges_m[::40]  # 13 beams; 20 is the least
    few = replace(scan, ranges_m=ranges_m)
    for name in ("fast", "limit"):
        match = room[name](Beams.of(few, LASER), ROOM_CENTRE)
        assert match.status is MatchStatus.LOST


@pytest.fixture(scope="module")
def room_with_a_chair() -> dict:
    """As the map has it; beside ROOM_CENTRE, where 21 % of the beams go through it."""
    return matchers(np.concatenate([ROOM_SEGMENTS, box(3.3, 1.8, 3.8, 2.3)]))


@pytest.mark.parametrize("seed", range(3))
def test_chair_taken_away_from_beside_the_robot_is_no_other_building(room_with_a_chair, seed):
    scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE @ LASER, np.random.default_rng(seed), SIGMA_M)
    start = ROOM_CENTRE @ SE2(0.05, -0.04, 0.05)
    match = room_with_a_chair["limit"](Beams.of(scan, LASER), start)
    assert match.is_matched
    assert off(match.T_map_base, ROOM_CENTRE)[0] < 0.005


def test_robot_that_drives_past_a_moved_chair_is_told(room_with_a_chair, room):
    # fused over many scans its covariance is too small then
    for of_room, is_told in ((room_with_a_chair, True), (room, False)):
        robot = localizer("limit", of_room["limit"], ROOM_CENTRE, LASER)
        estimates, _ = drive(robot, ROOM_CENTRE, 40)
        said = [any("go through walls" in one for one in e.warnings) for e in estimates]
        assert said[-1] is is_told
        assert not any(said[:25])


def test_more_walls_may_be_missing_where_all_else_fits():
    verdict = VerdictConfig()
    assert not verdict.are_walls_missing(0.5, 0.1)
    assert verdict.are_walls_missing(0.7, 0.2)
    assert not verdict.are_walls_missing(0.79, 0.2)
    assert verdict.are_walls_missing(0.68, 0.32)


def test_verdict_is_open_where_a_direction_is_wider_than_allowed():
    verdict = VerdictConfig()
    tight = np.diag([1e6, 1e6, 1e6])
    assert not verdict.is_open(tight)
    for index, sigma in ((0, 0.051), (1, 0.051), (2, 0.036)):
        wide = tight.copy()
        wide[index, index] = sigma**-2.0
        assert verdict.is_open(wide)
    assert verdict.is_open(np.diag([1e6, 0.0, 1e6]))
    # wide along a diagonal, though each axis alone would pass
    slanted = np.diag([0.0, 0.0, 1e6])
    slanted[:2, :2] = np.linalg.inv([[0.045**2, 0.044**2], [0.044**2, 0.045**2]])
    assert verdict.is_open(slanted)


def test_offset_of_the_laser_is_warned_of_while_the_robot_drives(room):
    rng, true = np.random.default_rng(0), ROOM_CENTRE
    robot = localizer("limit", room["limit"], true, LASER)
    for i in range(40):
        true = true @ SE2(0.02, 0.0, 0.05)
        scan = scan_of(ROOM_SEGMENTS, true @ LASER, rng, SIGMA_M)
        long = replace(scan, ranges_m=scan.ranges_m + 0.005)
        estimate = robot.update(Measurement(0.1 * i, SE2(0.02, 0.0, 0.05), long, STEP_COVARIANCE))
    said = [float(w.split()[2]) for w in estimate.warnings if "off the map on average" in w]
    # 0.6 mm from one scan, 0.1 mm from 40; what grazes an edge takes some of it
    assert said == pytest.approx([5.0], abs=0.6)


def test_noise_of_the_laser_is_warned_of_with_the_sigma_that_it_has(room):
    rng = np.random.default_rng(0)
    robot = localizer("limit", room["limit"], ROOM_CENTRE, LASER)
    for i in range(20):
        scan = scan_of(ROOM_SEGMENTS, ROOM_CENTRE @ LASER, rng, 2.0 * SIGMA_M)
        estimate = robot.update(
            Measurement(0.1 * i, SE2.identity(), at_once(scan, 0.1 * i), STEP_COVARIANCE)
        )
    (said,) = [w for w in estimate.warnings if w.startswith("ranges scatter")]
    sigma_m = float(said.rpartition("--range-sigma ")[2].rstrip(")"))
    # 480 beams tell a sigma to 3 %, 20 scans to less than the two digits that are told
    assert sigma_m == pytest.approx(2.0 * SIGMA_M, rel=0.1)


# thin boards that stand about: each shows two edges
BOARDS = np.array(
    [
        [[x, y], [x + 0.1 * math.cos(turn), y + 0.1 * math.sin(turn)]]
        for x, y, turn in (
            *((0.7, 0.6, 0.3), (0.6, 1.7, 1.4), (1.2, 2.7, 2.2), (2.2, 3.5, 0.1), (3.2, 3.6, 0.8)),
            *((4.4, 3.2, 1.9), (4.8, 2.2, 1.5), (4.6, 1.3, 2.6), (3.4, 0.4, 0.2), (2.0, 0.3, 2.9)),
        )
    ]
)
FULL_ROOM = np.concatenate([ROOM_SEGMENTS, BOARDS])


@pytest.fixture(scope="module")
def full_room() -> dict:
    return matchers(FULL_ROOM)


STILL_NOISE = np.diag([1e-5, 1e-5, 1e-5]) ** 2


def stood(matcher: Matcher, pose: SE2, seed: int, count: int) -> tuple[list[float], list[float]]:
    """NEES and error [m] after each of `count` scans from one pose, the start some cm off."""
    rng = np.random.default_rng(seed)
    robot = Localizer(matcher, pose @ SE2(0.03, -0.02, 0.02), LASER)
    nees, errors_m = [], []
    for i in range(count):
        scan = at_once(scan_of(FULL_ROOM, pose @ LASER, rng, SIGMA_M), 0.1 * i)
        estimate = robot.update(Measurement(0.1 * i, SE2.identity(), scan, STILL_NOISE))
        error = (estimate.T_map_base.inverse() @ pose).log()
        nees.append(float(error @ np.linalg.solve(estimate.covariance, error)))
        errors_m.append(math.hypot(error[0], error[1]))
    return nees, errors_m


@pytest.mark.slow
def test_robot_that_stands_keeps_improving_and_knows_how_sure_it_is(full_room):
    rng, nees, errors_m = np.random.default_rng(1), [], []
    for seed in range(12):
        pose = SE2(*rng.uniform([1.5, 0.8, -3.0], [3.6, 2.6, 3.0]))
        of_pose = stood(full_room["limit"], pose, seed, 50)
        nees.append(of_pose[0])
        errors_m.append(of_pose[1])
    # 12 draws of chi-square(3): a mean of 3 to 0.7, three of these; with the edges of every scan
    # counted as if they were new, it is 20 after 50 scans
    for count in (1, 10, 50):
        assert 0.9 < np.mean(nees, axis=0)[count - 1] < 5.2, count
    rms_m = np.sqrt(np.mean(np.square(errors_m), axis=0))
    # independent scans would come to a seventh
    assert rms_m[-1] < 0.27 * rms_m[0]


def test_what_repeats_in_the_scans_of_a_robot_that_stands_is_counted_once(full_room):
    # 50 scans have 0.12 + 0.88 / 50 of the variance of one, or somewhat less where innovations are
    # small; if each were new, 0.02 to 0.07. The errors in this room would pass for either
    for seed, pose in enumerate((SE2(2.0, 1.2, 0.5), SE2(3.2, 2.3, -2.0))):
        rng = np.random.default_rng(seed)
        robot = Localizer(full_room["fast"], pose, LASER)
        variances = []
        for i in range(50):
            scan = at_once(scan_of(FULL_ROOM, pose @ LASER, rng, SIGMA_M), 0.1 * i)
            estimate = robot.update(Measurement(0.1 * i, SE2.identity(), scan, STILL_NOISE))
            variances.append(np.diag(estimate.covariance))
        assert (variances[-1] > 0.1 * variances[0]).all()


def swept_scan(start: SE2, twist: np.ndarray, end_s: float, rng: np.random.Generator) -> LaserScan:
    """The scan of a laser whose beams are fired one by one over 0.1 s along a twist (3,)."""
    shares = np.arange(len(ANGLES_RAD)) / len(ANGLES_RAD)
    lasers = [start @ SE2.exp(twist * share) @ LASER for share in shares]
    fired = Beams(
        np.array([[laser.x, laser.y] for laser in lasers]),
        np.array([laser.theta for laser in lasers]) + ANGLES_RAD,
        np.full(len(lasers), np.nan),
    )
    ranges_m = cast_all(WALLS, fired, SE2.identity())[0] + rng.normal(0.0, SIGMA_M, len(lasers))
    return LaserScan(end_s, ANGLES_RAD, ranges_m, end_s - 0.1 * (1.0 - shares))


TURNING = np.array([0.0, 0.0, 0.1])  # 1 rad/s


def nees_of(estimate: Estimate, true: SE2) -> float:
    error = (estimate.T_map_base.inverse() @ true).log()
    return float(error @ np.linalg.solve(estimate.covariance, error))


@pytest.mark.parametrize("turn_rad", [0.03, -0.05, 0.1])
def test_first_scan_of_a_turning_robot_is_not_believed_as_if_it_stood(turn_rad, room):
    turning = np.array([0.0, 0.0, turn_rad])
    rng, nees = np.random.default_rng(0), []
    for _ in range(6):
        scan, true = swept_scan(ROOM_CENTRE, turning, 0.1, rng), ROOM_CENTRE @ SE2.exp(turning)
        robot = Localizer(room["limit"], true, LASER)
        estimate = robot.update(Measurement(0.1, SE2.identity(), scan))
        assert any("scan not straightened" in said for said in estimate.warnings)
        nees.append(nees_of(estimate, true))
    # of a bound, not of a sigma, so below 3 as well as not much above
    assert np.mean(nees) < 10.0


def test_first_scan_of_a_robot_at_rest_is_believed_in_full(room):
    rng = np.random.default_rng(0)
    for _ in range(6):
        scan = swept_scan(ROOM_CENTRE, np.zeros(3), 0.1, rng)
        robot = Localizer(room["limit"], ROOM_CENTRE, LASER)
        estimate = robot.update(Measurement(0.1, SE2.identity(), scan))
        assert estimate.warnings == ()
        assert np.sqrt(np.diag(estimate.covariance)).max() < 0.002


def test_scan_without_beam_times_is_late_by_what_the_robot_moved_and_says_so(room):
    rng, true, nees = np.random.default_rng(0), ROOM_CENTRE, []
    robot = Localizer(room["limit"], true, LASER)
    robot.update(
        Measurement(0.0, SE2.identity(), scan_of(ROOM_SEGMENTS, true @ LASER, rng, SIGMA_M))
    )
    for i in range(1, 8):
        scan = replace(swept_scan(true, TURNING, 0.1 * i, rng), beam_times_s=None)
        true = true @ SE2.exp(TURNING)
        estimate = robot.update(Measurement(0.1 * i, SE2.exp(TURNING), scan, STEP_COVARIANCE))
        assert any("it has no beam times" in said for said in estimate.warnings)
        nees.append(nees_of(estimate, true))
    assert np.mean(nees) < 6.0


def stamped_by_its_first_beam(config: LocalizerConfig, room) -> tuple[list[float], Estimate]:
    """NEES of a robot that turns by fits and starts, each scan stamped when its sweep starts."""
    rng, true, told, nees = np.random.default_rng(0), ROOM_CENTRE, np.zeros(3), []
    robot = Localizer(room["limit"], true, LASER, config)
    for i in range(24):
        twist = (TURNING, -TURNING)[i // 4 % 2] if i >= 2 else np.zeros(3)
        scan = replace(swept_scan(true, twist, 0.1 * i + 0.1, rng), time_s=0.1 * i)
        estimate = robot.update(Measurement(0.1 * i, SE2.exp(told), scan, STEP_COVARIANCE))
        nees.append(nees_of(estimate, true))
        true, told = true @ SE2.exp(twist), twist
    return nees[2:], estimate


@pytest.mark.parametrize("deskew", [True, False])
def test_beams_fired_after_the_stamp_make_less_sure_and_are_warned_of(deskew, room):
    nees, last = stamped_by_its_first_beam(LocalizerConfig(deskew=deskew), room)
    # 3 where all is as assumed; taken as if known it is above 1000 at each change of speed
    assert np.mean(nees) < 6.0
    assert max(nees) < 16.3
    assert last.warnings[-1] == (
        "beams were fired up to 100 ms after the stamp, and how the robot moved then is a guess:"
        " stamp the measurement when the last beam is fired, and give the wheels' motion up to there"
    )


def test_stamp_a_few_milliseconds_before_the_last_beam_is_no_matter(room):
    rng, robot = np.random.default_rng(0), Localizer(room["limit"], ROOM_CENTRE, LASER)
    for i in range(3):
        scan = swept_scan(ROOM_CENTRE, np.zeros(3), 0.1 * i + 0.004, rng)
        estimate = robot.update(Measurement(0.1 * i, SE2.identity(), scan, STILL_NOISE))
        assert estimate.warnings == ()
    assert np.sqrt(np.diag(estimate.covariance)).max() < 0.002


@pytest.mark.parametrize("wrong_s", [-5.0, -0.1, 60.0])
@pytest.mark.parametrize("is_of_scan", [True, False])
def test_one_wrong_stamp_costs_a_turning_robot_nothing(wrong_s, is_of_scan, room):
    rng, true, nees = np.random.default_rng(3), ROOM_CENTRE, []
    robot = Localizer(room["limit"], true, LASER)
    for i in range(12):
        told = TURNING if i else np.zeros(3)
        scan, stamp_s = swept_scan(true, told, 0.1 * i, rng), 0.1 * i
        true = true @ SE2.exp(told)
        if i == 6:
            stamp_s += wrong_s
            if is_of_scan:
                times_s = scan.beam_times_s + wrong_s
                scan = replace(scan, time_s=stamp_s, beam_times_s=times_s)
        estimate = robot.update(Measurement(stamp_s, SE2.exp(told), scan, STEP_COVARIANCE))
        nees.append(nees_of(estimate, true))
    # the scan, the one that follows and the last: chi-square(3) exceeds it once in a thousand
    assert max(nees[6], nees[7], nees[-1]) < 16.3


@pytest.mark.slow
def test_stamps_that_jitter_make_a_turning_robot_less_sure(room):
    nees = []
    for seed in range(4):
        rng, true = np.random.default_rng(seed), ROOM_CENTRE
        robot = Localizer(room["limit"], true, LASER)
        for i in range(30):
            told = TURNING if i else np.zeros(3)
            scan, off_s = swept_scan(true, told, 0.1 * i, rng), rng.normal(0.0, 0.01)
            true = true @ SE2.exp(told)
            stamp_s, times_s = scan.time_s + off_s, scan.beam_times_s + off_s
            scan = replace(scan, time_s=stamp_s, beam_times_s=times_s)
            estimate = robot.update(Measurement(stamp_s, SE2.exp(told), scan, STEP_COVARIANCE))
            if i >= 5:
                nees.append(nees_of(estimate, true))
    # 3 where all is as assumed
    assert np.mean(nees) < 7.0


def test_change_of_speed_within_a_sweep_makes_the_covariance_wider(room):
    # at rest for half the sweep, then at 1 rad/s: the wheels tell half a turn rate for all of it
    rng, true = np.random.default_rng(5), ROOM_CENTRE
    robot = Localizer(room["limit"], true, LASER, LocalizerConfig(fuse=False))
    for i in range(3):
        scan = swept_scan(true, np.zeros(3), 0.1 * i, rng)
        robot.update(Measurement(0.1 * i, SE2.identity(), scan, STILL_NOISE))
    still = swept_scan(true, np.zeros(3), 0.3, rng)
    half = len(ANGLES_RAD) // 2
    turning = swept_scan(true @ SE2.exp(-TURNING / 2.0), TURNING, 0.3, rng)
    ranges_m = np.concatenate([still.ranges_m[:half], turning.ranges_m[half:]])
    scan, true = replace(still, ranges_m=ranges_m), true @ SE2.exp(TURNING / 2.0)
    estimate = robot.update(Measurement(0.3, SE2.exp(TURNING / 2.0), scan, STEP_COVARIANCE))
    # chi-square(3) exceeds it once in a thousand; a change that is taken as even does
    assert nees_of(estimate, true) < 16.3


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"start_sigma_m": math.inf}, "start_sigma_m"),
        ({"start_sigma_rad": 0.0}, "start_sigma_rad"),
        ({"max_nis": 0.0}, "max_nis"),
        ({"max_scale": 0.5}, "max_scale"),
        ({"sweep_s": math.nan}, "sweep_s"),
    ],
)
def test_configuration_that_cannot_be_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        LocalizerConfig(**wrong)

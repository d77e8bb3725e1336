"""The filter: its covariance against Monte Carlo, and what it learns."""

import numpy as np
import pytest

from slam.fusion import PoseFilter, Viewpoint, covariance_held, mixed
from slam.scan_match import MatchStatus, PoseInformation, ScanMatch
from slam.se2 import SE2
from slam.wheel_prior import WheelPrior

START_COVARIANCE = np.diag([0.02, 0.02, 0.01]) ** 2
STEP_COVARIANCE = np.diag([0.001, 0.0005, 0.001]) ** 2
NO_NOISE = np.zeros((3, 3))
STEP_S = 0.1


def deviations(wheels: WheelPrior) -> np.ndarray:
    return np.array(
        [
            wheels.forward_scale,
            wheels.turn_scale,
            wheels.curvature_per_m,
            wheels.side_slip_s,
            wheels.lag_s,
            wheels.turn_shift_m,
        ]
    )


class Robot:
    """A robot that moves as the filter's docstring says, its wheels' errors drawn."""

    def __init__(self, rng: np.random.Generator, start: SE2, wheels: WheelPrior) -> None:
        self.rng, self.wheels = rng, wheels
        self.true = start @ SE2.exp(rng.multivariate_normal(np.zeros(3), START_COVARIANCE))
        self.errors = rng.normal(0.0, deviations(wheels))
        self.before: np.ndarray | None = None

    def move(self, told: np.ndarray, covariance: np.ndarray = STEP_COVARIANCE) -> None:
        v, y, w = told
        forward, turn, curvature, slip, lag, shift = self.errors
        velocity = told / STEP_S
        change = np.zeros(3) if self.before is None else velocity - self.before
        self.before = velocity
        creep = self.wheels.lag_noise_s * change * self.rng.normal(size=3) * [1.0, 0.0, 1.0]
        twist = np.array(
            [
                v * (1.0 + forward) + lag * change[0] + shift * w,
                y + slip * v * velocity[2],
                w * (1.0 + turn) + curvature * v + lag * change[2],
            ]
        )
        noise = self.rng.multivariate_normal(np.zeros(3), covariance)
        self.true = self.true @ SE2.exp(twist) @ SE2.exp(creep + noise)


def way(count: int) -> list[np.ndarray]:
    """Twists told by the wheels: straight on, round a bend, faster, and back."""
    t = np.arange(count) * STEP_S
    speeds = 0.5 + 0.4 * np.sin(0.9 * t)
    turns = 0.8 * np.sin(0.5 * t)
    return [np.array([v, 0.0, w]) * STEP_S for v, w in zip(speeds, turns, strict=True)]


@pytest.mark.slow
def test_covariance_of_dead_reckoning_is_that_of_many_robots():
    rng, start, wheels = np.random.default_rng(0), SE2(1.0, -2.0, 0.7), WheelPrior()
    track = way(20)
    pose_filter = PoseFilter(start, START_COVARIANCE, wheels)
    for told in track:
        pose_filter.predict(SE2.exp(told), STEP_S, STEP_COVARIANCE)
    offs = []
    for _ in range(1200):
        robot = Robot(rng, start, wheels)
        for told in track:
            robot.move(told)
        offs.append((pose_filter.T_map_base.inverse() @ robot.true).log())
    sampled, claimed = np.cov(np.array(offs).T), pose_filter.covariance
    whitened = np.linalg.solve(np.linalg.cholesky(claimed), np.array(offs).T)
    # 1200 draws tell a variance to 4 %, a correlation to 3 %; four of these, and first order
    np.testing.assert_allclose(np.cov(whitened), np.eye(3), atol=0.15)
    np.testing.assert_allclose(np.diag(sampled), np.diag(claimed), rtol=0.15)
    # wheels must matter here, or the test shows nothing of them
    bare = PoseFilter(start, START_COVARIANCE, WheelPrior(*[0.0] * 7))
    for told in track:
        bare.predict(SE2.exp(told), STEP_S, STEP_COVARIANCE)
    assert np.linalg.det(claimed) > 2.0 * np.linalg.det(bare.covariance)


# speeding up as it turns, so that each of the wheels' errors has something to act on
CHANGING = [np.array([0.01, 0.0, 0.02]), np.array([0.06, 0.0, 0.05]), np.array([0.04, 0.0, 0.10])]


def ended(index: int, error: float) -> SE2:
    """Where a robot ends whose wheels have this one error, by the docstring's own words."""
    robot = Robot(np.random.default_rng(0), SE2.identity(), WheelPrior(*[0.0] * 7))
    robot.true, robot.errors = SE2.identity(), np.zeros(6)
    robot.errors[index] = error
    for told in CHANGING:
        robot.move(told, STEP_COVARIANCE * 0.0)
    return robot.true


@pytest.mark.parametrize("index", range(6))
def test_each_error_of_the_wheels_spreads_as_finite_differences_say(index):
    prior = [0.0] * 7
    prior[index] = 0.01
    pose_filter = PoseFilter(SE2.identity(), NO_NOISE, WheelPrior(*prior))
    for told in CHANGING:
        pose_filter.predict(SE2.exp(told), STEP_S, NO_NOISE)
    slope = (ended(index, 0.0).inverse() @ ended(index, 1e-6)).log() / 1e-6
    expected = np.outer(slope, slope) * 0.01**2
    if index == 4:  # the lag of a robot that may just have started with the first of them
        expected[2, 2] += (0.01 * CHANGING[0][2] / STEP_S) ** 2
    # errors ahead are taken at the step's end, half of its turn away: 0.05 rad of 0.1, in a square
    # twice; metres and radians apart
    found = pose_filter.covariance
    limit = 0.12 * np.trace(expected[:2, :2])
    np.testing.assert_allclose(found[:2, :2], expected[:2, :2], rtol=0.0, atol=limit)
    assert found[2, 2] == pytest.approx(expected[2, 2], rel=1e-3, abs=1e-15)


def test_each_change_of_speed_adds_its_own_noise_ahead_and_turning():
    pose_filter = PoseFilter(SE2.identity(), NO_NOISE, WheelPrior(*[0.0] * 6, lag_noise_s=0.002))
    pose_filter.predict(SE2.exp([0.05, 0.0, 0.0]), STEP_S, NO_NOISE)
    assert not pose_filter.covariance.any()  # nothing was known of a change
    pose_filter.predict(SE2.exp([0.10, 0.0, 0.03]), STEP_S, NO_NOISE)
    # by 0.5 m/s and 0.3 rad/s
    expected = np.diag([0.001, 0.0, 0.0006]) ** 2
    np.testing.assert_allclose(pose_filter.covariance, expected, rtol=1e-9, atol=1e-18)


def test_predicted_pose_is_the_composed_motion_while_the_wheels_are_as_told():
    pose_filter, expected = PoseFilter(SE2(1.0, 2.0, 3.0), START_COVARIANCE), SE2(1.0, 2.0, 3.0)
    for told in way(20):
        moved = pose_filter.predict(SE2.exp(told), STEP_S, STEP_COVARIANCE)
        expected = expected @ SE2.exp(told)
        np.testing.assert_allclose(moved.as_array(), SE2.exp(told).as_array(), atol=1e-12)
    np.testing.assert_allclose(pose_filter.T_map_base.as_array(), expected.as_array(), atol=1e-9)


@pytest.mark.parametrize("count", [1, 10, 100])
def test_variance_of_a_standing_robot_falls_as_one_over_n(count):
    rng, pose = np.random.default_rng(count), SE2(1.0, 2.0, -0.5)
    match = np.diag([0.002, 0.004, 0.001]) ** 2
    pose_filter = PoseFilter(pose, START_COVARIANCE)
    for _ in range(count):
        pose_filter.predict(SE2.identity(), STEP_S, NO_NOISE)
        off = rng.multivariate_normal(np.zeros(3), match)
        pose_filter.update(pose @ SE2.exp(off), np.linalg.inv(match))
    expected = np.linalg.inv(np.linalg.inv(START_COVARIANCE) + count * np.linalg.inv(match))
    np.testing.assert_allclose(pose_filter.covariance, expected, rtol=1e-6, atol=1e-12)
    off = (pose_filter.T_map_base.inverse() @ pose).log()
    # chi-square(3): 25 once in 65 000
    assert off @ np.linalg.solve(expected, off) < 25.0


def test_direction_without_information_is_left_as_it_was():
    pose = SE2(1.0, 2.0, np.pi / 2)
    pose_filter = PoseFilter(pose, START_COVARIANCE)
    match = pose @ SE2(0.5, 0.01, 0.0)  # half a metre along it, and a centimetre across
    information = np.diag([0.0, 1e8, 1e8])
    # x is open; of y and theta 1 cm in 2 cm: 0.25
    assert pose_filter.innovation(match, information) == pytest.approx(0.25, rel=1e-3)
    pose_filter.update(match, information)
    change = pose.inverse() @ pose_filter.T_map_base
    assert change.x == pytest.approx(0.0, abs=1e-12)
    assert change.y == pytest.approx(0.01, rel=1e-3)
    assert pose_filter.covariance[0, 0] == pytest.approx(START_COVARIANCE[0, 0])
    assert pose_filter.covariance[1, 1] == pytest.approx(1e-8, rel=1e-3)


def test_no_information_changes_nothing():
    pose_filter = PoseFilter(SE2.identity(), START_COVARIANCE)
    assert pose_filter.innovation(SE2(3.0, 2.0, 1.0), np.zeros((3, 3))) == 0.0
    pose_filter.update(SE2(3.0, 2.0, 1.0), np.zeros((3, 3)))
    assert pose_filter.T_map_base == SE2.identity()
    np.testing.assert_allclose(pose_filter.covariance, START_COVARIANCE, rtol=1e-12)


@pytest.mark.parametrize(("index", "error"), [(0, 0.012), (1, -0.025), (2, 0.03)])
def test_error_of_the_wheels_is_learnt(index, error):
    rng = np.random.default_rng(index)
    match = np.diag([0.001, 0.001, 0.0005]) ** 2
    robot = Robot(rng, SE2.identity(), WheelPrior(*[0.0] * 7))
    robot.true, robot.errors[index] = SE2.identity(), error
    pose_filter = PoseFilter(SE2.identity(), START_COVARIANCE)
    for told in way(200):
        robot.move(told)
        pose_filter.predict(SE2.exp(told), STEP_S, STEP_COVARIANCE)
        off = rng.multivariate_normal(np.zeros(3), match)
        pose_filter.update(robot.true @ SE2.exp(off), np.linalg.inv(match))
    # 1 mm of noise in each of 200 steps of 5 cm: 14 mm in 10 m; heading likewise
    assert pose_filter.wheel_errors[index] == pytest.approx(error, abs=0.005)
    others = np.delete(pose_filter.wheel_errors, index) / np.delete(deviations(WheelPrior()), index)
    assert (np.abs(others) < 2.0).all()


def test_learnt_wheels_move_the_prediction():
    pose_filter = PoseFilter(SE2.identity(), START_COVARIANCE)
    pose_filter.wheel_errors = np.array([0.01, 0.02, 0.0, 0.0, 0.0, 0.0])
    moved = pose_filter.predict(SE2.exp([0.1, 0.0, 0.2]), STEP_S, NO_NOISE)
    np.testing.assert_allclose(moved.log(), [0.101, 0.0, 0.204], atol=1e-12)


@pytest.mark.slow
def test_innovation_and_error_are_chi_square_where_all_is_as_assumed():
    rng, wheels = np.random.default_rng(4), WheelPrior()
    match = np.diag([0.003, 0.002, 0.001]) ** 2
    information, track = np.linalg.inv(match), way(25)
    innovations, nees = [], []
    for _ in range(80):
        robot, pose_filter = Robot(rng, SE2.identity(), wheels), None
        pose_filter = PoseFilter(SE2.identity(), START_COVARIANCE, wheels)
        for told in track:
            robot.move(told)
            pose_filter.predict(SE2.exp(told), STEP_S, STEP_COVARIANCE)
            found = robot.true @ SE2.exp(-rng.multivariate_normal(np.zeros(3), match))
            innovations.append(pose_filter.innovation(found, information))
            pose_filter.update(found, information)
        off = (pose_filter.T_map_base.inverse() @ robot.true).log()
        nees.append(off @ np.linalg.solve(pose_filter.covariance, off))
    # 2000 draws of chi-square(3), whose variance is 6: the mean to 0.055, four of these
    assert np.mean(innovations) == pytest.approx(3.0, abs=0.22)
    assert np.var(innovations) == pytest.approx(6.0, rel=0.25)
    # 80 draws: to 0.27, three of these
    assert np.mean(nees) == pytest.approx(3.0, abs=0.85)


def test_restart_forgets_the_pose_and_keeps_the_wheels():
    rng = np.random.default_rng(3)
    match = np.diag([0.001, 0.001, 0.0005]) ** 2
    pose_filter, true = PoseFilter(SE2.identity(), START_COVARIANCE), SE2.identity()
    for _ in range(50):
        true = true @ SE2(0.101, 0.0, 0.0)
        pose_filter.predict(SE2(0.1, 0.0, 0.0), STEP_S, STEP_COVARIANCE)
        off = rng.multivariate_normal(np.zeros(3), match)
        pose_filter.update(true @ SE2.exp(off), np.linalg.inv(match))
    learnt = pose_filter.wheel_errors.copy()
    assert learnt[0] > 0.005
    there, covariance = SE2(5.0, 6.0, 1.0), np.diag([0.1, 0.2, 0.3])
    pose_filter.restart(there, covariance)
    assert pose_filter.T_map_base == there
    np.testing.assert_array_equal(pose_filter.covariance, covariance)
    np.testing.assert_array_equal(pose_filter.wheel_errors, learnt)
    # and the old pose's errors tell nothing of the wheels any more, nor they of the new one's
    pose_filter.predict(SE2.identity(), STEP_S, NO_NOISE)
    # it stops from 1 m/s, and the body follows within 10 ms
    stopped = covariance + np.diag([0.0101, 0.0, 0.0]) ** 2
    np.testing.assert_allclose(pose_filter.covariance, stopped, rtol=1e-4, atol=1e-12)
    pose_filter.predict(SE2.exp([0.1, 0.0, 0.1]), STEP_S, NO_NOISE)
    np.testing.assert_allclose(pose_filter.covariance, pose_filter.covariance.T, atol=1e-15)
    other = PoseFilter(SE2.identity(), START_COVARIANCE)
    other.restart(there, covariance)
    other.update(there @ SE2(0.3, 0.0, 0.0), np.eye(3) * 1e6)
    np.testing.assert_allclose(other.wheel_errors, 0.0, atol=1e-12)


def test_first_motion_of_unknown_duration_has_no_speed():
    pose_filter = PoseFilter(SE2.identity(), START_COVARIANCE)
    pose_filter.predict(SE2(0.1, 0.0, 0.1), np.inf, STEP_COVARIANCE)
    assert np.isfinite(pose_filter.covariance).all()
    assert pose_filter.T_map_base == SE2.identity() @ SE2.exp(SE2(0.1, 0.0, 0.1).log())


def test_first_motion_that_is_timed_may_have_been_a_start():
    wheels = WheelPrior(*[0.0] * 4, lag_s=0.01, turn_shift_m=0.0, lag_noise_s=0.0)
    pose_filter = PoseFilter(SE2.identity(), NO_NOISE, wheels)
    pose_filter.predict(SE2.identity(), np.inf, NO_NOISE)
    pose_filter.predict(SE2.exp([0.02, 0.0, 0.05]), STEP_S, NO_NOISE)
    # by all of 0.2 m/s and 0.5 rad/s, and nobody knows whether its body followed at once
    started = [0.002, 0.0, 0.005]
    np.testing.assert_allclose(pose_filter.covariance, np.diag(started) ** 2, atol=1e-12)
    np.testing.assert_allclose(pose_filter.motion_sigma, started, atol=1e-12)
    pose_filter.predict(SE2.exp([0.02, 0.0, 0.05]), STEP_S, NO_NOISE)
    np.testing.assert_allclose(pose_filter.motion_sigma, 0.0, atol=1e-12)


@pytest.mark.parametrize("sigma", [1e3, 1e5, 1e6, np.inf])
def test_covariance_stays_one_however_little_is_known_at_first(sigma):
    pose_filter = PoseFilter(SE2.identity(), np.diag([sigma, sigma, sigma]) ** 2)
    match = np.diag([0.002, 0.004, 0.001]) ** 2
    for told in way(20):
        pose_filter.predict(SE2.exp(told), STEP_S, STEP_COVARIANCE)
        assert np.isfinite(pose_filter.covariance).all()
        pose_filter.update(SE2(3.0, 2.0, 1.0), np.linalg.inv(match))
        assert (np.linalg.eigvalsh(pose_filter.covariance) > 0.0).all()
    # as sure as one who knew it to a metre
    known = PoseFilter(SE2.identity(), np.eye(3))
    for told in way(20):
        known.predict(SE2.exp(told), STEP_S, STEP_COVARIANCE)
        known.update(SE2(3.0, 2.0, 1.0), np.linalg.inv(match))
    np.testing.assert_allclose(
        np.diag(pose_filter.covariance), np.diag(known.covariance), rtol=0.02
    )


def test_restart_where_a_direction_is_open_is_finite_and_goes_on():
    pose_filter = PoseFilter(SE2.identity(), START_COVARIANCE)
    pose_filter.restart(SE2.identity(), covariance_held(np.diag([0.0, 1e6, 1e6])))
    # nothing of x: 100 m, as wide as a filter of first order goes
    np.testing.assert_allclose(np.diag(pose_filter.covariance), [1e4, 1e-6, 1e-6], rtol=1e-6)
    for told in way(10):
        pose_filter.predict(SE2.exp(told), STEP_S, STEP_COVARIANCE)
    assert np.isfinite(pose_filter.covariance).all()
    assert (np.linalg.eigvalsh(pose_filter.covariance) > 0.0).all()


def test_motion_of_unknown_duration_is_no_change_of_speed_for_the_next():
    pose_filter = PoseFilter(SE2.identity(), NO_NOISE, WheelPrior(*[0.0] * 6, lag_noise_s=0.002))
    for duration_s in (STEP_S, np.inf, STEP_S):
        pose_filter.predict(SE2.exp([0.1, 0.0, 0.0]), duration_s, NO_NOISE)
    assert not pose_filter.covariance.any()


def test_way_per_radian_is_learnt_anew_for_each_side():
    # tires that creep push the robot back by 1.5 mm per radian, whichever way it turns
    rng = np.random.default_rng(0)
    match = np.diag([0.0008, 0.0008, 0.0005]) ** 2
    pose_filter, true = PoseFilter(SE2.identity(), START_COVARIANCE), SE2.identity()
    nees = []
    for side in (1.0, -1.0):
        for k in range(40):
            true = true @ SE2.exp([-0.0015 * 0.05, 0.0, side * 0.05])
            pose_filter.predict(SE2.exp([0.0, 0.0, side * 0.05]), STEP_S, STEP_COVARIANCE / 1e3)
            off = rng.multivariate_normal(np.zeros(3), match)
            pose_filter.update(true @ SE2.exp(off), np.linalg.inv(match))
            error = (pose_filter.T_map_base.inverse() @ true).log()
            if side < 0.0 and k > 3:
                nees.append(error @ np.linalg.solve(pose_filter.covariance, error))
    # 36 values that hang together; with one constant for both sides they are beyond it
    assert np.mean(nees) < 8.0


INFORMATION = np.diag([1e6, 2e6, 4e6])


def test_standing_robot_uses_the_edges_once_and_moving_sees_anew():
    smooth = PoseInformation(SE2(0.001, 0.0, 0.0), INFORMATION / 4.0)
    match = ScanMatch(SE2.identity(), MatchStatus.MATCHED, information=INFORMATION, smooth=smooth)
    view = Viewpoint()
    assert view.fresh(match) is match
    view.take()
    # half a standard deviation of the smooth beams, 2 mm, is no other view; twice more of it is
    view.move(SE2(0.001, 0.0, 0.0))
    part = view.fresh(match)
    assert part.T_map_base == smooth.T_map_base
    np.testing.assert_array_equal(part.information, smooth.information)
    view.move(SE2(0.0015, 0.0, 0.0))
    assert view.fresh(match) is match


def test_share_that_repeats_is_a_floor_for_the_covariance_of_a_standing_robot():
    match = ScanMatch(SE2.identity(), MatchStatus.MATCHED, information=INFORMATION, repeated=0.25)
    view, total = Viewpoint(), np.zeros((3, 3))
    for _ in range(30):
        total += view.fresh(match).information
        view.take()
    # a quarter stays, the rest is divided by 30
    np.testing.assert_allclose(np.linalg.inv(total) @ INFORMATION, np.eye(3) * 0.275, atol=1e-12)


def test_share_that_repeats_holds_for_the_scans_of_a_stretch_of_the_way():
    match = ScanMatch(SE2.identity(), MatchStatus.MATCHED, information=INFORMATION, repeated=0.25)
    for step in (SE2(0.02, 0.0, 0.0), SE2(0.0, 0.0, 0.02)):
        view, total = Viewpoint(), np.zeros((3, 3))
        for _ in range(15):
            total += view.fresh(match).information
            view.take()
            view.move(step)
        # 2 cm or 20 mrad a scan: many sigmas, and yet the same points of the same walls nearly
        np.testing.assert_allclose(np.linalg.inv(total) @ INFORMATION, np.eye(3) * 0.3, atol=1e-12)
        view.move(step)
        assert view.fresh(match) is match


def test_mixture_is_as_wide_as_its_parts_lie_apart():
    parts = [
        ScanMatch(SE2(x, 0.0, 0.0), MatchStatus.MATCHED, information=INFORMATION)
        for x in (0.0, 0.0, 0.01, 0.01)
    ]
    both = mixed(parts, np.zeros(4))
    assert both.T_map_base.x == pytest.approx(0.005)
    # 5 mm to either side, 1 mm each; and between the middle two 5 mm a step, a twelfth of its square
    expected = 0.005**2 + 1e-6 + 0.5 * 0.005**2 / 12.0
    assert np.linalg.inv(both.information)[0, 0] == pytest.approx(expected, rel=1e-6)
    one = mixed(parts, np.array([0.0, 0.0, -100.0, -100.0]))
    assert one.T_map_base.x == pytest.approx(0.0, abs=1e-12)

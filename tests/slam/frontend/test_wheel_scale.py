"""The scale of the wheels is learnt where scans tell the way, and holds where they tell nothing."""

import math

import numpy as np
import pytest

from slam.frontend.front_end import FrontEnd
from slam.frontend.wheel_scale import WheelScale, WheelScaleConfig
from slam.kernels import wheel_scale as kernels
from slam.mapping import Mapper
from slam.metrics import absolute_errors
from slam.se2 import SE2
from tests.slam import ring
from tests.slam.synthetic import room

AHEAD = SE2(0.25, 0.0, 0.0)
SPREAD = np.diag([0.01**2, 0.005**2, 0.01**2])
SCAN = np.diag([0.005**-2, 0.005**-2, 0.002**-2])
NOTHING_AHEAD = np.diag([0.0, 0.005**-2, 0.002**-2])


def driven(scale, true_scale, steps, information=SCAN, facing=0.2):
    """A straight way, each step seen from the last one."""
    for _ in range(steps):
        covariance = scale.predict(np.zeros((3, 3)), AHEAD, SPREAD)
        off_m = (true_scale - scale.scale) * AHEAD.x
        after = np.linalg.inv(np.linalg.inv(covariance) + information)
        innovation = after @ information @ np.array([off_m, 0.0, 0.0])
        scale.update(covariance, SE2.exp(innovation), information, facing)
        step = scale.begin_step()
    return step


@pytest.mark.parametrize("true_scale", [0.85, 1.0, 1.15])
def test_scale_is_learnt_from_scans_that_see_ahead(true_scale):
    scale = WheelScale()
    driven(scale, true_scale, 200)
    assert abs(scale.scale - true_scale) < 3.0 * scale.sigma < 0.015


@pytest.mark.parametrize(
    ("information", "facing"), [(NOTHING_AHEAD, 0.2), (SCAN, 0.0002)], ids=["silent", "open"]
)
def test_scans_that_leave_the_way_open_teach_nothing(information, facing):
    scale = WheelScale()
    driven(scale, 1.1, 200, information, facing)
    assert scale.scale == pytest.approx(1.0)
    assert scale.sigma == pytest.approx(scale.config.sigma)


def test_step_of_which_scans_tell_nothing_grows_with_the_scale():
    open_step = driven(WheelScale(), 1.0, 3, NOTHING_AHEAD)
    assert open_step.slope == pytest.approx([AHEAD.x, 0.0, 0.0], abs=1e-9)
    held = driven(WheelScale(), 1.0, 3)
    assert abs(held.slope[0]) < 0.3 * AHEAD.x


def test_wheels_told_to_be_exact_are_no_division_by_nothing():
    scale = WheelScale()
    for _ in range(5):
        scale.predict(np.zeros((3, 3)), AHEAD, np.zeros((3, 3)))
        scale.update(np.zeros((3, 3)), SE2(0.01, 0.0, 0.0), SCAN, 0.2)
        scale.begin_step()
    assert scale.noise > 1.0


def test_pose_and_scale_are_followed_as_four_unknowns_are():
    """The filter in blocks against the same one in full, 4 x 4, each scan taken in at once."""
    rng, scale = (
        np.random.default_rng(1),
        WheelScale(WheelScaleConfig(way_m=0.0, alike=0.0, least_scans=0)),
    )
    P = np.zeros((3, 3))
    full = np.diag([0.0, 0.0, 0.0, scale.variance])
    for _ in range(20):
        told = SE2(rng.uniform(0.1, 0.4), 0.0, 0.0)
        went = scale.scaled(told)
        F = np.eye(4)
        F[:3, :3] = went.inverse().adjoint()
        F[0, 3] = told.x
        full = F @ full @ F.T
        full[:3, :3] += SPREAD
        P = scale.predict(P, told, SPREAD)
        np.testing.assert_allclose(P, full[:3, :3], atol=1e-14)
        innovation = np.array([rng.normal(0.0, 0.002), 0.0, 0.0])
        information = np.diag([*rng.uniform(0.0, 1e4, 2), 1e5])
        before = scale.scale + full[3, :3] @ np.linalg.solve(full[:3, :3], innovation)
        lifted = np.zeros((4, 4))
        lifted[:3, :3] = information
        scale.update(P, SE2.exp(innovation), information, 0.2)
        full = np.linalg.inv(np.linalg.inv(full) + lifted)
        P = full[:3, :3].copy()
        assert scale.scale == pytest.approx(before, rel=1e-10)
        assert scale.variance == pytest.approx(full[3, 3], rel=1e-9)


def test_pose_turns_and_moves_with_the_scale_as_four_unknowns_do():
    rng, scale = np.random.default_rng(1), WheelScale()
    P = np.zeros((3, 3))
    full = np.diag([0.0, 0.0, 0.0, scale.variance])
    for _ in range(20):
        told = SE2(*rng.normal(0.0, [0.2, 0.05, 0.4]))
        c, s = math.cos(told.theta), math.sin(told.theta)
        F = np.eye(4)
        F[:3, :3] = told.inverse().adjoint()
        F[:2, 3] = np.array([[c, s], [-s, c]]) @ [told.x, told.y]
        full = F @ full @ F.T
        full[:3, :3] += SPREAD
        P = scale.predict(P, told, SPREAD)
        np.testing.assert_allclose(P, full[:3, :3], atol=1e-14)
    step = scale.begin_step()
    np.testing.assert_allclose(step.slope, full[:3, 3] / full[3, 3], atol=1e-12)


def test_a_scan_tells_of_the_scale_as_by_matrices():
    rng, T, bearing_rad, pull = np.random.default_rng(4), SE2(0.03, -0.05, 1.1), 0.6, 0.4
    P, information = (rows @ rows.T for rows in rng.normal(size=(2, 3, 5)))
    across = 0.1 * rng.normal(size=3)
    ahead = np.array([math.cos(bearing_rad), math.sin(bearing_rad), 0.0])
    gain = np.linalg.solve(P, across)
    after = np.linalg.solve(np.linalg.inv(P) + pull * information, gain)
    expected = (
        gain @ across - gain @ after, T.log() @ np.linalg.solve(P, T.log()), ahead @ T.log(),
        ahead @ P @ ahead, ahead @ across, ahead @ after,
    )  # fmt: skip
    told = kernels.update(P, across, T.x, T.y, T.theta, *ahead[:2], information, pull)
    np.testing.assert_allclose(told, expected, rtol=1e-9)
    np.testing.assert_allclose(across, after, rtol=1e-9)


def test_scans_pull_at_the_scale_as_at_the_pose(monkeypatch):
    front_end, pulls = FrontEnd(ring.T_BASE_LASER), []
    update = front_end.wheel_scale.update

    def noted(covariance, innovation, information, least_facing, pull):
        pulls.append(pull)
        update(covariance, innovation, information, least_facing, pull)

    monkeypatch.setattr(front_end.wheel_scale, "update", noted)
    for measurement in ring.drive(ring.way(0.01), np.random.default_rng(0))[:5]:
        front_end.update(measurement)
    surfaces = front_end.config.surfaces
    assert len(pulls) >= 3
    assert pulls == [pytest.approx(surfaces.pull / surfaces.share)] * len(pulls)


def odometry_told(scale, told_m, true_m):
    """A straight way of which the wheels tell told_m (K,) and scans true_m (K,), step by step."""
    for told, went in zip(told_m, true_m, strict=True):
        spread = np.diag([0.01**2 + 0.05**2 * told, 0.01**2, 0.01**2])
        covariance = scale.predict(np.zeros((3, 3)), SE2(told, 0.0, 0.0), spread)
        after = np.linalg.inv(np.linalg.inv(covariance) + SCAN)
        off_m = np.array([went - scale.scale * told, 0.0, 0.0])
        scale.update(covariance, SE2.exp(after @ SCAN @ off_m), SCAN, 0.2)
        scale.begin_step()


@pytest.mark.parametrize("true_scale", [0.9, 1.0])
def test_odometry_at_a_clock_of_its_own_tells_its_scale_no_less(true_scale):
    # the last of 15 records each second, at scans of 10: 33 and 67 mm in turns at 0.5 m/s
    scale = WheelScale()
    records = np.floor(1.5 * np.arange(1201) + 1e-9) / 1.5
    odometry_told(scale, 0.05 * np.diff(records), np.full(1200, 0.05 * true_scale))
    assert scale.scale == pytest.approx(true_scale, abs=0.01)


@pytest.mark.parametrize(("late", "speed_m"), [(0.75, 0.05), (0.5, 0.02)])
def test_odometry_told_less_often_than_scans_teaches_nothing(late, speed_m):
    scale = WheelScale()
    records = np.floor(late * np.arange(1201) + 1e-9) / late
    odometry_told(scale, speed_m * np.diff(records), np.full(1200, speed_m))
    assert scale.scale == pytest.approx(1.0, abs=0.01)


def test_odometry_that_is_late_at_each_stop_teaches_nothing():
    went_m = np.tile([*[0.04] * 12, *[0.0] * 15], 60)
    scale = WheelScale()
    odometry_told(scale, np.roll(went_m, 2), went_m)
    assert scale.scale == pytest.approx(1.0, abs=0.01)


def test_wheels_that_spin_while_the_robot_stands_teach_nothing():
    scale = WheelScale()
    driven(scale, 1.0, 100)
    sigma = scale.sigma
    for _ in range(40):
        covariance = scale.predict(np.zeros((3, 3)), SE2(0.05, 0.0, 0.0), SPREAD)
        scale.update(covariance, SE2(-0.05 * scale.scale, 0.0, 0.0), SCAN, 0.2)
        scale.begin_step()
    assert scale.scale == pytest.approx(1.0, abs=1e-3)
    assert scale.sigma == pytest.approx(sigma, rel=0.05)


def test_wheels_that_jump_teach_nothing():
    scale = WheelScale()
    covariance = scale.predict(np.zeros((3, 3)), AHEAD, SPREAD)
    scale.update(covariance, SE2(0.6, 0.0, 0.0), SCAN, 0.2)
    assert scale.scale == 1.0


@pytest.mark.parametrize("true_scale", [0.8, 1.0, 1.2])
def test_noisier_wheels_than_told_show_their_scale_and_how_well(true_scale):
    # told to be off by 5 cm after a metre, and are by 15: each second stretch was taken for slip, and
    # of those left about as many were believed as agreed with wheels as told
    off = []
    for seed in range(8):
        scale, rng = WheelScale(), np.random.default_rng(seed)
        told_m = np.full(400, 0.4)
        off_m = 0.15 * np.sqrt(told_m) * rng.normal(size=400)
        odometry_told(scale, told_m, true_scale * told_m + off_m)
        off.append((scale.scale - true_scale) / scale.sigma)
    assert abs(np.mean(off)) < 2.0
    assert np.sqrt(np.mean(np.square(off))) < 2.5


def corridor(length_m, way_scale, back=True):
    """There and back again between walls of which a laser of 8 m sees no end from the middle."""
    there = [SE2(1.5 + 0.1 * k, 0.0, 0.0) for k in range(int(10 * (length_m - 3.0)))]
    turn = [SE2(length_m - 1.5, 0.0, 0.2 * k) for k in range(1, 16)]
    home = [SE2(length_m - 1.5 - 0.1 * k, 0.0, math.pi) for k in range(len(there) if back else 0)]
    poses = there + turn + home
    walls = room(0.0, -1.2, length_m, 1.2)
    told = ring.drive(poses, np.random.default_rng(4), 1.0, way_scale, walls)
    mapper = Mapper(ring.T_BASE_LASER)
    for measurement in told:
        mapper.update(measurement)
    slam_map = mapper.finish()
    true = np.array([pose.as_array() for pose in poses])
    return slam_map, float(absolute_errors(slam_map.trajectory.poses, true).position_m.rmse)


@pytest.mark.slow
@pytest.mark.parametrize("way_scale", [0.9, 1.15])
def test_corridor_is_as_long_as_it_is_though_the_wheels_are_not_as_told(way_scale):
    # the ends, each seen for a few metres, are all that tells; the first steps, too, were by wheels
    # of which nothing was known yet
    slam_map, rmse_m = corridor(26.0, way_scale)
    assert slam_map.verdict.is_good
    assert rmse_m < 0.09  # 0.6 m and more, by the wheels as told
    length_m = np.ptp(slam_map.poses[:, 0])
    assert abs(length_m - 23.0) < 0.25


@pytest.mark.slow
def test_map_whose_length_nothing_tells_is_called_failed():
    slam_map, _ = corridor(60.0, 1.0, back=False)
    (reason,) = slam_map.verdict.reasons
    assert "how far the robot went between them the wheels alone tell" in reason

"""The scale of the wheels is learnt where scans tell the way, and holds where they tell nothing."""

import math

import numpy as np
import pytest

from slam.mapping import Mapper
from slam.metrics import absolute_errors
from slam.se2 import SE2
from slam.wheel_scale import WheelScale, WheelScaleConfig
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
        scale.update(covariance, innovation, information, facing)
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


def test_pose_and_scale_are_followed_as_four_unknowns_are():
    """The filter in blocks against the same one in full, 4 x 4, each scan taken in at once."""
    rng, scale = np.random.default_rng(1), WheelScale(WheelScaleConfig(way_m=0.0, alike=0.0))
    P = np.zeros((3, 3))
    full = np.diag([0.0, 0.0, 0.0, scale.variance])
    for _ in range(20):
        told = SE2(*rng.normal(0.0, [0.2, 0.05, 0.4]))
        went = scale.scaled(told)
        c, s = math.cos(told.theta), math.sin(told.theta)
        F = np.eye(4)
        F[:3, :3] = went.inverse().adjoint()
        F[:2, 3] = np.array([[c, s], [-s, c]]) @ [told.x, told.y]
        full = F @ full @ F.T
        full[:3, :3] += SPREAD
        P = scale.predict(P, told, SPREAD)
        np.testing.assert_allclose(P, full[:3, :3], atol=1e-14)
        innovation = rng.normal(0.0, 0.002, 3)
        information = np.diag([*rng.uniform(0.0, 1e4, 2), 1e5])
        before = scale.scale + full[3, :3] @ np.linalg.solve(full[:3, :3], innovation)
        lifted = np.zeros((4, 4))
        lifted[:3, :3] = information
        scale.update(P, innovation, information, 0.2)
        full = np.linalg.inv(np.linalg.inv(full) + lifted)
        P = full[:3, :3].copy()
        assert scale.scale == pytest.approx(before, rel=1e-10)
        assert scale.variance == pytest.approx(full[3, 3], rel=1e-9)


def test_wheels_that_spin_while_the_robot_stands_teach_nothing():
    scale = WheelScale()
    driven(scale, 1.0, 100)
    sigma = scale.sigma
    for _ in range(40):
        covariance = scale.predict(np.zeros((3, 3)), SE2(0.05, 0.0, 0.0), SPREAD)
        scale.update(covariance, np.array([-0.05 * scale.scale, 0.0, 0.0]), SCAN, 0.2)
        scale.begin_step()
    assert scale.scale == pytest.approx(1.0, abs=1e-3)
    assert scale.sigma == pytest.approx(sigma, rel=0.05)


def test_wheels_that_jump_teach_nothing():
    scale = WheelScale()
    covariance = scale.predict(np.zeros((3, 3)), AHEAD, SPREAD)
    scale.update(covariance, np.array([0.6, 0.0, 0.0]), SCAN, 0.2)
    assert scale.scale == 1.0


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


@pytest.mark.parametrize("way_scale", [0.9, 1.15])
def test_corridor_is_as_long_as_it_is_though_the_wheels_are_not_as_told(way_scale):
    # the ends, each seen for a few metres, are all that tells; the first steps, too, were by wheels
    # of which nothing was known yet
    slam_map, rmse_m = corridor(26.0, way_scale)
    assert slam_map.verdict.is_good
    assert rmse_m < 0.08  # 0.6 m and more, by the wheels as told
    length_m = np.ptp(slam_map.poses[:, 0])
    assert abs(length_m - 23.0) < 0.2


def test_map_whose_length_nothing_tells_is_called_failed():
    slam_map, _ = corridor(60.0, 1.0, back=False)
    (reason,) = slam_map.verdict.reasons
    assert "whose scale is known to" in reason

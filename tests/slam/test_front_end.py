"""The front end of mapping: which of several poses of a scan is believed."""

from dataclasses import replace

import numpy as np
import pytest

from slam.front_end import FrontEnd, StepStatus
from slam.se2 import SE2
from tests.slam import ring

NEXT_DOOR = SE2(-1.2, 0.0, 0.0)


@pytest.mark.parametrize(
    ("sigma_m", "gain", "status"),
    [
        # wheels known to 5 cm, and a pose 1.2 m from where they lead: as aces had it, thinned
        (0.05, 0.15, StepStatus.MATCHED),
        # odometry that jumped
        (0.05, 0.30, StepStatus.SEARCHED),
        # no odometry
        (1.0, 0.15, StepStatus.SEARCHED),
    ],
)
def test_pose_that_the_wheels_contradict_must_fit_much_better(monkeypatch, sigma_m, gain, status):
    front_end = FrontEnd(ring.T_BASE_LASER)
    first, second = ring.drive(ring.way(0.01), np.random.default_rng(0))[:2]
    front_end.update(first)
    covariance = np.diag([sigma_m**2, sigma_m**2, 0.05**2])
    match = front_end._surfaces.match

    def badly(*args, **kwargs):
        return replace(match(*args, **kwargs), inlier_ratio=0.8, cost=0.4)

    def around(points, T_last, T_predicted, odometry):
        found = badly(points, T_predicted, T_predicted, odometry)
        return replace(found, T_map_base=T_predicted @ NEXT_DOOR, inlier_ratio=0.9, cost=0.4 - gain)

    monkeypatch.setattr(front_end._surfaces, "match", badly)
    monkeypatch.setattr(front_end, "_around", around)
    step = front_end.update(replace(second, motion_covariance=covariance))
    assert step.status is status
    T_wheels = front_end.keyframes[0].T_map_base @ second.motion
    expected = T_wheels if status is StepStatus.MATCHED else T_wheels @ NEXT_DOOR
    assert step.T_map_base.is_near(expected, 0.1, 0.05)

"""What a drive says against its map: wheels that stood still while the scans show a motion."""

import numpy as np
import pytest

from slam import SE2, LaserScan, Measurement
from slam.drive_monitor import DriveMonitor
from slam.keyframes import FrontEndStep, StepStatus

SCAN = LaserScan(0.0, np.radians([-1.0, 0.0, 1.0]), np.ones(3))


def objections(by_wheels: SE2, by_scan: SE2, *, is_open: bool, covariance=None) -> list[str]:
    """After one scan, matched there."""
    monitor, T_before = DriveMonitor(5.0), SE2(4.0, 1.0, 0.2)
    T = T_before @ by_scan
    step = FrontEndStep(7.0, 0, T, T, StepStatus.MATCHED, 0.9, True, is_open=is_open)
    measurement = Measurement(7.0, by_wheels, SCAN, covariance)
    monitor.take(measurement, T_before, step, measurement.motion_covariance[0, 0])
    return monitor.objections([step])


@pytest.mark.parametrize("by_scan", [SE2(0.0, 0.0, 0.07), SE2(0.0, 0.1, 0.0)])
def test_a_motion_that_the_wheels_deny_may_have_been_longer_where_scans_leave_a_way_open(by_scan):
    (said,) = objections(SE2.identity(), by_scan, is_open=True)
    assert said.startswith("at 7.00 s the wheels stood still, and the robot did not")
    assert not objections(SE2.identity(), by_scan, is_open=False)
    assert not objections(SE2(0.05, 0.0, 0.0), by_scan, is_open=True)
    # scans alone: nothing was denied
    assert not objections(SE2.identity(), by_scan, is_open=True, covariance=np.eye(3))


def test_a_robot_that_stands_may_be_placed_a_hair_aside():
    # 28 scans of intel: by 6 mm and 2 mrad at most
    assert not objections(SE2.identity(), SE2(0.02, 0.0, 0.006), is_open=True)

"""Motions over a gap in a log: less sure the longer it lasted, and as sure as ever without one."""

import numpy as np
import pytest

from slam.readers.log import MotionSinceScan
from slam.readers.log_odometry import USUAL_NOISE
from slam.readers.log_record import LogRecord
from slam.readers.record_gaps import RecordGaps
from slam.se2 import SE2

STEP = SE2(0.1, 0.0, 0.02)


def after(gap_s: float, motion: SE2) -> np.ndarray | None:
    gaps = RecordGaps()
    for k in range(30):
        assert gaps.covariance(0.2 * k, STEP) is None
    return gaps.covariance(5.8 + gap_s, motion)


def test_nothing_is_added_without_a_gap_or_where_the_robot_stood():
    far = SE2(3.0, 0.0, 0.1)
    assert after(1.5, far) is None
    assert after(-100.0, far) is None
    assert after(300.0, STEP) is None  # stamps that jump, or a pause
    assert after(300.0, SE2(0.0, 0.0, 1.0)) is not None


@pytest.mark.parametrize("gap_s", [3.0, 30.0, 300.0])
def test_a_way_that_nobody_saw_is_as_unsure_as_long(gap_s):
    motion = SE2(11.0, 0.0, 0.4)
    sigma_m, _, sigma_rad = np.sqrt(np.diag(after(gap_s, motion)))
    longer_m, _, longer_rad = np.sqrt(np.diag(after(10.0 * gap_s, motion)))
    assert sigma_m < longer_m
    assert longer_rad / sigma_rad == pytest.approx(np.sqrt(10.0), rel=0.6)
    # at its end the robot is about as far off as its heading at the start leads it
    assert sigma_m > 11.0 * sigma_rad / 2.0


def test_stamps_that_jump_by_years_make_no_more_of_it_than_ten_minutes():
    assert np.array_equal(after(600.0, SE2(2.0, 0.0, 0.0)), after(1e9, SE2(2.0, 0.0, 0.0)))


def test_logs_take_it_into_the_motion_of_their_scans():
    def covariance(gap_s: float) -> np.ndarray:
        since, T = MotionSinceScan(USUAL_NOISE.covariance), SE2.identity()
        for k in range(30):
            T = T @ STEP
            since.add(LogRecord(0.2 * k, T, None))
        before = since._covariance.copy()
        since.add(LogRecord(5.8 + gap_s, T @ SE2(11.0, 0.0, 0.4), None))
        return since._covariance - before

    assert np.sqrt(covariance(0.2)[2, 2]) < 0.2
    assert np.sqrt(covariance(472.0)[2, 2]) > 0.6

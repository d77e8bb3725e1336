"""A robot without wheel odometry: the scans alone tell how it moved while it is searched for."""

import math
from pathlib import Path

import numpy as np

from slam import SE2, Mapper, Measurement, Status, read_log
from slam.metrics import absolute_errors
from slam.pose_lookup import PoseLookup
from slam.trajectory import read_tum
from tests.slam.guarded import mapped_in_cells
from tests.slam.synthetic import ROOM_SEGMENTS, scan_of

UNKNOWN = np.diag([1.0, 1.0, 1.0])
DATA = Path(__file__).parents[1] / "data"
EXCERPT, REFERENCE = DATA / "fr101-excerpt.clf.gz", DATA / "fr101-excerpt.reference.tum"
CIRCLE = SE2(0.06, 0.0, 0.05)


def test_robot_without_wheels_is_found_on_a_map_of_cells():
    # such a map wants five views; all scans were one to a robot that had not moved by its wheels
    known = mapped_in_cells(ROOM_SEGMENTS, [(0.0, 0.0, 6.0, 4.0)], (-0.115, -0.141))
    localizer = known.localizer("limit", None, SE2.identity())
    rng, at, statuses = np.random.default_rng(0), SE2(2.6, 1.2, 0.4), []
    for count in range(40):
        at = at @ CIRCLE
        scan = scan_of(ROOM_SEGMENTS, at, rng, 0.01)
        told = Measurement(0.2 * count, SE2.identity(), scan, UNKNOWN)
        estimate = localizer.update(told)
        statuses.append(estimate.verdict.status)
        if estimate.verdict.status is Status.TRACKING:
            off = at.inverse() @ estimate.T_map_base
            assert math.hypot(off.x, off.y) < 0.1
            assert abs(off.theta) < 0.05
    assert Status.TRACKING not in statuses[:4]
    assert statuses[-10:] == [Status.TRACKING] * 10


def test_without_wheels_a_scan_is_looked_for_all_around():
    # a scan each three seconds: matched from where the robot was before, one came out 1.2 m off
    # along the corridor, 0.85 of it on walls, and the map was called good
    log, reference = read_log(EXCERPT), read_tum(REFERENCE)
    mapper = Mapper(log.T_base_laser)
    for told in log.measurements():
        mapper.update(Measurement(told.time_s, SE2.identity(), told.scan, UNKNOWN))
    slam_map = mapper.finish()
    assert slam_map.verdict.is_good
    poses = slam_map.trajectory.poses
    true = PoseLookup(reference).at(slam_map.trajectory.times_s)
    assert absolute_errors(poses, true).position_m.rmse < 0.05

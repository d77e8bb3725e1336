"""A robot without wheel odometry: the scans alone tell how it moved while it is searched for."""

import math

import numpy as np

from slam import SE2, Measurement, Status
from tests.slam.guarded import mapped_in_cells
from tests.slam.synthetic import ROOM_SEGMENTS, scan_of

UNKNOWN = np.diag([1.0, 1.0, 1.0])
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

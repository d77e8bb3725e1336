"""The paper's mapping, and the wheels alone beside it."""

import numpy as np

from slam.icp import IcpConfig, StopRule
from slam.icp_mapping import IcpMapper
from slam.measurements import LaserScan, Measurement
from slam.scan_match import MatchStatus
from slam.se2 import SE2
from tests.slam.synthetic import ANGLES_RAD, ROOM_CENTRE, ROOM_SEGMENTS, scan_of

LASER = SE2(0.1, 0.0, 0.0)
STEP = SE2(0.05, 0.0, 0.02)
WHEELS = SE2(0.052, 0.0, 0.02)


def measured(count: int) -> list[Measurement]:
    rng, pose, found = np.random.default_rng(0), ROOM_CENTRE, []
    for index in range(count):
        scan = scan_of(ROOM_SEGMENTS, pose @ LASER, rng, 0.005)
        found.append(Measurement(0.1 * index, WHEELS if index else SE2.identity(), scan))
        pose = pose @ STEP
    return found


def test_scans_correct_the_wheels():
    mapper, wheels = IcpMapper(LASER), IcpMapper(LASER, None)
    for measurement in measured(12):
        match = mapper.update(measurement)
        assert wheels.update(measurement) is None
    assert match is not None
    assert match.status is MatchStatus.MATCHED
    true = SE2.identity()
    for _ in range(11):
        true = true @ STEP
    off = true.inverse() @ mapper.T_map_base
    drifted = true.inverse() @ wheels.T_map_base
    assert np.hypot(off.x, off.y) < 0.5 * np.hypot(drifted.x, drifted.y)
    made = mapper.finish()
    assert len(made.trajectory) == 12
    assert 200 < len(made.points) < len(wheels.finish().points)


def test_scan_that_does_not_match_leaves_the_map_as_it_is():
    mapper = IcpMapper(LASER, IcpConfig(stop_rule=StopRule.CONVERGED))
    first, *_ = measured(1)
    mapper.update(first)
    before = mapper.point_map.points
    strange = LaserScan(0.1, ANGLES_RAD, np.full(len(ANGLES_RAD), 9.0))
    match = mapper.update(Measurement(0.1, WHEELS, strange))
    assert match is not None
    assert match.status is not MatchStatus.MATCHED
    assert mapper.T_map_base == WHEELS
    assert mapper.point_map.points is before

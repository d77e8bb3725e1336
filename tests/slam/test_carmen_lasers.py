"""The laser lines of CARMEN that tell their beams themselves: ROBOTLASER1, RAWLASER1 to 4."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from slam.readers.carmen import CarmenConfig, read_carmen
from slam.se2 import SE2
from tests.slam.test_carmen import flaser, odom, written

RANGES = (1.0, 2.0, 3.0, 4.0, 5.0)


def facts(count: int, first: float = -0.2, step: float = 0.1, range_max_m: float = 8.0) -> str:
    """What stands between the name of a line and the number of its ranges."""
    return f"0 {first} {step * (count - 1)} {step} {range_max_m} 0.01 0"


def listed(ranges: Sequence[float]) -> str:
    return " ".join(map(str, [len(ranges), *ranges]))


def stamps(time_s: float) -> str:
    return f"{time_s} nohost {time_s + 0.5}"


def raw_laser(time_s: float, ranges: Sequence[float] = RANGES, number: int = 1) -> str:
    return f"RAWLASER{number} {facts(len(ranges))} {listed(ranges)} 0 {stamps(time_s)}"


def robot_laser(
    time_s: float, pose: SE2, mounting: SE2, remissions: Sequence[float] | None = ()
) -> str:
    """remissions: None: as older logs have it, without them and without the turn axis."""
    sensor = pose @ mounting
    poses = f"{sensor.x} {sensor.y} {sensor.theta} {pose.x} {pose.y} {pose.theta}"
    motion = "0.1 0.2 0.3 0.4" + (" 0.5" if remissions is not None else "")
    middle = f"{listed(remissions)} " if remissions is not None else ""
    return f"ROBOTLASER1 {facts(5)} {listed(RANGES)} {middle}{poses} {motion} {stamps(time_s)}"


@pytest.mark.parametrize("remissions", [(), (7.0, 8.0, 9.0, 10.0, 11.0), None])
def test_robot_laser_tells_its_beams_its_mounting_and_the_odometry(tmp_path, remissions):
    mounting = SE2(0.2, -0.1, 0.3)
    lines = [
        robot_laser(1.0, SE2(1.0, 2.0, 0.5), mounting, remissions),
        odom(1.2, 2.0, 0.5, 1.1),
        robot_laser(2.0, SE2(1.0, 2.0, 0.7), mounting, remissions),
    ]
    log = read_carmen(written(tmp_path, *lines))
    np.testing.assert_allclose(log.T_base_laser.as_array(), mounting.as_array(), atol=1e-12)
    assert (log.scan_count, len(log.records), log.has_odometry) == (2, 3, True)
    first, second = log.measurements()
    assert (first.time_s, second.time_s) == (1.0, 2.0)
    np.testing.assert_allclose(first.scan.angles_rad, [-0.2, -0.1, 0.0, 0.1, 0.2], atol=1e-12)
    np.testing.assert_array_equal(first.scan.ranges_m, RANGES)
    np.testing.assert_allclose(second.motion.as_array(), [0.0, 0.0, 0.2], atol=1e-12)


def test_range_at_the_maximum_that_the_line_announces_is_no_return(tmp_path):
    # of 81.92 m SICK units write 81.83 and above; a lidar of 80 m sees farther than a FLASER may
    for range_max_m, nothing, seen in (
        (81.92, 81.83, 79.9),
        (8.192, 8.183, 8.1),
        (80.0, 80.0, 60.0),
    ):
        ranges = (nothing, seen, -1.0)
        line = f"RAWLASER1 {facts(3, range_max_m=range_max_m)} {listed(ranges)} 0 {stamps(1.0)}"
        found = next(read_carmen(written(tmp_path, line)).measurements()).scan.ranges_m
        np.testing.assert_array_equal(found, [np.inf, seen, np.nan])


def test_sensor_with_1081_beams_sees_270_degrees_either_way(tmp_path):
    new = f"RAWLASER1 5 {-0.75 * math.pi} {1.5 * math.pi} {math.radians(0.25)} 30 0.01 0"
    new += f" {listed([1.0] * 1081)} 0 {stamps(1.0)}"
    for line in (new, flaser([1.0] * 1081, SE2.identity(), 1.0)):
        angles_deg = np.degrees(
            next(read_carmen(written(tmp_path, line)).measurements()).scan.angles_rad
        )
        assert (angles_deg[0], angles_deg[-1]) == pytest.approx((-135.0, 135.0))


def test_raw_scan_lies_between_the_odometry_records_around_its_stamp(tmp_path):
    path = written(
        tmp_path,
        "PARAM robot_frontlaser_offset 0.1 nohost 0",
        raw_laser(0.5),  # before any odometry
        odom(0.0, 0.0, 0.0, 1.0),
        raw_laser(1.25),
        raw_laser(1.75),
        odom(1.0, 0.0, 0.4, 2.0),
        raw_laser(3.0),  # behind the last
    )
    log = read_carmen(path)
    assert log.T_base_laser == SE2(0.1, 0.0, 0.0)
    records = [(r.time_s, r.T_odom_base.theta, r.scan is not None) for r in log.records]
    assert records == [
        (0.5, pytest.approx(0.0), True),
        (1.0, pytest.approx(0.0), False),
        (1.25, pytest.approx(0.1), True),
        (1.75, pytest.approx(0.3), True),
        (2.0, pytest.approx(0.4), False),
        (3.0, pytest.approx(0.4), True),
    ]
    # a quarter of an arc, not of its chord
    arc = SE2.exp(0.25 * SE2(1.0, 0.0, 0.4).log())
    np.testing.assert_allclose(list(log.measurements())[1].motion.as_array(), arc.as_array())


def test_same_scan_written_twice_is_read_once(tmp_path):
    lines = [
        raw_laser(1.0),
        robot_laser(1.0, SE2.identity(), SE2.identity()),
        raw_laser(1.0, number=2),
    ]
    path = written(tmp_path, *lines)
    assert read_carmen(path).scan_count == 1
    rear = read_carmen(path, CarmenConfig(laser="RAWLASER2"))
    assert (rear.scan_count, rear.T_base_laser.theta) == (1, math.pi)


def test_scans_alone_make_motions_of_which_nothing_is_known(tmp_path):
    log = read_carmen(written(tmp_path, *[raw_laser(0.1 * i) for i in range(600)]))
    assert not log.has_odometry
    measurements = list(log.measurements())
    assert len(measurements) == 600
    assert all(m.motion == SE2.identity() for m in measurements)
    assert measurements[1].motion_covariance[0, 0] >= 1.0


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            raw_laser(1.0).replace("5 1.0 2.0", "5 2.0"),
            "RAWLASER1 announces 5 ranges, which its 17 fields do not hold with what else belongs to such a line",
        ),
        (
            "RAWLASER1 0 0.0",
            "RAWLASER1 announces no number of ranges, which its 3 fields do not hold .*",
        ),
        (
            robot_laser(1.0, SE2.identity(), SE2.identity()).rsplit(" ", 5)[0],
            "ROBOTLASER1 announces 5 ranges, which its 24 fields do not hold .*",
        ),
        (
            raw_laser(1.0).replace("0.4 0.1 8.0", "0.4 1e-300 8.0"),
            r"beams 1e-300 rad apart, the first at -0\.2 rad, are no fan; .*",
        ),
        (
            raw_laser(1.0).replace("-0.2 0.4 0.1 8.0", "1e308 0.4 0.1 8.0"),
            r"beams 0\.1 rad apart, the first at 1e\+308 rad, are no fan; .*",
        ),
        (
            raw_laser(1.0).replace("0.4 0.1 8.0", "0.4 0.2 8.0"),
            r"RAWLASER1 has 5 beams, 0\.2 rad apart, in a view of 0\.4 rad: they do not fit",
        ),
        (raw_laser(1.0).replace("-0.2", "nan"), "a pose or a stamp is not finite"),
        (
            robot_laser(1.0, SE2(2e8, 0.0, 0.0), SE2.identity()),
            r"a pose of 2e\+08 0 0; expected metres and radians, none beyond 1e\+08: .*",
        ),
        (raw_laser(1.0).replace("3.0", "three"), "expected a number, found 'three'"),
    ],
)
def test_broken_line_is_named_in_one_line(tmp_path, line, message):
    with pytest.raises(ValueError, match=rf"/a\.clf line 2: {message}$"):
        read_carmen(written(tmp_path, raw_laser(0.0), line))


def test_laser_that_is_not_there_or_not_one_is_refused(tmp_path):
    path = written(tmp_path, raw_laser(1.0))
    with pytest.raises(ValueError, match=r"/a\.clf: no RAWLASER3 line, so no scan to work with$"):
        read_carmen(path, CarmenConfig(laser="RAWLASER3"))
    with pytest.raises(ValueError, match="no laser called 'SONAR'; there are: FLASER, ROBOTLASER1"):
        CarmenConfig(laser="SONAR")


def test_parameter_that_is_no_angle_is_refused(tmp_path):
    lines = ["PARAM robot_frontlaser_offset 0 nohost 0"]
    lines += ["PARAM robot_frontlaser_angular_offset 180.0 nohost 0", raw_laser(1.0)]
    with pytest.raises(ValueError, match="angular_offset 180 is no angle in radians"):
        read_carmen(written(tmp_path, *lines))

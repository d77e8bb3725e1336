"""Bags of other robots: what is read of them, and that they map as well as the same in CARMEN."""

import math
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode

from slam.mapping import Mapper
from slam.measurements import LaserScan
from slam.metrics import absolute_errors
from slam.pose_lookup import PoseLookup
from slam.readers.log import Log, LogChoice
from slam.readers.recognition import read_log
from slam.readers.stamp_order import in_stamp_order
from slam.se2 import SE2
from tests.slam.turtlebot import (
    BEAMS,
    RANGE_MAX_M,
    SCAN_S,
    START_S,
    T_BASE_LASER,
    Frames,
    Recording,
    Sweep,
    write_bag,
    write_carmen,
)


@pytest.fixture(scope="module")
def lap() -> Recording:
    return Recording(duration_s=28.0)


@pytest.fixture(scope="module")
def moment() -> Recording:
    return Recording(duration_s=1.0)


def mapped_ate_m(log: Log, recording: Recording) -> float:
    """RMS [m] of where the sweeps' last beams were fired."""
    mapper = Mapper(log.T_base_laser)
    for measurement in log.measurements():
        mapper.update(measurement)
    slam_map = mapper.finish()
    assert slam_map.verdict.is_good, slam_map.verdict.reasons
    found = PoseLookup(slam_map.trajectory).at(recording.truth.times_s)
    has = np.isfinite(found).all(axis=1)
    assert has.mean() > 0.98
    return absolute_errors(found[has], recording.truth.poses[has]).position_m.rmse


@pytest.mark.slow
def test_bag_of_a_turtlebot_maps_as_well_as_the_same_through_carmen(tmp_path, lap):
    write_carmen(tmp_path / "robot.clf", lap)
    write_bag(tmp_path / "robot", lap)
    by_carmen = mapped_ate_m(read_log(tmp_path / "robot.clf"), lap)
    by_bag = mapped_ate_m(read_log(tmp_path / "robot"), lap)
    # CARMEN has no time for each beam: its sweeps stay bent by up to 0.14 rad
    assert by_bag < 0.25 * by_carmen
    assert by_bag < 0.004


def records_of(log: Log) -> list[tuple]:
    return [
        (r.time_s, *r.T_odom_base.as_array(), None if r.scan is None else r.scan.ranges_m.tolist())
        for r in log.records
    ]


@pytest.fixture(scope="module")
def as_mcap(tmp_path_factory, moment) -> Path:
    path = tmp_path_factory.mktemp("bags") / "robot"
    write_bag(path, moment)
    return path


@pytest.mark.parametrize(
    ("kind", "file"), [("sqlite3", ""), ("sqlite3", "b.db3"), ("ros1", ""), ("mcap", "b.mcap")]
)
def test_every_kind_of_bag_gives_the_same_records(tmp_path, as_mcap, moment, kind, file):
    write_bag(tmp_path / "b", moment, kind)
    log = read_log(tmp_path / "b" / file)
    expected = read_log(as_mcap)
    assert repr(records_of(log)) == repr(records_of(expected))
    assert (len(log.records), log.scan_count) == (len(list(log.records)), len(moment.sweeps))


@pytest.mark.parametrize("compression", [CompressionMode.STORAGE, CompressionMode.MESSAGE])
def test_compressed_bag_gives_the_same_records(tmp_path, as_mcap, moment, compression):
    write_bag(tmp_path / "b", moment, compression=compression)
    assert repr(records_of(read_log(tmp_path / "b"))) == repr(records_of(read_log(as_mcap)))


def test_records_are_in_the_order_of_their_stamps_and_scans_between_their_poses(as_mcap, moment):
    records = list(read_log(as_mcap).records)
    times_s = [record.time_s for record in records]
    assert times_s == sorted(times_s)
    scans = [record for record in records if record.scan is not None]
    assert [r.time_s for r in scans] == pytest.approx([s.end_s for s in moment.sweeps], abs=1e-6)
    for record in scans:
        expected = moment.odometry_at(record.time_s)
        # stamps of 1.7e9 s are right to 0.2 us in double precision
        assert record.T_odom_base.is_near(expected, 1e-6, 1e-6)


def test_clockwise_scan_is_turned_round_with_the_times_of_its_beams(as_mcap, moment):
    scan = next(read_log(as_mcap).measurements()).scan
    sweep = moment.sweeps[0]
    assert scan.beam_times_s is not None
    assert np.diff(scan.beam_times_s) == pytest.approx(-SCAN_S / BEAMS, abs=1e-6)
    assert scan.beam_times_s[-1] == pytest.approx(sweep.start_s, abs=1e-6)
    assert scan.angles_rad[-1] - scan.angles_rad[0] == pytest.approx(math.tau * (1 - 1 / BEAMS))
    was = sweep.ranges_m[::-1]
    assert np.isnan(scan.ranges_m[was == 0.0]).all()
    assert (scan.ranges_m[np.isinf(was)] == np.inf).all()
    is_hit = np.isfinite(was) & (was > 0.0)
    assert scan.ranges_m[is_hit] == pytest.approx(was[is_hit], abs=1e-6)


@pytest.mark.parametrize(
    "frames",
    [Frames(has_odometry=False), Frames(flip=True), Frames(base="base_link")],
)
def test_wheels_by_tf_and_a_laser_upside_down_give_the_same_points(
    tmp_path, as_mcap, moment, frames
):
    write_bag(tmp_path / "b", moment, frames=frames)
    ours, expected = read_log(tmp_path / "b"), read_log(as_mcap)
    pairs = zip(ours.measurements(), expected.measurements(), strict=True)
    for found, right in pairs:
        points = found.scan.points(ours.T_base_laser)
        assert points == pytest.approx(right.scan.points(expected.T_base_laser), abs=1e-6)
        assert found.motion.is_near(right.motion, 1e-6, 1e-6)
    assert ours.T_base_laser.is_near(T_BASE_LASER, 1e-6, 1e-6)


def test_limits_of_the_laser_are_its_misses(tmp_path):
    ranges_m = np.full(BEAMS, 2.0)
    ranges_m[:6] = [0.05, 0.0, -1.0, np.nan, RANGE_MAX_M, 65.5]
    signalling = np.frombuffer(b"\x01\x00\xa0\x7f", dtype=np.float32)
    recording = Recording(duration_s=0.3)
    ranges_m = ranges_m.astype(np.float32)
    ranges_m[3] = signalling[0]
    recording.sweeps = [Sweep(START_S + 0.1, ranges_m)]
    write_bag(tmp_path / "b", recording)
    found = next(read_log(tmp_path / "b").measurements()).scan.ranges_m[::-1]
    assert found[:3].tolist()[0] == -np.inf
    assert np.isnan(found[1:4]).all()
    assert (found[4:6] == np.inf).all()


def test_bag_without_a_time_for_each_beam_is_stamped_by_its_messages(tmp_path, moment):
    write_bag(tmp_path / "b", moment, frames=Frames(time_increment=False))
    measurement = next(read_log(tmp_path / "b").measurements())
    assert measurement.scan.beam_times_s is None
    assert measurement.time_s == pytest.approx(moment.sweeps[0].start_s, abs=1e-6)


def test_several_topics_of_a_type_are_told_and_can_be_chosen(tmp_path, moment):
    write_bag(tmp_path / "b", moment, more=("/back/scan",))
    log = read_log(tmp_path / "b")
    assert log.scan_count == len(moment.sweeps)
    assert log.notes[0] == "of /back/scan, /scan /scan is taken: choose by --scan-topic"
    assert read_log(tmp_path / "b", LogChoice("/back/scan")).scan_count == 1


def test_wheels_may_be_asked_for_by_tf(as_mcap):
    by_tf = read_log(as_mcap, LogChoice(odom_topic="/tf"))
    assert "odometry of the transform of base_footprint in odom" in by_tf.notes[-1]
    assert repr(records_of(by_tf)) == repr(records_of(read_log(as_mcap)))


def test_mounting_that_the_bag_lacks_is_asked_for_and_taken(tmp_path, moment):
    write_bag(tmp_path / "b", moment, frames=Frames(has_static=False))
    said = "/b: no transform from base_footprint to base_scan, .* give --mount X Y HEADING"
    with pytest.raises(ValueError, match=said):
        read_log(tmp_path / "b")
    given = LogChoice(T_base_laser=SE2(0.1, 0.2, 0.3))
    assert read_log(tmp_path / "b", given).T_base_laser == SE2(0.1, 0.2, 0.3)


@pytest.mark.parametrize(
    "choice", [LogChoice("/scn"), LogChoice("/odom"), LogChoice(odom_topic="/scan")]
)
def test_topic_that_is_none_of_its_kind_is_refused_with_those_there_are(as_mcap, choice):
    with pytest.raises(ValueError, match=r"is no topic of .* it has: /odom nav_msgs/Odometry \("):
        read_log(as_mcap, choice)


def test_stamps_are_sorted_unless_a_clock_was_set():
    told = [3.0, 3.4, 3.2, 3.1, 3.5, 9.0, 8.0, 0.5, 0.7, 0.6]
    found = [time_s for time_s, _ in in_stamp_order((t, None) for t in told)]
    assert found == [3.0, 3.1, 3.2, 3.4, 3.5, 8.0, 9.0, 0.5, 0.6, 0.7]


def test_scan_of_a_bag_is_one_as_slam_wants_it(as_mcap):
    scans = [measurement.scan for measurement in read_log(as_mcap).measurements()]
    assert all(isinstance(scan, LaserScan) for scan in scans)
    assert all((np.diff(scan.angles_rad) > 0.0).all() for scan in scans)

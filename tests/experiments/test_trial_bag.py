"""A trial written as a ROS bag, read by others: mcap-ros2-support, evo, and our own reader."""

import json
import math
import os
import subprocess
import sys
import zipfile
from collections import defaultdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from experiments.bag_writer import BagWriter, spatial
from experiments.outputs import checked_bag
from experiments.sources import DRIVE
from experiments.tracking import NAME, run_trial
from experiments.trial_bag import TrialRecorder, grid_of_place
from experiments.trials import TrialConfig, generator
from kitasap_sim.robot import KITASAP2
from slam.measurements import LaserScan
from slam.metrics import absolute_errors
from slam.readers.recognition import read_log
from slam.se2 import SE2

PROGRAMS = Path(sys.executable).parent
# what other implementations of ROS 2 have as the hashes of the types
TYPES = {
    "/clock": ("rosgraph_msgs/msg/Clock", ""),
    "/ground_truth": ("geometry_msgs/msg/PoseStamped", "map"),
    "/map": ("nav_msgs/msg/OccupancyGrid", "map"),
    "/odom": ("nav_msgs/msg/Odometry", "odom"),
    "/points": ("sensor_msgs/msg/PointCloud2", "laser"),
    "/pose_est": ("geometry_msgs/msg/PoseWithCovarianceStamped", "map"),
    "/scan": ("sensor_msgs/msg/LaserScan", "laser"),
    "/tf": ("tf2_msgs/msg/TFMessage", ""),
    "/tf_static": ("tf2_msgs/msg/TFMessage", ""),
    "/wheel_ticks": ("sensor_msgs/msg/JointState", "base_link"),
}
HASHES = {
    "/scan": "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    "/odom": "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "/tf": "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
}


@pytest.fixture(scope="module")
def bag(tmp_path_factory, box_room) -> SimpleNamespace:
    """A drive of two seconds: the folder, what the trial saw, and what mcap-ros2-support reads."""
    config = TrialConfig(
        poses="random", place=box_room, methods=("odometry", "fast"), duration_s=2.0
    )
    recorder = TrialRecorder("fast")
    result = run_trial(config, generator(NAME, 0, 0), recorder)
    folder = tmp_path_factory.mktemp("bag") / "trial_0"
    recorder.write(folder, config, result)
    messages = defaultdict(list)
    with (folder / "trial_0.mcap").open("rb") as file:
        for one in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            messages[one.channel.topic].append(
                SimpleNamespace(
                    channel=one.channel,
                    schema=one.schema,
                    log_time_ns=one.message.log_time,
                    ros_msg=one.decoded_message,
                )
            )
    return SimpleNamespace(folder=folder, seen=recorder._seen, of=messages, recorder=recorder)


def stamp_s(message) -> float:
    content = message.ros_msg
    if message.channel.topic == "/clock":
        stamp = content.clock
    elif message.channel.topic.startswith("/tf"):
        stamp = content.transforms[0].header.stamp
    else:
        stamp = content.header.stamp
    return stamp.sec + 1e-9 * stamp.nanosec


def test_topics_types_frames_and_counts_are_those_promised(bag):
    assert {t: ms[0].schema.name for t, ms in bag.of.items()} == {
        t: k for t, (k, _) in TYPES.items()
    }
    for topic, (_, frame) in TYPES.items():
        if frame:
            assert {m.ros_msg.header.frame_id for m in bag.of[topic]} == {frame}
    scans = len(bag.seen)
    assert scans > 15
    counts = {topic: len(messages) for topic, messages in bag.of.items()}
    assert {counts[t] for t in ("/scan", "/points", "/wheel_ticks", "/ground_truth")} == {scans}
    assert (counts["/clock"], counts["/odom"]) == (scans + 1, scans + 1)
    assert (counts["/map"], counts["/tf_static"]) == (1, 1)
    assert counts["/tf"] == 2 + scans + counts["/pose_est"]


def test_metadata_tells_hashes_and_counts(bag):
    metadata = yaml.safe_load((bag.folder / "metadata.yaml").read_text())
    told = metadata["rosbag2_bagfile_information"]
    assert told["storage_identifier"] == "mcap"
    found = {}
    for topic in told["topics_with_message_count"]:
        facts = topic["topic_metadata"]
        found[facts["name"]] = facts["type_description_hash"]
        assert topic["message_count"] == len(bag.of[facts["name"]])
        is_latched = facts["name"] in ("/tf_static", "/map")
        assert yaml.safe_load(facts["offered_qos_profiles"])[0]["durability"] == 2 - is_latched
    assert {name: found[name] for name in HASHES} == HASHES


def test_stamps_never_go_back(bag):
    for messages in bag.of.values():
        assert (np.diff([m.log_time_ns for m in messages]) >= 0).all()
        assert (np.diff([stamp_s(m) for m in messages]) >= 0.0).all()


def test_scan_is_stamped_by_its_first_ray_and_keeps_rep_117(bag):
    for message, seen in zip(bag.of["/scan"], bag.seen, strict=True):
        scan, frame = message.ros_msg, seen.frame
        times_s = stamp_s(message) + scan.time_increment * np.arange(len(scan.ranges))
        # a beam is fired by the first step of physics, 2 ms, after it is due
        assert times_s == pytest.approx(frame.beam_times_s, abs=0.002)
        angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
        assert angles == pytest.approx(bag.recorder._laser.angles_rad, abs=1e-5)
        assert np.asarray(scan.ranges) == pytest.approx(frame.ranges_m, abs=1e-6, nan_ok=True)
        hit = np.isfinite(scan.ranges)
        assert (np.asarray(scan.ranges)[hit] <= scan.range_max).all()
        assert scan.scan_time == pytest.approx(bag.recorder._laser.period_s)
        assert bag.of["/points"][0].ros_msg.point_step == 16


def test_points_are_those_of_the_scan_with_their_times(bag):
    cloud, scan = bag.of["/points"][3].ros_msg, bag.of["/scan"][3].ros_msg
    points = np.frombuffer(bytes(cloud.data), dtype=np.float32).reshape(-1, 4)
    ranges = np.asarray(scan.ranges)
    beams = np.flatnonzero(np.isfinite(ranges))
    angles = scan.angle_min + scan.angle_increment * beams
    assert points[:, 0] == pytest.approx(ranges[beams] * np.cos(angles), abs=1e-5)
    assert points[:, 1] == pytest.approx(ranges[beams] * np.sin(angles), abs=1e-5)
    assert points[:, 3] == pytest.approx(scan.time_increment * beams, abs=1e-6)


def planar(transform) -> SE2:
    at, turn = transform.translation, transform.rotation
    return SE2(at.x, at.y, 2.0 * math.atan2(turn.z, turn.w))


def test_frames_lead_from_the_map_to_the_laser(bag):
    static = {t.child_frame_id: t for t in bag.of["/tf_static"][0].ros_msg.transforms}
    assert static["base_link"].header.frame_id == "base_footprint"
    assert static["base_link"].transform.translation.z == KITASAP2.axle_height_m
    assert static["laser"].header.frame_id == "base_link"
    mount = bag.recorder._laser.mount_m
    assert static["laser"].transform.translation.x == mount[0]
    assert static["laser"].transform.translation.z + KITASAP2.axle_height_m == mount[2]
    moving = [t for message in bag.of["/tf"] for t in message.ros_msg.transforms]
    by_time = defaultdict(dict)
    for one in moving:
        stamp = one.header.stamp
        by_time[stamp.sec + 1e-9 * stamp.nanosec][one.header.frame_id, one.child_frame_id] = planar(
            one.transform
        )
    for message in bag.of["/pose_est"]:
        chain = by_time[stamp_s(message)]
        found = chain["map", "odom"] @ chain["odom", "base_footprint"]
        pose = message.ros_msg.pose.pose
        expected = SE2(
            pose.position.x,
            pose.position.y,
            2.0 * math.atan2(pose.orientation.z, pose.orientation.w),
        )
        assert found.is_near(expected, 1e-9, 1e-9)


def test_wheels_are_the_encoders_in_radians(bag):
    for message, seen in zip(bag.of["/wheel_ticks"], bag.seen, strict=True):
        assert list(message.ros_msg.name) == ["left_wheel", "right_wheel"]
        ticks = np.asarray(message.ros_msg.position) * DRIVE.ticks_per_turn / math.tau
        assert ticks == pytest.approx(seen.frame.wheel_ticks, abs=1e-6)


def test_covariance_is_turned_into_the_frame_of_the_pose():
    ahead = np.diag([0.04, 0.0, 0.01])
    full = spatial(SE2(1.0, 2.0, math.pi / 2), ahead)
    assert np.diag(full)[[0, 1, 5]] == pytest.approx([0.0, 0.04, 0.01], abs=1e-12)
    assert (np.diag(full)[2:5] > 0.0).all()


def test_map_is_free_where_the_robot_drives(bag):
    grid = bag.of["/map"][0].ros_msg
    cells = np.asarray(grid.data, dtype=np.int8).reshape(grid.info.height, grid.info.width)
    assert set(np.unique(cells)) == {-1, 0, 100}
    for message in bag.of["/ground_truth"]:
        at, origin = message.ros_msg.pose.position, grid.info.origin.position
        row = int((at.y - origin.y) / grid.info.resolution)
        column = int((at.x - origin.x) / grid.info.resolution)
        assert cells[row, column] == 0


def test_map_of_a_hall_has_no_more_cells_than_a_viewer_takes():
    corners = 400.0 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    walls = SimpleNamespace(segments=np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    grid = grid_of_place(SimpleNamespace(segment_map=walls, is_made=True))
    assert max(grid.cells.shape) < 3010
    assert grid.value_at(corners).tolist() == [100] * 4


def test_who_comes_late_still_gets_the_map_and_the_mounting(bag):
    """RViz and slam_toolbox ask for /map and /tf_static as transient local, which what is volatile
    does not serve."""
    kept = {"depth": 1, "durability": 1, "history": 1, "reliability": 1}
    live = {"depth": 10, "durability": 2, "history": 1, "reliability": 1}
    for topic, messages in bag.of.items():
        (profile,) = yaml.safe_load(messages[0].channel.metadata["offered_qos_profiles"])
        expected = kept if topic in ("/map", "/tf_static") else live
        assert {key: profile[key] for key in expected} == expected, topic


@pytest.mark.slow
@pytest.mark.skipif(not (PROGRAMS / "evo_ape").exists(), reason="evo is not installed")
def test_evo_finds_the_same_error_in_the_bag(bag, tmp_path):
    result = tmp_path / "ape.zip"
    command = [str(PROGRAMS / "evo_ape"), "bag2", str(bag.folder), "/ground_truth", "/pose_est"]
    subprocess.run(
        [*command, "--align", "--save_results", str(result)],
        check=True, capture_output=True, env=os.environ | {"HOME": str(tmp_path)},
    )  # fmt: skip
    with zipfile.ZipFile(result) as archive:
        theirs = json.loads(archive.read("stats.json"))
    named = [seen for seen in bag.seen if seen.outcome is not None]
    found = np.array([seen.outcome.T_map_base.as_array() for seen in named])
    ours = absolute_errors(found, np.array([seen.true_pose for seen in named]))
    for key in ("rmse", "mean", "median", "max"):
        assert getattr(ours.position_m, key) == pytest.approx(theirs[key], abs=1e-6)


def test_our_own_reader_finds_what_was_written(bag):
    log = read_log(bag.folder)
    mount = bag.recorder._laser.mount_m
    assert log.T_base_laser.is_near(SE2(mount[0], mount[1], 0.0), 1e-9, 1e-9)
    measurements = list(log.measurements())
    assert len(measurements) == len(bag.seen)
    for measurement, seen in zip(measurements, bag.seen, strict=True):
        assert measurement.time_s == pytest.approx(seen.frame.beam_times_s[-1], abs=0.002)
        found, told = measurement.scan.ranges_m, seen.frame.ranges_m
        assert found == pytest.approx(told, abs=1e-6, nan_ok=True)


def test_bag_is_not_written_over(tmp_path):
    (tmp_path / "trial_3").mkdir()
    with pytest.raises(ValueError, match="is there already, and is not written over"):
        checked_bag(tmp_path / "trial_3")
    assert checked_bag(tmp_path / "trial_4") == tmp_path / "trial_4"


def written(path: Path, scan: LaserScan) -> LaserScan:
    """A scan written and read again."""
    with BagWriter(path) as bag:
        bag.transforms("/tf_static", 0.0, [("base_footprint", "laser", SE2.identity(), 0.1)])
        bag.odometry(0.0, SE2.identity(), np.zeros((3, 3)), np.zeros(3))
        bag.scan(1.0, scan, (0.02, 8.0))
    return next(read_log(path).measurements()).scan


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_scan_comes_back_whichever_way_the_laser_turns(tmp_path, sign):
    times_s = 0.9 + 0.001 * np.arange(50)
    ranges_m = np.where(np.arange(50) % 7, 2.5, [np.inf, -np.inf] * 25)
    angles_rad = np.linspace(-1.0, 1.0, 50)
    scan = LaserScan(float(times_s.max()), angles_rad, ranges_m, times_s[:: int(sign)])
    found = written(tmp_path / "one.mcap", scan)
    assert [path.name for path in tmp_path.iterdir()] == ["one.mcap"]
    assert found.angles_rad == pytest.approx(angles_rad, abs=1e-6)
    assert found.ranges_m == pytest.approx(ranges_m)
    assert found.beam_times_s == pytest.approx(scan.beam_times_s, abs=1e-6)


def test_beams_that_are_not_fired_in_turn_have_no_time(tmp_path):
    times_s = 0.9 + 0.001 * np.arange(50) + 0.05 * (np.arange(50) % 2)
    scan = LaserScan(float(times_s.max()), np.linspace(-1.0, 1.0, 50), np.ones(50), times_s)
    found = written(tmp_path / "one.mcap", scan)
    assert (found.beam_times_s, found.time_s) == (None, pytest.approx(0.9))


def test_bag_whose_writing_was_broken_off_is_not_there(tmp_path):
    broken = LaserScan(0.0, np.zeros(0), np.zeros(0))
    with pytest.raises(IndexError), BagWriter(tmp_path / "b") as bag:
        bag.scan(0.0, broken, (0.02, 8.0))
    assert list(tmp_path.iterdir()) == []

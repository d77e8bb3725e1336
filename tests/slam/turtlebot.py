"""A drive recorded as a TurtleBot would: as a ROS bag by rosbags, and the same as a CARMEN log.

The laser looks backward, turns clockwise, all around, and says inf or 0 where nothing came back.
Odometry comes at 30 Hz, scans at 5 Hz by their first beam, messages up to 0.3 s late.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from slam.se2 import SE2
from slam.trajectory import Trajectory
from tests.slam.synthetic import ROOM_SEGMENTS

BEAMS, SCAN_S, ODOMETRY_S = 360, 0.2, 1.0 / 30.0
STEP_RAD = -math.tau / BEAMS
"""Clockwise."""
RANGE_MIN_M, RANGE_MAX_M = 0.12, 3.5
T_BASE_LASER = SE2(-0.03, 0.01, math.pi)
SIGMA_M = 0.008
START_S = 1.7e9
_ROUND_S = 25.0
_SLIP = np.array([1.03, 1.0, 1.04])


@dataclass(frozen=True)
class Sweep:
    """One scan: when its first beam was fired, and its ranges (N,) as the driver writes them."""

    start_s: float
    ranges_m: np.ndarray

    @property
    def end_s(self) -> float:
        return self.start_s + SCAN_S * (BEAMS - 1) / BEAMS


@dataclass
class Recording:
    """What was recorded. odometry: stamps and poses; true: the pose at each sweep's last beam."""

    duration_s: float = 30.0
    seed: int = 3
    segments: np.ndarray = field(default_factory=lambda: ROOM_SEGMENTS)

    @staticmethod
    def true(time_s: float) -> SE2:
        """Round and round, faster on the long sides."""
        at = math.tau * time_s / _ROUND_S
        heading = math.atan2(0.8 * math.cos(at), -1.5 * math.sin(at))
        return SE2(2.7 + 1.5 * math.cos(at), 1.8 + 0.8 * math.sin(at), heading)

    @cached_property
    def odometry(self) -> list[tuple[float, SE2]]:
        rng = np.random.default_rng(self.seed)
        T, before, found = SE2.identity(), self.true(0.0), []
        for time_s in np.arange(0.0, self.duration_s + 0.5, ODOMETRY_S):
            pose = self.true(time_s)
            noise = rng.normal(0.0, (0.0004, 0.0002, 0.0008))
            T = T @ SE2.exp((before.inverse() @ pose).log() * _SLIP + noise)
            found.append((START_S + float(time_s), T))
            before = pose
        return found

    @cached_property
    def sweeps(self) -> list[Sweep]:
        rng = np.random.default_rng(self.seed + 1)
        found = []
        for start_s in np.arange(0.05, self.duration_s, SCAN_S):
            times_s = start_s + SCAN_S * np.arange(BEAMS) / BEAMS
            ranges_m = self._cast(times_s) + rng.normal(0.0, SIGMA_M, BEAMS)
            ranges_m[rng.random(BEAMS) < 0.02] = 0.0
            ranges_m[ranges_m > RANGE_MAX_M] = np.inf
            found.append(Sweep(START_S + float(start_s), ranges_m))
        return found

    def _cast(self, times_s: np.ndarray) -> np.ndarray:
        """(N,) true ranges, each from where the laser was when its beam was fired."""
        lasers = [self.true(time_s) @ T_BASE_LASER for time_s in times_s]
        at = np.array([[one.x, one.y] for one in lasers])
        angles = np.array([one.theta for one in lasers]) + STEP_RAD * np.arange(BEAMS)
        beams = np.column_stack([np.cos(angles), np.sin(angles)])[:, None]
        start, edge = (
            self.segments[None, :, 0],
            self.segments[None, :, 1] - self.segments[None, :, 0],
        )
        off = start - at[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            below = beams[..., 0] * edge[..., 1] - beams[..., 1] * edge[..., 0]
            away = (off[..., 0] * edge[..., 1] - off[..., 1] * edge[..., 0]) / below
            along = (off[..., 0] * beams[..., 1] - off[..., 1] * beams[..., 0]) / below
        hit = (away > 0.0) & (along >= 0.0) & (along <= 1.0)
        return np.where(hit, away, np.inf).min(axis=1)

    @cached_property
    def truth(self) -> Trajectory:
        """At the last beam of each sweep."""
        times_s = np.array([sweep.end_s for sweep in self.sweeps])
        return Trajectory(times_s, np.array([self.true(t - START_S).as_array() for t in times_s]))

    def odometry_at(self, time_s: float) -> SE2:
        times_s = [t for t, _ in self.odometry]
        after = int(np.clip(np.searchsorted(times_s, time_s), 1, len(times_s) - 1))
        (start_s, T_start), (end_s, T_end) = self.odometry[after - 1 : after + 1]
        share = (time_s - start_s) / (end_s - start_s)
        return T_start @ SE2.exp(share * (T_start.inverse() @ T_end).log())


def write_carmen(path: Path, recording: Recording) -> None:
    """The same drive as ROBOTLASER1 and ODOM lines, in the order of their stamps."""
    lines = []
    for time_s, T in recording.odometry:
        lines.append((time_s, f"ODOM {T.x} {T.y} {T.theta} 0 0 0 {time_s} host {time_s}"))
    # counter-clockwise, from the beam that was fired last
    for sweep in recording.sweeps:
        T = recording.odometry_at(sweep.end_s)
        T_laser = T @ T_BASE_LASER
        ranges = np.where(np.isinf(sweep.ranges_m), 81.0, sweep.ranges_m)[::-1]
        first_rad = STEP_RAD * (BEAMS - 1)
        lines.append(
            (
                sweep.end_s,
                f"ROBOTLASER1 0 {first_rad} {math.tau} {-STEP_RAD} {RANGE_MAX_M} 0.01 0 {BEAMS} "
                + " ".join(f"{value:.4f}" for value in ranges)
                + f" 0 {T_laser.x} {T_laser.y} {T_laser.theta} {T.x} {T.y} {T.theta} 0 0 0 0 0"
                f" {sweep.end_s} host {sweep.end_s}",
            )
        )
    path.write_text("\n".join(line for _, line in sorted(lines)) + "\n")


@dataclass
class Frames:
    """How a bag tells where things are. has_odometry: a topic, else the transforms alone do.

    flip: the laser hangs upside down (and what it counts clockwise is counter-clockwise then).
    """

    has_odometry: bool = True
    flip: bool = False
    has_static: bool = True
    time_increment: bool = True
    base: str = "base_footprint"
    laser: str = "base_scan"


def write_bag(
    path: Path,
    recording: Recording,
    kind: str = "mcap",
    frames: Frames | None = None,
    more: Sequence[str] = (),
    compression: CompressionMode = CompressionMode.NONE,
) -> None:
    """A bag of kind mcap, sqlite3 or ros1. more: LaserScan topics beside /scan, with one scan each."""
    messages = _Messages(recording, frames or Frames(), is_ros1=kind == "ros1")
    late = np.random.default_rng(recording.seed + 2)
    listed = [
        (time_s + late.uniform(0.0, 0.3), topic, content)
        for time_s, topic, content in messages.all(more)
    ]
    listed.sort(key=lambda one: one[0])
    if kind == "ros1":
        _write_ros1(path, messages, listed)
        return
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        topics = {}
        for logged_s, topic, content in listed:
            if topic not in topics:
                topics[topic] = writer.add_connection(
                    topic, content.__msgtype__, typestore=messages.store
                )
            raw = messages.store.serialize_cdr(content, content.__msgtype__)
            writer.write(topics[topic], round(logged_s * 1e9), raw)


def _write_ros1(path: Path, messages: _Messages, listed: list) -> None:
    with rosbag1.Writer(path) as writer:
        topics = {}
        for logged_s, topic, content in listed:
            if topic not in topics:
                topics[topic] = writer.add_connection(
                    topic, content.__msgtype__, typestore=messages.store
                )
            raw = messages.store.serialize_ros1(content, content.__msgtype__)
            writer.write(topics[topic], round(logged_s * 1e9), raw)


class _Messages:
    def __init__(self, recording: Recording, frames: Frames, is_ros1: bool) -> None:
        self.recording, self.frames, self.is_ros1 = recording, frames, is_ros1
        self.store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
        if is_ros1:
            fields = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(fields, "tf2_msgs/msg/TFMessage"))

    def all(self, more: Sequence[str]) -> list:
        found = []
        if self.frames.has_static:
            found.append((START_S, "/tf_static", self.static()))
        for time_s, T in self.recording.odometry:
            if self.frames.has_odometry:
                found.append((time_s, "/odom", self.odometry(time_s, T)))
            found.append((time_s, "/tf", self.tf([(time_s, "odom", self.frames.base, T)])))
        for sweep in self.recording.sweeps:
            found.append((sweep.end_s, "/scan", self.scan(sweep)))
        found += [(START_S, topic, self.scan(self.recording.sweeps[0])) for topic in more]
        return found

    def make(self, name: str, **fields):
        return self.store.types[name](**fields)

    def header(self, time_s: float, frame: str):
        sec = int(time_s)
        stamp = self.make(
            "builtin_interfaces/msg/Time", sec=sec, nanosec=round((time_s - sec) * 1e9)
        )
        more = {"seq": 0} if self.is_ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **more)

    def tf(self, edges: list, quaternions: dict | None = None):
        transforms = []
        for time_s, parent, child, T in edges:
            q = (quaternions or {}).get(
                child, (0.0, 0.0, math.sin(T.theta / 2), math.cos(T.theta / 2))
            )
            transforms.append(
                self.make(
                    "geometry_msgs/msg/TransformStamped",
                    header=self.header(time_s, parent),
                    child_frame_id=child,
                    transform=self.make(
                        "geometry_msgs/msg/Transform",
                        translation=self.make("geometry_msgs/msg/Vector3", x=T.x, y=T.y, z=0.1),
                        rotation=self.quaternion(q),
                    ),
                )
            )
        return self.make("tf2_msgs/msg/TFMessage", transforms=transforms)

    def static(self):
        # half a turn about z; upside down, half a turn about x after it
        flipped = {self.frames.laser: (0.0, 1.0, 0.0, 0.0)} if self.frames.flip else {}
        return self.tf(
            [
                (START_S, "base_footprint", "base_link", SE2(0.0, 0.0, 0.0)),
                (START_S, "base_link", self.frames.laser, T_BASE_LASER),
                (START_S, "base_link", "imu_link", SE2(0.0, 0.0, 0.3)),
            ],
            flipped,
        )

    def quaternion(self, q):
        x, y, z, w = q
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def odometry(self, time_s: float, T: SE2):
        zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        pose = self.make(
            "geometry_msgs/msg/Pose",
            position=self.make("geometry_msgs/msg/Point", x=T.x, y=T.y, z=0.0),
            orientation=self.quaternion((0.0, 0.0, math.sin(T.theta / 2), math.cos(T.theta / 2))),
        )
        unknown = np.zeros(36)
        return self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(time_s, "odom"),
            child_frame_id=self.frames.base,
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
            twist=self.make(
                "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown
            ),
        )

    def scan(self, sweep: Sweep, **other):
        step_rad = -STEP_RAD if self.frames.flip else STEP_RAD
        fields = {
            "header": self.header(sweep.start_s, self.frames.laser),
            "angle_min": 0.0,
            "angle_max": step_rad * (BEAMS - 1),
            "angle_increment": step_rad,
            "time_increment": SCAN_S / BEAMS if self.frames.time_increment else 0.0,
            "scan_time": SCAN_S,
            "range_min": RANGE_MIN_M,
            "range_max": RANGE_MAX_M,
            "ranges": sweep.ranges_m.astype(np.float32),
            "intensities": np.zeros(0, dtype=np.float32),
        }
        return self.make("sensor_msgs/msg/LaserScan", **(fields | other))

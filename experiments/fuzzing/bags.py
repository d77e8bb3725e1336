"""Targets that read ROS bags: small valid ones of each storage, a few scans with odometry."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from experiments.fuzzing.files import read_log_wholly
from experiments.fuzzing.targets import Reading

_BEAMS, _SCANS, _START_S = 8, 4, 1_700_000_000


def ros1(folder: Path) -> tuple[list[bytes], Reading]:
    """Of ROS 1, as a file."""
    path = folder / "seed.bag"
    path.unlink(missing_ok=True)
    messages = _Messages(is_ros1=True)
    with rosbag1.Writer(path) as writer:
        messages.write(writer, messages.store.serialize_ros1)
    return [path.read_bytes()], read_log_wholly("log.bag")


def mcap(folder: Path) -> tuple[list[bytes], Reading]:
    """Of ROS 2, MCAP files with and without compression."""
    modes = (CompressionMode.NONE, CompressionMode.STORAGE)
    return [_ros2(folder, StoragePlugin.MCAP, mode) for mode in modes], read_log_wholly("log.mcap")


def sqlite(folder: Path) -> tuple[list[bytes], Reading]:
    """Of ROS 2, SQLite files."""
    return [_ros2(folder, StoragePlugin.SQLITE3, CompressionMode.NONE)], read_log_wholly("log.db3")


def _ros2(folder: Path, plugin: StoragePlugin, mode: CompressionMode) -> bytes:
    path = folder / "seed"
    shutil.rmtree(path, ignore_errors=True)
    writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    messages = _Messages(is_ros1=False)
    with writer:
        messages.write(writer, messages.store.serialize_cdr)
    (written,) = (one for one in path.iterdir() if one.suffix != ".yaml")
    return written.read_bytes()


class _Messages:
    """What such a robot says."""

    def __init__(self, *, is_ros1: bool) -> None:
        self._is_ros1 = is_ros1
        self.store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
        if is_ros1:
            fields = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(fields, "tf2_msgs/msg/TFMessage"))

    def write(self, writer: Any, serialized: Any) -> None:
        """All of it, in order."""
        topics: dict[str, Any] = {}
        for time_s, topic, content in self._all():
            kind = content.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=self.store)
            writer.write(topics[topic], round(time_s * 1e9), serialized(content, kind))

    def _all(self) -> Iterator[tuple[float, str, Any]]:
        yield _START_S, "/tf_static", self._transform()
        for number in range(_SCANS):
            time_s = _START_S + 0.1 * number
            yield time_s, "/odom", self._odometry(time_s, 0.01 * number)
            yield time_s, "/scan", self._scan(time_s)

    def _make(self, name: str, **fields: Any) -> Any:
        return self.store.types[name](**fields)

    def _header(self, time_s: float, frame: str) -> Any:
        more = {"seq": 0} if self._is_ros1 else {}
        nanosec = round(math.modf(time_s)[0] * 1e9)
        stamp = self._make("builtin_interfaces/msg/Time", sec=int(time_s), nanosec=nanosec)
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **more)

    def _transform(self) -> Any:
        transform = self._make(
            "geometry_msgs/msg/Transform",
            translation=self._make("geometry_msgs/msg/Vector3", x=0.1, y=0.0, z=0.2),
            rotation=self._upright(),
        )
        stamped = self._make(
            "geometry_msgs/msg/TransformStamped", header=self._header(_START_S, "base_link"),
            child_frame_id="laser", transform=transform,
        )  # fmt: skip
        return self._make("tf2_msgs/msg/TFMessage", transforms=[stamped])

    def _upright(self) -> Any:
        return self._make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)

    def _odometry(self, time_s: float, x_m: float) -> Any:
        zero = self._make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        point = self._make("geometry_msgs/msg/Point", x=x_m, y=0.0, z=0.0)
        pose = self._make("geometry_msgs/msg/Pose", position=point, orientation=self._upright())
        twist = self._make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        unknown = np.zeros(36)
        return self._make(
            "nav_msgs/msg/Odometry", header=self._header(time_s, "odom"), child_frame_id="base_link",
            pose=self._make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
            twist=self._make(
                "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown
            ),
        )  # fmt: skip

    def _scan(self, time_s: float) -> Any:
        return self._make(
            "sensor_msgs/msg/LaserScan", header=self._header(time_s, "laser"), angle_min=-1.0,
            angle_max=1.1, angle_increment=0.3, time_increment=0.001, scan_time=0.1,
            range_min=0.1, range_max=10.0,
            ranges=np.linspace(1.0, 2.0, _BEAMS, dtype=np.float32),
            intensities=np.zeros(0, dtype=np.float32),
        )  # fmt: skip

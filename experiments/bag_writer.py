"""ROS 2 bags in MCAP, written without ROS by the library rosbags.

Frames by REP-105: map -> odom -> base_footprint -> base_link -> laser, units and axes by REP-103,
ranges by REP-117. Stamps are seconds of the recording's own clock.
"""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from slam.arrays import FloatArray
from slam.measurements import LaserScan
from slam.occupancy_grid import OccupancyGrid
from slam.se2 import SE2

MAP, ODOM, FOOTPRINT, BASE, LASER = "map", "odom", "base_footprint", "base_link", "laser"
_LATCHED = ("/tf_static", "/map")
_FLAT = 1e-9
"""Variance of height, roll and pitch [m2, rad2]: the floor is flat; 0 has no inverse."""
_FOREVER = QosTime(9223372036, 854775807)


class BagWriter:
    """A bag under way; it appears whole with the end of its context, or not at all.

    path: a folder, with metadata.yaml as ROS 2 writes it, or, if it ends in .mcap, that file alone.
    Messages are to be written in the order of their logged_s [s]. Raises OSError if it cannot write.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._unfinished = path.with_name(f".{path.name}.{os.getpid()}")
        self._folder = self._unfinished / path.stem
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._topics: dict[str, Connection] = {}

    def __enter__(self) -> BagWriter:
        self._unfinished.mkdir(parents=True)
        # the metadata of ROS 2 Iron, which all since read
        self._writer = Writer(self._folder, version=8, storage_plugin=StoragePlugin.MCAP)
        self._writer.open()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is not None:
                self._writer.abort()
                return
            self._writer.close()
            written = self._folder
            if self._path.suffix == ".mcap":
                written = self._folder / f"{self._folder.name}.mcap"
            written.replace(self._path)
        finally:
            shutil.rmtree(self._unfinished)

    def scan(
        self,
        logged_s: float,
        scan: LaserScan,
        limits_m: tuple[float, float],
        period_s: float = 0.0,
    ) -> None:
        """/scan and /points, stamped by the first ray. limits_m: least and greatest range [m];
        period_s: from one scan to the next, 0 where it is not known.

        The points are those that came back, each with its time [s] since that stamp.
        """
        start_s, interval_s, is_clockwise = _sweep(scan)
        order = slice(None, None, -1) if is_clockwise else slice(None)
        angles_rad, ranges_m = scan.angles_rad[order], scan.ranges_m[order]
        step_rad = float(np.diff(angles_rad).mean()) if len(angles_rad) > 1 else 0.0
        header = self._header(start_s, LASER)
        message = self._make(
            "sensor_msgs/msg/LaserScan",
            header=header,
            angle_min=float(angles_rad[0]),
            angle_max=float(angles_rad[-1]),
            angle_increment=step_rad,
            time_increment=interval_s,
            scan_time=period_s,
            range_min=limits_m[0],
            range_max=limits_m[1],
            ranges=ranges_m.astype(np.float32),
            intensities=np.zeros(0, dtype=np.float32),
        )
        self._write("/scan", logged_s, message)
        hit = np.isfinite(ranges_m)
        xy = ranges_m[hit, None] * np.column_stack([np.cos(angles_rad), np.sin(angles_rad)])[hit]
        times_s = interval_s * np.arange(len(ranges_m))[hit]
        points = np.column_stack([xy, np.zeros(len(xy)), times_s]).astype(np.float32)
        self._write("/points", logged_s, self._cloud(header, points))

    def odometry(
        self, time_s: float, T_odom_base: SE2, covariance: FloatArray, velocity: FloatArray
    ) -> None:
        """/odom, and the same on /tf. covariance: (3, 3) of the pose's tangent, base frame; velocity:
        (3,) of the base, base frame [m/s, rad/s]."""
        vx, vy, omega = (float(value) for value in velocity)
        message = self._make(
            "nav_msgs/msg/Odometry",
            header=self._header(time_s, ODOM),
            child_frame_id=FOOTPRINT,
            pose=self._pose_with_covariance(T_odom_base, covariance),
            twist=self._make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=self._make(
                    "geometry_msgs/msg/Twist",
                    linear=self._make("geometry_msgs/msg/Vector3", x=vx, y=vy, z=0.0),
                    angular=self._make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=omega),
                ),
                covariance=np.zeros(36),  # not known
            ),
        )
        self._write("/odom", time_s, message)
        self.transforms("/tf", time_s, [(ODOM, FOOTPRINT, T_odom_base, 0.0)])

    def transforms(
        self, topic: str, time_s: float, edges: Sequence[tuple[str, str, SE2, float]]
    ) -> None:
        """Frames in their parents, on /tf or /tf_static: parent, child, pose and height [m] of each."""
        transforms = [
            self._make(
                "geometry_msgs/msg/TransformStamped",
                header=self._header(time_s, parent),
                child_frame_id=child,
                transform=self._make(
                    "geometry_msgs/msg/Transform",
                    translation=self._make("geometry_msgs/msg/Vector3", x=T.x, y=T.y, z=z),
                    rotation=self._quaternion(T.theta),
                ),
            )
            for parent, child, T, z in edges
        ]
        self._write(topic, time_s, self._make("tf2_msgs/msg/TFMessage", transforms=transforms))

    def wheels(
        self, time_s: float, names: Sequence[str], angles_rad: FloatArray, speeds_radps: FloatArray
    ) -> None:
        """/wheel_ticks: how far the encoders turned since some start, and how fast they do."""
        message = self._make(
            "sensor_msgs/msg/JointState",
            header=self._header(time_s, BASE),
            name=list(names),
            position=np.asarray(angles_rad, dtype=np.float64),
            velocity=np.asarray(speeds_radps, dtype=np.float64),
            effort=np.zeros(0),
        )
        self._write("/wheel_ticks", time_s, message)

    def pose_estimate(self, time_s: float, T_map_base: SE2, covariance: FloatArray | None) -> None:
        """/pose_est. covariance: (3, 3) of its tangent, base frame; None: nothing is claimed."""
        message = self._make(
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            header=self._header(time_s, MAP),
            pose=self._pose_with_covariance(T_map_base, covariance),
        )
        self._write("/pose_est", time_s, message)

    def ground_truth(self, time_s: float, T_map_base: SE2) -> None:
        """/ground_truth."""
        message = self._make(
            "geometry_msgs/msg/PoseStamped",
            header=self._header(time_s, MAP),
            pose=self._pose(T_map_base),
        )
        self._write("/ground_truth", time_s, message)

    def map(self, time_s: float, grid: OccupancyGrid) -> None:
        """/map, as map_server publishes it."""
        rows, columns = grid.cells.shape
        stamp = self._stamp(time_s)
        message = self._make(
            "nav_msgs/msg/OccupancyGrid",
            header=self._header(time_s, MAP),
            info=self._make(
                "nav_msgs/msg/MapMetaData",
                map_load_time=stamp,
                resolution=grid.resolution_m,
                width=columns,
                height=rows,
                origin=self._pose(grid.T_map_grid),
            ),
            data=grid.cells.ravel(),
        )
        self._write("/map", time_s, message)

    def clock(self, time_s: float) -> None:
        """/clock."""
        message = self._make("rosgraph_msgs/msg/Clock", clock=self._stamp(time_s))
        self._write("/clock", time_s, message)

    def _write(self, topic: str, logged_s: float, message: Any) -> None:
        if topic not in self._topics:
            self._topics[topic] = self._writer.add_connection(
                topic,
                message.__msgtype__,
                typestore=self._store,
                offered_qos_profiles=[_qos(topic in _LATCHED)],
            )
        raw = self._store.serialize_cdr(message, message.__msgtype__)
        self._writer.write(self._topics[topic], _nanoseconds(logged_s), raw)

    def _make(self, type_name: str, /, **fields: Any) -> Any:
        return self._store.types[type_name](**fields)

    def _stamp(self, time_s: float) -> Any:
        sec, nanosec = divmod(_nanoseconds(time_s), 10**9)
        return self._make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

    def _header(self, time_s: float, frame: str) -> Any:
        return self._make("std_msgs/msg/Header", stamp=self._stamp(time_s), frame_id=frame)

    def _quaternion(self, theta_rad: float) -> Any:
        z, w = math.sin(theta_rad / 2.0), math.cos(theta_rad / 2.0)
        return self._make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=z, w=w)

    def _pose(self, T: SE2) -> Any:
        return self._make(
            "geometry_msgs/msg/Pose",
            position=self._make("geometry_msgs/msg/Point", x=T.x, y=T.y, z=0.0),
            orientation=self._quaternion(T.theta),
        )

    def _pose_with_covariance(self, T: SE2, covariance: FloatArray | None) -> Any:
        return self._make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=self._pose(T),
            covariance=np.zeros(36) if covariance is None else spatial(T, covariance).ravel(),
        )

    def _cloud(self, header: Any, points: np.ndarray) -> Any:
        fields = [
            self._make("sensor_msgs/msg/PointField", name=name, offset=4 * k, datatype=7, count=1)
            for k, name in enumerate(("x", "y", "z", "time"))
        ]
        return self._make(
            "sensor_msgs/msg/PointCloud2",
            header=header,
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=16,
            row_step=16 * len(points),
            data=points.view(np.uint8).ravel() if len(points) else np.zeros(0, dtype=np.uint8),
            is_dense=True,
        )


def spatial(T: SE2, covariance: FloatArray) -> FloatArray:
    """(6, 6) covariance as ROS wants it, x y z and turns about these in the frame of the pose T.

    covariance: (3, 3) of the tangent (x, y, theta) in the base frame.
    """
    c, s = math.cos(T.theta), math.sin(T.theta)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    full = np.diag([0.0, 0.0, _FLAT, _FLAT, _FLAT, 0.0])
    full[np.ix_([0, 1, 5], [0, 1, 5])] = turn @ covariance @ turn.T
    return full


def _sweep(scan: LaserScan) -> tuple[float, float, bool]:
    """When the first ray was fired [s], how long from one to the next [s], and whether they go
    clockwise. 0 from one to the next where they were not fired in turn, or when is not known."""
    times_s, count = scan.beam_times_s, len(scan.ranges_m)
    if times_s is None or count < 2:
        return scan.time_s, 0.0, False
    interval_s, _ = np.polyfit(np.arange(count), times_s - times_s[0], 1)
    if interval_s < 0.0:
        times_s = times_s[::-1]
    in_turn_s = abs(interval_s) * np.arange(count)
    start_s = float(np.mean(times_s - in_turn_s))
    # a simulated beam is fired by the first step of physics after it is due
    if np.abs(times_s - start_s - in_turn_s).max() > _LATEST_BEAM_S:
        return float(times_s.min()), 0.0, False
    return start_s, float(abs(interval_s)), bool(interval_s < 0.0)


_LATEST_BEAM_S = 0.003
"""Chosen: by which a beam may be off its turn; a step of physics is 2 ms."""


def _nanoseconds(time_s: float) -> int:
    return max(round(time_s * 1e9), 0)


def _qos(is_latched: bool) -> Qos:
    return Qos(
        QosHistory.KEEP_LAST,
        1 if is_latched else 10,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if is_latched else QosDurability.VOLATILE,
        _FOREVER,
        _FOREVER,
        QosLiveliness.AUTOMATIC,
        _FOREVER,
        False,
    )

"""Poses of a topic of a ROS bag."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from slam.measurements import check_stamped
from slam.readers.bag_files import ODOMETRY, POSE, POSE_WITH_COVARIANCE, Bag
from slam.readers.transforms import planar
from slam.trajectory import Trajectory

_TYPES = (ODOMETRY, POSE, POSE_WITH_COVARIANCE)


def read_bag_trajectory(path: str | Path, topic: str) -> Trajectory:
    """The poses that a topic has, by their stamps, seen from above.

    Raises ValueError, one line that names the bag, for a topic that is not there or has none, or a
    pose that is none; OSError when the bag cannot be opened.
    """
    bag = Bag(Path(path))
    name = topic if topic.startswith("/") else f"/{topic}"
    if not any(one.name == name and one.type in _TYPES and one.count for one in bag.topics):
        raise ValueError(
            f"{bag.path}: {topic} is no topic of {', '.join(_TYPES)} in it; {bag.listed()}"
        )
    rows = []
    for message in bag.messages([name]):
        header, pose = message.content.header, _pose_of(message.content)
        found = planar(pose.position, pose.orientation)
        place = f"{bag.path}: {name} message {message.number}"
        if found is None:
            raise ValueError(
                f"{place}: a pose is not finite, absurdly far, or its quaternion not of length 1"
            )
        stamp_s = header.stamp.sec + header.stamp.nanosec * 1e-9
        try:
            check_stamped("pose", stamp_s, found)
        except ValueError as error:
            raise ValueError(f"{place}: {error}") from error
        rows.append((stamp_s, *found.as_array()))
    table = np.array(rows).reshape(-1, 4)
    return Trajectory(table[:, 0], table[:, 1:])


def _pose_of(content: Any) -> Any:
    """The geometry_msgs/Pose within a message: with a covariance it lies one deeper."""
    return content.pose.pose if hasattr(content.pose, "pose") else content.pose

"""The frames of a robot, as a bag's /tf and /tf_static tell them, and how the laser sits on it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from slam.arrays import FloatArray
from slam.se2 import FARTHEST_M, SE2

_MOST_FRAMES = 10_000
"""Chosen: a humanoid has some hundred."""
_MOVES_M, _MOVES_RAD = 0.01, 0.01
"""Chosen: what is published again and again differs by rounding."""
_MOST_TILT = math.cos(math.radians(15.0))
"""Chosen: a laser that leans more measures the floor and the ceiling."""
_UNIT = 0.01
"""By which the length of a quaternion may differ from 1; chosen: single precision and then some."""


@dataclass(frozen=True)
class Mounting:
    """A laser on a robot. is_flipped: upside down, so that its angles run the other way round."""

    T_base_laser: SE2
    is_flipped: bool = False

    def __str__(self) -> str:
        pose = self.T_base_laser
        flipped = ", upside down" if self.is_flipped else ""
        return f"x {pose.x:.3f} y {pose.y:.3f} m, {math.degrees(pose.theta):.1f} degrees{flipped}"


@dataclass
class _Edge:
    """A frame in its parent: where it was told to be first, and how far off that ever since."""

    parent: str
    first: FloatArray
    off_m: float = 0.0
    off_rad: float = 0.0
    is_damaged: bool = False

    @property
    def moves(self) -> bool:
        return self.off_m > _MOVES_M or self.off_rad > _MOVES_RAD


class Transforms:
    """The tree of frames; of each its first place in its parent is kept, no more."""

    def __init__(self) -> None:
        self._edges: dict[str, _Edge] = {}

    def add(self, transforms: Iterable[Any]) -> None:
        """Those of one message, as `geometry_msgs/TransformStamped`."""
        for one in transforms:
            child, parent = frame_name(one.child_frame_id), frame_name(one.header.frame_id)
            edge = self._edges.get(child)
            if edge is not None and edge.moves:
                continue  # more is not asked of it
            matrix = _matrix(one.transform.translation, one.transform.rotation)
            if edge is None and len(self._edges) < _MOST_FRAMES:
                first = np.eye(4) if matrix is None else matrix
                self._edges[child] = _Edge(parent, first, is_damaged=matrix is None)
            elif edge is not None and matrix is None:
                edge.is_damaged = True
            elif edge is not None and matrix is not None and edge.parent == parent:
                off = np.linalg.inv(edge.first) @ matrix
                edge.off_m = max(edge.off_m, float(np.linalg.norm(off[:3, 3])))
                turned = math.acos(min(max((float(np.trace(off)) - 2.0) / 2.0, -1.0), 1.0))
                edge.off_rad = max(edge.off_rad, turned)

    @property
    def frames(self) -> tuple[str, ...]:
        """All frames, in alphabetical order."""
        parents = {edge.parent for edge in self._edges.values()}
        return tuple(sorted(parents | set(self._edges)))

    def above(self, frame: str) -> list[str]:
        """A frame, its parent and so on to the root. A loop ends where it closes."""
        line = [frame]
        while (edge := self._edges.get(line[-1])) is not None and edge.parent not in line:
            line.append(edge.parent)
        return line

    def mounting(self, base: str, laser: str) -> Mounting | None:
        """The laser on the robot; None where the frames do not hang together.

        Raises ValueError, which names the frames, where what is between them moves, is damaged or
        leans.
        """
        up, down = self.above(laser), self.above(base)
        meeting = next((frame for frame in up if frame in down), None)
        if meeting is None:
            return None
        T_meeting_laser = self._down(up[: up.index(meeting)])
        T_meeting_base = self._down(down[: down.index(meeting)])
        return _level(np.linalg.inv(T_meeting_base) @ T_meeting_laser, base, laser)

    def _down(self, line: list[str]) -> FloatArray:
        """(4, 4) of the first frame of a line in the parent of its last."""
        T = np.eye(4)
        for frame in line:
            edge = self._edges[frame]
            if edge.is_damaged:
                raise ValueError(
                    f"the transform of {frame:.60} in {edge.parent:.60} is not one of a body"
                )
            if edge.moves:
                raise ValueError(
                    f"{frame:.60} moves in {edge.parent:.60} by up to {edge.off_m:.2f} m and"
                    f" {math.degrees(edge.off_rad):.0f} degrees, and the laser with it; expected a"
                    " laser that is fixed to the robot"
                )
            T = edge.first @ T
        return T


def frame_name(name: str) -> str:
    """As ROS 2 writes it; ROS 1 had a slash in front. What no screen shows is written as in code."""
    bare = name.lstrip("/")
    return bare if bare.isprintable() else repr(bare)[1:-1]


def planar(position: Any, orientation: Any) -> SE2 | None:
    """A pose seen from above: x, y and the heading of its x axis; None if it is no pose."""
    matrix = _matrix(position, orientation)
    if matrix is None:
        return None
    return SE2(matrix[0, 3], matrix[1, 3], math.atan2(matrix[1, 0], matrix[0, 0]))


def _level(T: FloatArray, base: str, laser: str) -> Mounting:
    if abs(T[2, 2]) < _MOST_TILT:
        tilt_deg = math.degrees(math.acos(min(abs(float(T[2, 2])), 1.0)))
        raise ValueError(
            f"{laser:.60} leans by {tilt_deg:.0f} degrees on {base:.60}; expected a laser whose beams are"
            " level, upright or upside down"
        )
    pose = SE2(T[0, 3], T[1, 3], math.atan2(T[1, 0], T[0, 0]))
    return Mounting(pose, bool(T[2, 2] < 0.0))


def _matrix(position: Any, orientation: Any) -> FloatArray | None:
    """(4, 4) of a pose; None where it is not finite, absurdly far or its quaternion not of length 1."""
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    length = math.sqrt(x * x + y * y + z * z + w * w)
    at = (position.x, position.y, position.z)
    if not abs(length - 1.0) <= _UNIT or not all(abs(value) <= FARTHEST_M for value in at):
        return None
    x, y, z, w = x / length, y / length, z / length, w / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), at[0]],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), at[1]],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), at[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )

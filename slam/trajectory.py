"""Trajectories, and the TUM text format that evo and others read."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from slam.arrays import FloatArray, frozen_array
from slam.files.text_fields import finite_numbers
from slam.files.whole_files import read_text, write_whole
from slam.se2 import FARTHEST_M, wrap_angle

_UNIT_TOLERANCE = 0.01
TUM_HEADER = "# time_s x y z qx qy qz qw"


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses over time: times_s (N,), poses (N, 3) of x [m], y [m], theta [rad] in (-pi, pi].

    Raises ValueError on other shapes or values that are not finite.
    """

    times_s: FloatArray
    poses: FloatArray

    def __post_init__(self) -> None:
        times_s = frozen_array(self.times_s, (None,), "times_s")
        poses = np.array(self.poses, dtype=np.float64)
        if poses.ndim == 2 and poses.shape[1] == 3:
            poses[:, 2] = wrap_angle(poses[:, 2])
        poses = frozen_array(poses, (len(times_s), 3), "poses")
        if not (np.isfinite(times_s).all() and np.isfinite(poses).all()):
            raise ValueError("times_s and poses must be finite")
        object.__setattr__(self, "times_s", times_s)
        object.__setattr__(self, "poses", poses)

    def __len__(self) -> int:
        return len(self.times_s)

    def in_order(self) -> Trajectory:
        """The same by increasing stamps; of poses of one stamp the last counts."""
        order = np.argsort(self.times_s, kind="stable")
        times_s = self.times_s[order]
        is_last = np.append(np.diff(times_s) > 0.0, np.ones(min(len(order), 1), dtype=bool))
        return Trajectory(times_s[is_last], self.poses[order[is_last]])

    def at(self, times_s: ArrayLike) -> FloatArray:
        """Poses (M, 3) at the times (M,), straight between neighbours, heading the short way.

        Raises ValueError when times of the trajectory do not increase, or one asked for lies
        outside.
        """
        asked_s = np.asarray(times_s, dtype=np.float64)
        if len(self) == 0 or not (np.diff(self.times_s) > 0.0).all():
            raise ValueError("only a trajectory whose times increase can be interpolated")
        if ((asked_s < self.times_s[0]) | (asked_s > self.times_s[-1])).any():
            raise ValueError(
                f"times must lie within {self.times_s[0]:.3f} and {self.times_s[-1]:.3f} s"
            )
        unwrapped = np.column_stack([self.poses[:, :2], np.unwrap(self.poses[:, 2])])
        columns = [np.interp(asked_s, self.times_s, column) for column in unwrapped.T]
        poses = np.column_stack(columns)
        poses[:, 2] = wrap_angle(poses[:, 2])
        return poses


def write_tum(path: str | Path, trajectory: Trajectory) -> None:
    """Writes `time_s x y z qx qy qz qw` lines, nine decimals. The file appears whole or not at all.

    Raises OSError when the folder cannot be written.
    """
    content = bytearray(f"{TUM_HEADER}\n", "utf-8")
    for line in tum_lines(trajectory):  # one at a time: of a long log all of them are much
        content += f"{line}\n".encode()
    write_whole(Path(path), content)


def tum_lines(trajectory: Trajectory) -> Iterator[str]:
    """The lines of a TUM file, without a header."""
    for time_s, (x, y, theta) in zip(trajectory.times_s, trajectory.poses, strict=True):
        quaternion_z, quaternion_w = math.sin(theta / 2.0), math.cos(theta / 2.0)
        values = (time_s, x, y, 0.0, 0.0, 0.0, quaternion_z, quaternion_w)
        yield " ".join(f"{value:.9f}" for value in values)


def read_tum(path: str | Path) -> Trajectory:
    """The trajectory of a TUM file; what leaves the plane (z, roll, pitch) is dropped.

    Raises ValueError that names the line, OSError when the file cannot be opened.
    """
    path = Path(path)
    rows = [
        _tum_row(fields, f"{path} line {number}")
        for number, fields in rows_of_numbers(path, "a TUM trajectory")
    ]
    return Trajectory(
        np.array([row[0] for row in rows]), np.array([row[1:] for row in rows]).reshape(-1, 3)
    )


def rows_of_numbers(path: Path, what: str) -> Iterator[tuple[int, list[str]]]:
    """Number and fields of each line that has any, comments left out. Raises ValueError, by what the
    file should be, if it is no text."""
    for number, line in enumerate(read_text(path, what).splitlines(), start=1):
        fields = line.split("#", maxsplit=1)[0].split()
        if fields:
            yield number, fields


def _tum_row(fields: list[str], place: str) -> tuple[float, float, float, float]:
    if len(fields) != 8:
        raise ValueError(f"{place}: expected 8 numbers, found {len(fields)}")
    time_s, x, y, _, qx, qy, qz, qw = finite_numbers(fields, place)
    if max(abs(x), abs(y)) > FARTHEST_M:
        raise ValueError(f"{place}: at {x:g} {y:g}; expected metres, none beyond {FARTHEST_M:g}")
    if abs(qx * qx + qy * qy + qz * qz + qw * qw - 1.0) > _UNIT_TOLERANCE:
        raise ValueError(f"{place}: the quaternion {qx} {qy} {qz} {qw} is not of length 1")
    yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy**2 + qz**2))
    return time_s, x, y, yaw

"""Trajectories as KITTI has them: a 3 x 4 matrix in each line, no stamps; and either format read."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from slam.files.text_fields import numbers
from slam.files.whole_files import write_whole
from slam.se2 import FARTHEST_M
from slam.trajectory import Trajectory, read_tum, rows_of_numbers

_NUMBERS = 12
_UNIT = 0.01
_MOST_TILT = math.cos(math.radians(30.0))
"""Chosen: a robot on a floor; KITTI's own cameras look along z, and their plane is x and z."""


def write_kitti(path: str | Path, trajectory: Trajectory) -> None:
    """Writes the poses in their order, nine decimals; the stamps have no place in it.

    The file appears whole or not at all. Raises OSError when the folder cannot be written.
    """
    lines = []
    for x, y, theta in trajectory.poses:
        c, s = math.cos(theta), math.sin(theta)
        values = (c, -s, 0.0, x, s, c, 0.0, y, 0.0, 0.0, 1.0, 0.0)
        lines.append(" ".join(f"{value:.9f}" for value in values) + "\n")
    write_whole(Path(path), "".join(lines).encode("ascii"))


def read_kitti(path: str | Path) -> Trajectory:
    """The poses of a KITTI file, seen from above; the number of its line, from 0, for a stamp [s].

    Raises ValueError that names the line, OSError when the file cannot be opened.
    """
    path = Path(path)
    rows = []
    for number, fields in rows_of_numbers(path, "a TUM or KITTI trajectory"):
        place = f"{path} line {number}"
        if len(fields) != _NUMBERS:
            raise ValueError(f"{place}: expected {_NUMBERS} numbers, found {len(fields)}")
        rows.append(_pose(np.array(numbers(fields, place)).reshape(3, 4), place))
    return Trajectory(np.arange(float(len(rows))), np.array(rows).reshape(-1, 3))


def read_trajectory(path: str | Path) -> tuple[Trajectory, bool]:
    """The trajectory of a TUM or KITTI file, and whether it has stamps, told by its first line.

    Raises ValueError that names the line, OSError when the file cannot be opened.
    """
    path = Path(path)
    first = next(rows_of_numbers(path, "a TUM or KITTI trajectory"), (0, []))[1]
    if len(first) == _NUMBERS:
        return read_kitti(path), False
    return read_tum(path), True


def _pose(matrix: np.ndarray, place: str) -> tuple[float, float, float]:
    """x, y and heading of a pose (3, 4)."""
    if not np.isfinite(matrix).all():
        raise ValueError(f"{place}: a number is not finite")
    turn, (x, y, _) = matrix[:, :3], matrix[:, 3]
    # products of larger numbers may be none
    if np.abs(turn).max() > 2.0 or np.abs(turn @ turn.T - np.eye(3)).max() > _UNIT:
        raise ValueError(f"{place}: its first three columns are no rotation")
    if max(abs(x), abs(y)) > FARTHEST_M:
        raise ValueError(f"{place}: at {x:g} {y:g}; expected metres, none beyond {FARTHEST_M:g}")
    if turn[2, 2] < _MOST_TILT:
        raise ValueError(
            f"{place}: z does not point up; expected a robot that drives in the plane of x and y"
            " (KITTI's cameras look along z)"
        )
    return float(x), float(y), math.atan2(turn[1, 0], turn[0, 0])

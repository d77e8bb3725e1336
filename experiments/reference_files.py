"""Files to judge by, true poses or relations; one given for another is told for what it is."""

from __future__ import annotations

import math
from itertools import islice
from pathlib import Path

from slam.files.kitti_files import read_trajectory
from slam.files.text_fields import is_number
from slam.metrics import Relations, read_relations
from slam.readers.recognition import is_log
from slam.trajectory import Trajectory, read_tum, rows_of_numbers

_LOG, _RELATIONS, _TUM, _KITTI = "a log", "relations", "TUM poses", "KITTI poses"
_LOOKED_AT = 100
_FEWEST = 2
"""Chosen: the lines from which on relations of one yaw, of 1 rad, would be taken for poses."""
_UNIT = 0.01


def read_reference(path: Path) -> Trajectory:
    """The poses of a TUM file, one at least. Raises ValueError, OSError as `read_tum`."""
    _check_holds_poses(path, "--reference takes true poses: a TUM file", is_kitti_taken=False)
    trajectory = read_tum(path)
    check_has_poses(trajectory, path)
    return trajectory


def read_poses(path: Path, taken_by: str) -> tuple[Trajectory, bool]:
    """The poses of a TUM or KITTI file, one at least, and whether they have stamps. taken_by: what
    the file was given as, `--reference` or such. Raises ValueError, OSError as `read_trajectory`."""
    _check_holds_poses(path, f"{taken_by} takes poses: a TUM or KITTI file", is_kitti_taken=True)
    trajectory, is_stamped = read_trajectory(path)
    check_has_poses(trajectory, path)
    return trajectory, is_stamped


def read_related(path: Path) -> Relations:
    """The relations of a file. Raises ValueError, OSError as `read_relations`."""
    found = _kind_of(path)
    if found in (_LOG, _TUM, _KITTI):
        instead = "" if found == _LOG else f", and {found} are given by --reference"
        raise ValueError(
            f"{path} holds {found}: --relations takes lines of t1 t2 x y z roll pitch yaw{instead}"
        )
    return read_relations(path)


def check_has_poses(trajectory: Trajectory, path: Path) -> None:
    """Raises ValueError that names the file of a trajectory without any."""
    if len(trajectory) == 0:
        raise ValueError(f"{path}: no pose in it, lines of time_s x y z qx qy qz qw")


def _check_holds_poses(path: Path, expected: str, *, is_kitti_taken: bool) -> None:
    """Raises ValueError for a file of another kind: what came, what was expected, what to do."""
    found = _kind_of(path)
    instead = {
        _LOG: "kitasap slam makes poses of a log, and kitasap convert LOG odometry.tum those of its"
        " wheels",
        _RELATIONS: "evaluate, slam and bench continued take relations by --relations",
        _KITTI: "KITTI poses have no stamps by which they would be a log's",
    }
    if found in instead and not (found == _KITTI and is_kitti_taken):
        raise ValueError(f"{path} holds {found}: {expected}; {instead[found]}")


def _kind_of(path: Path) -> str | None:
    """What a file holds, as its first lines tell; None where they do not.

    Relations and TUM poses both have eight numbers a line: the last four are a unit quaternion or not.
    Raises OSError when it cannot be opened.
    """
    if path.is_dir():
        return None
    if is_log(path):
        return _LOG
    try:
        rows = [fields for _, fields in islice(rows_of_numbers(path, "text"), _LOOKED_AT)]
    except ValueError:  # binary
        return None
    if not rows or not all(is_number(field) for fields in rows for field in fields):
        return None
    counts = {len(fields) for fields in rows}
    if counts == {12}:
        return _KITTI
    if counts != {8}:
        return None
    units = sum(_is_unit(fields[4:]) for fields in rows)
    if units == len(rows) >= _FEWEST:
        return _TUM
    # a damaged trajectory has few others; or its coordinates are no times
    first, second = (max(float(fields[k]) for fields in rows) for k in (0, 1))
    return _RELATIONS if 2 * units < len(rows) and 2.0 * second > first else None


def _is_unit(quaternion: list[str]) -> bool:
    return abs(math.fsum(float(one) ** 2 for one in quaternion) - 1.0) <= _UNIT

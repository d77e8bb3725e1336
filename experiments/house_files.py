"""Houses of HouseExpo (Li et al. 2019, arXiv:1903.09845), from the user's own copy, as places.

Each is a JSON file with the outline of its floor, `verts`, in metres, all rooms in one. The data set
itself is under a licence of its own and not part of this project.
"""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kitasap_sim.built_places import Block
from kitasap_sim.rectangles import rectangles
from slam.arrays import BoolArray, FloatArray
from slam.files.text_fields import in_one_line
from slam.files.whole_files import read_at_most
from slam.files.yaml_files import shown

_MOST_BYTES = 2_000_000
_MOST_CORNERS = 5_000
_FARTHEST_M = 300.0
_STEP_M = 0.025
"""Chosen: slanted walls become steps of this size; all others stay where they are."""
_RIM_M = 0.2
"""Chosen: thickness of the outer walls."""
_MOST_LINES = 6_000
_MOST_BOXES = 30_000


@dataclass(frozen=True, eq=False)
class House:
    """corners_m: (V, 2) of the outline of the floor. rooms: how many the file says there are."""

    corners_m: FloatArray
    rooms: int | None

    def blocks(self, height_m: float) -> list[Block]:
        """Everything outside of the outline, up to a rim around it, as boxes.

        Raises ValueError if it has too many slanted walls.
        """
        x_m, y_m = (_lines(self.corners_m, axis) for axis in (0, 1))
        if max(len(x_m), len(y_m)) > _MOST_LINES:
            raise ValueError("its walls are too long and too slanted to be made of boxes")
        solid = ~_inside(self.corners_m, (x_m[1:] + x_m[:-1]) / 2, (y_m[1:] + y_m[:-1]) / 2)
        return [
            Block(
                (x_m[left] + x_m[right]) / 2,
                (y_m[low] + y_m[high]) / 2,
                x_m[right] - x_m[left],
                y_m[high] - y_m[low],
                height_m,
            )
            for low, left, high, right in rectangles(solid, _MOST_BOXES).tolist()
        ]


def read_house(path: Path) -> House:
    """The house in a JSON file of HouseExpo.

    Raises ValueError, one line that names the file, where it is none; OSError when it cannot be
    opened.
    """
    content = read_at_most(path, _MOST_BYTES)
    try:
        fields = json.loads(content)
    except (ValueError, RecursionError) as error:
        reason = "nested too deep" if isinstance(error, RecursionError) else str(error)
        raise ValueError(f"{path}: not a JSON file ({reason[:200]})") from None
    try:
        return _house(fields)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _house(fields: object) -> House:
    if not isinstance(fields, dict) or "verts" not in fields:
        names = in_one_line(", ".join(fields), 80) if isinstance(fields, dict) else shown(fields)
        found = names or "none"
        raise ValueError(f"expected a house of HouseExpo, with the key verts (found: {found})")
    verts = fields["verts"]
    if not isinstance(verts, list) or not 3 <= len(verts) <= _MOST_CORNERS:
        count = len(verts) if isinstance(verts, list) else shown(verts)
        raise ValueError(f"verts must be 3 to {_MOST_CORNERS} points [x, y], not {count}")
    corners = np.array([_corner(vertex) for vertex in verts])
    closed = np.concatenate([corners, corners[:1]])
    is_step = np.hypot(*np.diff(closed, axis=0).T) > 1e-6
    corners = corners[is_step]
    if len(corners) < 3 or np.ptp(corners, axis=0).min() < 0.1:
        raise ValueError("verts enclose no floor")
    rooms = fields.get("room_num")
    return House(corners, rooms if isinstance(rooms, int) and not isinstance(rooms, bool) else None)


def _corner(vertex: object) -> tuple[float, float]:
    is_pair = isinstance(vertex, list) and len(vertex) == 2
    if isinstance(vertex, list) and is_pair:
        x, y = (
            float(v) if isinstance(v, int | float) and abs(v) < 1e9 else math.nan for v in vertex
        )
        if max(abs(x), abs(y)) <= _FARTHEST_M and math.isfinite(x + y):
            return round(x, 6), round(y, 6)
    raise ValueError(
        f"verts must be points [x, y] in metres, none beyond {_FARTHEST_M:g}, not {shown(vertex)}"
    )


def _lines(corners_m: FloatArray, axis: int) -> FloatArray:
    """Where cells begin and end along an axis: at each corner, and in steps along slanted walls."""
    values = [corners_m[:, axis]]
    for one, other in itertools.pairwise([*corners_m, corners_m[0]]):
        if (one != other).all():
            low, high = sorted((one[axis], other[axis]))
            values.append(np.linspace(low, high, math.ceil((high - low) / _STEP_M) + 1))
    lines = np.unique(np.round(np.concatenate(values), 6))
    return np.concatenate([[lines[0] - _RIM_M], lines, [lines[-1] + _RIM_M]])


def _inside(corners_m: FloatArray, x_m: FloatArray, y_m: FloatArray) -> BoolArray:
    """(Y, X) whether points lie within an outline: a line to the left crosses it an odd number of
    times."""
    ends_m = np.roll(corners_m, -1, axis=0)
    inside = np.zeros((len(y_m), len(x_m)), dtype=bool)
    for row, y in enumerate(y_m):
        is_crossed = (corners_m[:, 1] > y) != (ends_m[:, 1] > y)
        one, other = corners_m[is_crossed], ends_m[is_crossed]
        share = (y - one[:, 1]) / (other[:, 1] - one[:, 1])
        crossings = np.sort(one[:, 0] + share * (other[:, 0] - one[:, 0]))
        inside[row] = np.searchsorted(crossings, x_m) % 2 == 1
    return inside

"""Files of relations: `t1 t2 x y z roll pitch yaw`, as the Freiburg SLAM evaluation has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from slam.files.text_fields import finite_numbers
from slam.files.whole_files import read_text, write_whole
from slam.metrics.relations import Relations

_HEADER = "# timestamp1 timestamp2 x y z roll pitch yaw"
_FIELDS = 8


def read_relations(path: str | Path) -> Relations:
    """The relations of a file; what leaves the plane (z, roll, pitch) is dropped.

    Raises ValueError, one line that names the file and the line, OSError when it cannot be opened.
    """
    path = Path(path)
    text, rows = read_text(path, "a file of relations"), []
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.split("#", maxsplit=1)[0].split()
        if fields:
            rows.append(_row(fields, f"{path} line {number}"))
    if not rows:
        raise ValueError(f"{path}: no relation in it, lines of {_HEADER.removeprefix('# ')}")
    values = np.array(rows)
    return Relations(values[:, :2], values[:, [2, 3, 7]])


def write_relations(path: str | Path, relations: Relations) -> None:
    """Writes `t1 t2 x y z roll pitch yaw` lines, nine decimals; whole or not at all.

    Raises OSError when the folder cannot be written.
    """
    lines = [_HEADER]
    for (first_s, second_s), (x, y, theta) in zip(
        relations.times_s, relations.motions, strict=True
    ):
        motion = " ".join(f"{value:.9f}" for value in (x, y, 0.0, 0.0, 0.0, theta))
        lines.append(f"{first_s:.6f} {second_s:.6f} {motion}")
    write_whole(Path(path), ("\n".join(lines) + "\n").encode("utf-8"))


def _row(fields: list[str], place: str) -> list[float]:
    if len(fields) != _FIELDS:
        raise ValueError(
            f"{place}: a relation has {_FIELDS} numbers, t1 t2 x y z roll pitch yaw,"
            f" found {len(fields)}"
        )
    return finite_numbers(fields, place)

"""Recorded logs of any format known here, told by what is in the file, not by its name."""

from __future__ import annotations

from pathlib import Path

from slam.readers.carmen import read_carmen
from slam.readers.carmen_lines import KEYWORDS
from slam.readers.lines import text_lines
from slam.readers.log import Log
from slam.readers.ticks import FIRST_RANGE, read_ticks

_LINES_LOOKED_AT = 1000
"""Chosen: logs begin with comments and parameters, at most some hundred."""
_EXPECTED = (
    f"a CARMEN log (lines {', '.join(KEYWORDS)}) or encoder ticks and ranges"
    f" (lines of more than {FIRST_RANGE} numbers)"
)


def read_log(path: str | Path) -> Log:
    """The log in a file, plain or gzip'd, of the format that its first lines tell.

    Raises ValueError, one line that names the file, for a file of another kind, or one that is cut
    or damaged; OSError when the file cannot be opened.
    """
    path = Path(path)
    found = "is empty"
    for number, line in text_lines(path, _EXPECTED):
        fields = line.split()
        if fields and fields[0] in KEYWORDS:
            return read_carmen(path)
        if fields and not fields[0].startswith("#"):
            if len(fields) > FIRST_RANGE and all(map(_is_number, fields)):
                return read_ticks(path)
            if found == "is empty":
                found = f"line {number} begins '{' '.join(fields)[:40]}'"
        if number >= _LINES_LOOKED_AT:
            break
    raise ValueError(f"{path.name}: {found}; expected {_EXPECTED}")


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True

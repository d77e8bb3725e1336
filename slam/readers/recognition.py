"""Recorded logs of any format known here, told by what is in the file, not by its name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from slam.files.text_fields import is_number
from slam.files.whole_files import opened
from slam.readers.carmen import CarmenConfig, read_carmen
from slam.readers.carmen_lines import KEYWORDS
from slam.readers.lines import text_lines
from slam.readers.log import Log, LogChoice
from slam.readers.ticks import FIRST_RANGE, TicksConfig, read_ticks

_LINES_LOOKED_AT = 1000
"""Chosen: logs begin with comments and parameters, at most some hundred."""
_BAG_SUFFIXES = (".bag", ".mcap", ".db3")
_OF_BAG_FOLDERS = ("metadata.yaml", *(f"*{suffix}" for suffix in _BAG_SUFFIXES))
_NO_BAG = f"{', '.join(_OF_BAG_FOLDERS[:-1])} or {_OF_BAG_FOLDERS[-1]}"
_BAG_MAGICS = (b"#ROSBAG V", b"\x89MCAP", b"SQLite format 3\0")
_EXPECTED = (
    f"a CARMEN log (lines {', '.join(KEYWORDS)}) or encoder ticks and ranges"
    f" (lines of more than {FIRST_RANGE} numbers), or a ROS bag"
)


def read_log(path: str | Path, choice: LogChoice | None = None) -> Log:
    """The log in a file, plain or gzip'd, or a ROS bag, of the format that its beginning tells.

    choice: of what the log leaves open. Raises ValueError, one line that names the file, for a file
    of another kind, or one that is cut or damaged; OSError when the file cannot be opened;
    ImportError for a bag without the library that reads it.
    """
    path, choice = Path(path), choice or LogChoice()
    if _is_bag(path):
        return _read_bag(path, choice)
    T_base_laser = choice.T_base_laser
    kind, found = _kind_of_text(path)
    if kind is None:
        raise ValueError(f"{path}: {found}; expected {_EXPECTED}")
    if choice.scan_topic is not None or choice.odom_topic is not None:
        raise ValueError(f"{path}: --scan-topic and --odom-topic are of ROS bags, and this is none")
    if kind == "carmen":
        return read_carmen(path, CarmenConfig(T_base_laser=T_base_laser))
    ticks = TicksConfig()
    return read_ticks(
        path, ticks if T_base_laser is None else replace(ticks, T_base_laser=T_base_laser)
    )


def is_log(path: Path) -> bool:
    """Whether a file begins as a log does, be it cut or damaged further on.

    Raises OSError when it cannot be opened.
    """
    try:
        return path.is_file() and (_is_bag(path) or _kind_of_text(path)[0] is not None)
    except ValueError:  # binary, and no bag
        return False


def _kind_of_text(path: Path) -> tuple[Literal["carmen", "ticks"] | None, str]:
    """What log a text is, and how it begins if it is none, in words."""
    found, nothing = "", "is empty"
    for number, line in text_lines(path, _EXPECTED):
        fields = line.split()
        if fields and fields[0] in KEYWORDS:
            return "carmen", ""
        if "\r" in line.rstrip():
            nothing = f"line {number} has carriage returns in it: end lines by line feeds"
        elif fields and fields[0].startswith("#"):
            nothing = "has comments alone"
        elif fields:
            if len(fields) > FIRST_RANGE and all(map(is_number, fields)):
                return "ticks", ""
            found = found or f"line {number} begins '{' '.join(fields)[:40]}'"
        if number >= _LINES_LOOKED_AT:
            break
    return None, found or nothing


def _is_bag(path: Path) -> bool:
    """Whether a path is a bag, or called one: a folder, or a file that begins or ends like one."""
    if path.is_dir() or path.suffix in _BAG_SUFFIXES:
        return path.exists()
    with opened(path) as file:
        return file.read(16).startswith(_BAG_MAGICS)


def _read_bag(path: Path, choice: LogChoice) -> Log:
    # said without rosbags, too
    if path.is_dir() and not any(any(path.glob(each)) for each in _OF_BAG_FOLDERS):
        raise ValueError(f"{path}: is a folder without {_NO_BAG}: give the log")
    try:
        from slam.readers.ros_bag import read_ros_bag
    except ImportError as error:
        raise ImportError(
            f"{path} is a ROS bag, and to read it {error.name} is missing:"
            " pip install 'kitasap[ros]'"
        ) from error
    return read_ros_bag(path, choice)

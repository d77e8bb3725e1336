"""Files that are there whole or not at all."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import BinaryIO

_PART_BYTES = 1 << 20


def write_whole(path: Path, content: bytes | bytearray) -> None:
    """Writes a file so that at any moment there is the old one or the new one, whole.

    Raises OSError when the folder cannot be written; nothing is left behind then.
    """
    # Beside the target, since a rename is atomic within one file system only.
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        unfinished.write_bytes(content)
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)


def opened(path: Path) -> BinaryIO:
    """A file, to be read.

    Raises ValueError that names it for a pipe or a device, on which one would wait for ever; OSError
    when it cannot be opened.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise ValueError(f"{path}: a pipe or a device; expected a file")
    return path.open("rb")


def read_text(path: Path, what: str) -> str:
    """A file's text, in UTF-8. Raises ValueError, by what the file should be, where it is none;
    OSError when it cannot be opened."""
    try:
        # line ends of other systems become ours
        with io.TextIOWrapper(opened(path), encoding="utf-8") as file:
            return file.read()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: binary, not {what}") from error


def read_at_most(path: Path, most_bytes: int) -> bytes:
    """All of a file, which is no longer than that.

    Raises ValueError that names it for a longer one, be it without end; OSError when it cannot be
    opened.
    """
    content = bytearray()
    with opened(path) as file:
        # a part at a time: memory for all that may be read would be taken at once
        while len(content) <= most_bytes and (part := file.read(_PART_BYTES)):
            content += part
    if len(content) > most_bytes:
        raise ValueError(f"{path}: longer than the {most_bytes / 1e6:g} MB that are read of one")
    return bytes(content)

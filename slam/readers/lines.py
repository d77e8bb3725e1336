"""The lines of a text log, plain or gzip'd, one at a time."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path

_LONGEST_LINE = 1 << 20
"""Bytes; chosen: a scan of 1081 beams takes 10 kB. A file without line ends is not read whole."""


def text_lines(path: Path, kind: str) -> Iterator[tuple[int, str]]:
    """The lines with their numbers from 1, line ends kept: a last one without is cut.

    kind: what the file should be, as in "a CARMEN log". Raises ValueError, one line that names the
    file and the line, for what is binary, cut or damaged; OSError when it cannot be opened.
    """
    number = 0
    try:
        with _opened(path) as file:
            while line := file.readline(_LONGEST_LINE):
                number += 1
                if b"\0" in line or len(line) == _LONGEST_LINE:
                    raise ValueError(f"{path.name} line {number}: binary, not {kind}")
                # names in a comment may be of any alphabet
                is_comment = line.lstrip().startswith(b"#")
                yield number, line.decode("utf-8", errors="replace" if is_comment else "strict")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path.name} line {number}: binary, not {kind}") from error
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ValueError(
            f"{path.name}: the gzip file is cut or damaged after line {number} ({error})"
        ) from error


def _opened(path: Path) -> gzip.GzipFile:
    """The file as a stream of lines; told from its first bytes, since names lie."""
    with path.open("rb") as file:
        is_gzip = file.read(2) == b"\x1f\x8b"
    # a plain binary file has all that is used of a GzipFile here: its lines, and its end
    return gzip.open(path, "rb") if is_gzip else path.open("rb")  # type: ignore[return-value]

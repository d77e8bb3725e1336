"""The lines of a text log, plain or gzip'd, one at a time."""

from __future__ import annotations

import codecs
import gzip
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from slam.files.whole_files import opened

_LONGEST_LINE = 1 << 20
"""Bytes; chosen: a scan of 1081 beams takes 10 kB. A file without line ends is not read whole."""
_MOST_TIMES, _OFTEN_BYTES = 200, 1 << 22
"""Chosen: ranges with noise pack to a fifth, the worst that gzip allows is a thousandth; asked for each
4 MB of lines."""


def text_lines(path: Path, kind: str) -> Iterator[tuple[int, str]]:
    """The lines with their numbers from 1, line ends kept: a last one without is cut.

    kind: what the file should be, as in "a CARMEN log". Raises ValueError, one line that names the
    file and the line, for what is binary, cut or damaged; OSError when it cannot be opened.
    """
    number, size, most = 0, 0, _OFTEN_BYTES
    try:
        with opened(path) as packed:
            # told from its first bytes, since names lie
            is_gzip = packed.read(2) == b"\x1f\x8b"
            packed.seek(0)
            file = gzip.GzipFile(fileobj=packed) if is_gzip else packed
            while line := file.readline(_LONGEST_LINE):
                number += 1
                if number == 1:
                    line = line.removeprefix(codecs.BOM_UTF8)  # as editors of Windows write it
                size += len(line)
                if size > most:
                    most = size + _OFTEN_BYTES
                    if size > _MOST_TIMES * packed.tell():
                        raise ValueError(
                            f"{path}: unpacks to more than {_MOST_TIMES} times its size: no log"
                            " of a laser, whose ranges differ"
                        )
                if b"\0" in line or len(line) == _LONGEST_LINE:
                    raise ValueError(f"{path} line {number}: binary, not {kind}")
                # names in a comment may be of any alphabet
                is_comment = line.lstrip().startswith(b"#")
                yield number, line.decode("utf-8", errors="replace" if is_comment else "strict")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} line {number}: binary, not {kind}") from error
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ValueError(
            f"{path}: the gzip file is cut or damaged after line {number} ({error})"
        ) from error


@contextmanager
def told_if_cut(is_cut: bool) -> Iterator[None]:
    """Says of what is wrong within that it is the last line's, which has no line end, and what to do."""
    try:
        yield
    except ValueError as error:
        if not is_cut:
            raise
        said = "it is the last line and has no line end, as if cut: take it out"
        raise ValueError(f"{error}; {said}") from error

"""Standard output and error of a command whose reader may go away before it ends."""

from __future__ import annotations

import errno
import io
import os
import select
import stat
import sys
from typing import Any, TextIO


class _UntilNobodyReads(io.FileIO):
    """A file that takes everything, once nobody reads it any more: the work goes on, and its status says
    how it ended. is_told_all: what a full disk does not take is an error as well, the first time."""

    def __init__(self, descriptor: int, is_told_all: bool) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self._is_told_all = is_told_all

    def write(self, content: Any, /) -> int:
        """As of a file; of a pipe that does not block, and is full, once it is not."""
        try:
            while (written := super().write(content)) is None:
                select.select([], [self], [])
            return written
        except OSError as error:
            if self._is_told_all and not self._is_left(error):
                self._is_told_all = False  # said once, not by the interpreter's end as well
                raise OSError(error.errno, error.strerror, "standard output") from error
            return len(content)

    def _is_left(self, error: OSError) -> bool:
        """Whether it is of a pipe whose reader went away, or of a terminal that did."""
        if error.errno == errno.EIO:  # of a file it is the disk's
            return stat.S_ISCHR(os.fstat(self.fileno()).st_mode)
        return isinstance(error, BrokenPipeError)


def outlive_readers() -> None:
    """Has the streams of this process go nowhere, once nobody reads them; and from the first, where they
    were closed."""
    sys.stdout = _outliving(sys.stdout, is_told_all=True)
    sys.stderr = _outliving(sys.stderr, is_told_all=False)


def _outliving(stream: TextIO | None, *, is_told_all: bool) -> TextIO:
    if stream is None:
        return open(os.devnull, "w", encoding="utf-8")
    stream.flush()
    raw = _UntilNobodyReads(stream.fileno(), is_told_all)
    return io.TextIOWrapper(
        io.BufferedWriter(raw), stream.encoding, stream.errors,
        line_buffering=stream.isatty() or not is_told_all,
    )  # fmt: skip

"""Memory that this process holds."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

_PROC = Path("/proc/self")


def resident_mb() -> float | None:
    """Memory that the process holds now [MB]; None where there is no /proc."""
    try:
        pages = int((_PROC / "statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return None
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


class MemoryGrowth:
    """By how much the process grows at most from when this is made, what it holds for a moment as well.

    One at a time: the kernel keeps one such mark for a process, which is taken down here. Where it may not be
    taken down, and was higher before, what is held for a moment goes unseen.
    """

    def __init__(self) -> None:
        with contextlib.suppress(OSError):  # see above
            (_PROC / "clear_refs").write_text("5", encoding="ascii")
        self._before_mb, self._mark_mb = resident_mb(), _most_mb()

    def now_mb(self) -> float | None:
        """By how much more it holds now [MB], 0 where pages from before were given back; None where there is no
        /proc."""
        return _more(resident_mb(), self._before_mb)

    def most_mb(self) -> float | None:
        """By how much more it held at most until now [MB], as `now_mb`."""
        now_mb, mark_mb = self.now_mb(), _most_mb()
        is_new = mark_mb is not None and self._mark_mb is not None and mark_mb > self._mark_mb
        most_mb = _more(mark_mb, self._before_mb) if is_new else None
        return now_mb if most_mb is None or now_mb is None else max(now_mb, most_mb)


def _more(held_mb: float | None, before_mb: float | None) -> float | None:
    return None if held_mb is None or before_mb is None else max(held_mb - before_mb, 0.0)


def _most_mb() -> float | None:
    """Most that the process held since the mark was taken down, or it began [MB]; None where nobody tells."""
    try:
        told = (_PROC / "status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return None
    _, name, rest = told.partition("VmHWM:")
    return int(rest.split()[0]) * 1024 / 1e6 if name else None

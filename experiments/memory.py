"""Memory that this process holds."""

from __future__ import annotations

import os
from pathlib import Path


def resident_mb() -> float | None:
    """Memory that the process holds now [MB]; None where there is no /proc."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return None
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6

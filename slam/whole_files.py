"""Files that are there whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
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

"""Processes started by tests, and what is left of them."""

import time
from collections.abc import Callable
from pathlib import Path


def group(leader: int) -> list[int]:
    """The living processes of a process group."""
    living = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, process_group = stat.read_text().rpartition(")")[2].split()[:3]
        except (OSError, ValueError):
            continue  # it just ended
        if int(process_group) == leader and state != "Z":
            living.append(int(stat.parent.name))
    return living


def wait_until(is_so: Callable[[], bool], limit_s: float = 30.0) -> bool:
    """Whether it came to be so; a limit, since a test that hangs tells nothing."""
    end_s = time.monotonic() + limit_s
    while not is_so():
        if time.monotonic() > end_s:
            return False
        time.sleep(0.005)
    return True

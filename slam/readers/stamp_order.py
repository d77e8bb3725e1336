"""Messages put back into the order of their stamps, a few seconds at a time."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Iterator
from typing import TypeVar

_LATE_S = 2.0
"""By which a message may come behind later ones; chosen: slow drivers and networks take tenths."""
_MOST_WAITING = 2048
"""Chosen: odometry at 1 kHz for two seconds; a hostile bag has all at one instant."""

Item = TypeVar("Item")


def in_stamp_order(stamped: Iterable[tuple[float, Item]]) -> Iterator[tuple[float, Item]]:
    """The same by their stamps [s], as far as none is later than others by more than 2 s.

    A stamp that lies farther back is of a clock that was set: what waits is handed out, and what
    comes is in the order of the new clock.
    """
    waiting: list[tuple[float, int, Item]] = []
    latest_s = -math.inf
    for number, (time_s, item) in enumerate(stamped):
        if time_s < latest_s - _LATE_S:
            yield from _rest(waiting)
            latest_s = time_s
        latest_s = max(latest_s, time_s)
        heapq.heappush(waiting, (time_s, number, item))
        while waiting[0][0] < latest_s - _LATE_S or len(waiting) > _MOST_WAITING:
            yield _earliest(waiting)
    yield from _rest(waiting)


def _rest(waiting: list[tuple[float, int, Item]]) -> Iterator[tuple[float, Item]]:
    while waiting:
        yield _earliest(waiting)


def _earliest(waiting: list[tuple[float, int, Item]]) -> tuple[float, Item]:
    time_s, _, item = heapq.heappop(waiting)
    return time_s, item

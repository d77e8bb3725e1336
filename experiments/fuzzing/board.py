"""What a fuzzing process tells of itself, in memory that outlives it: also when it dies or hangs."""

from __future__ import annotations

import mmap
import struct
import time
from dataclasses import dataclass
from pathlib import Path

LONGEST_INPUT = 1 << 16
RENEWED = 64
"""Status of a process that ends well before its time, so that another one goes on with less memory."""
_NUMBERS = struct.Struct("<QQddQQQ")
_SIZE = _NUMBERS.size + LONGEST_INPUT


@dataclass
class Tally:
    """inputs: done; refused: in the documented way; slowest_s: of one; since_s: when the one under way
    began (monotonic), 0 where there is none; grown_kb: most memory that one took;
    is_guided: by coverage; size: of the input under way."""

    inputs: int = 0
    refused: int = 0
    slowest_s: float = 0.0
    since_s: float = 0.0
    grown_kb: int = 0
    is_guided: int = 0
    size: int = 0

    def add(self, other: Tally) -> None:
        """That of a process that went on after this one had died."""
        self.inputs += other.inputs
        self.refused += other.refused
        self.slowest_s = max(self.slowest_s, other.slowest_s)
        self.grown_kb = max(self.grown_kb, other.grown_kb)
        self.is_guided = max(self.is_guided, other.is_guided)


class Board:
    """A file in memory, written by the process and read by the one that started it."""

    def __init__(self, path: Path, *, is_new: bool) -> None:
        if is_new:
            path.write_bytes(bytes(_SIZE))
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), _SIZE)

    def write(self, tally: Tally) -> None:
        """Tells all numbers."""
        _NUMBERS.pack_into(
            self._map, 0, tally.inputs, tally.refused, tally.slowest_s, tally.since_s,
            tally.grown_kb, tally.is_guided, tally.size,
        )  # fmt: skip

    def begin(self, tally: Tally, data: bytes) -> None:
        """Tells that an input is under way, and which."""
        tally.size, tally.since_s = len(data), time.monotonic()
        self._map[_NUMBERS.size : _NUMBERS.size + len(data)] = data
        self.write(tally)

    def read(self) -> Tally:
        """What was told last."""
        return Tally(*_NUMBERS.unpack_from(self._map, 0))

    def under_way(self) -> bytes:
        """The input under way."""
        start = _NUMBERS.size
        return bytes(self._map[start : start + min(self.read().size, LONGEST_INPUT)])

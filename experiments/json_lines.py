"""A log of lines, each of one trial: appended, found again by its index, and kept on the disk."""

import json
import os
import time
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

CHECKSUM = "crc32"
"""Of a line of another log with the same index; a trial that is done again has two."""
_SYNC_S = 1.0
"""Chosen: what a power cut may take with it. A killed process takes nothing: the system has it."""


def checksum(line: bytes) -> int:
    """Of a line, its end included."""
    return zlib.crc32(line)


class OtherRun(ValueError):
    """A log holds lines of another run."""


class TrialLines:
    """The lines of a log by index. Memory holds where each lies, and not what it says.

    key: what every line has to have. beside: a log whose lines have the checksums of these, as
    `CHECKSUM`. mended: what was cut off at the end, in words, if anything.
    Raises OtherRun for a line with another key, ValueError for one that is none, or whose checksum is
    another; but the last line is cut off then, or with `is_kept` passed over: a crash left that of it.
    """

    def __init__(
        self,
        path: Path,
        key: dict[str, Any],
        beside: "TrialLines | None" = None,
        *,
        is_kept: bool = False,
    ) -> None:
        self.path, self._key, self._beside = path, key, beside
        self._told: dict[int, tuple[int, ...]] = {}
        """Checksums that the lines tell of those of another log."""
        self.mended: str | None = None
        self._spans: dict[int, tuple[int, int]] = {}
        self._file: BinaryIO | None = None
        self._synced_s = 0.0
        if path.exists():
            size = self._load()
            if size < path.stat().st_size:
                self.mended = f"the last line of {path} was damaged, and is done again"
                if not is_kept:
                    with path.open("r+b") as file:
                        file.truncate(size)

    def __contains__(self, index: object) -> bool:
        return index in self._spans

    def __len__(self) -> int:
        return len(self._spans)

    @property
    def indices(self) -> list[int]:
        """Whose lines there are, in order."""
        return sorted(self._spans)

    def line(self, index: int) -> bytes:
        """A line as it stands, its end included."""
        return next(self._lines([index]))

    def record(self, index: int) -> dict[str, Any]:
        """What a line says."""
        record: dict[str, Any] = json.loads(self.line(index))
        return record

    def records(self, indices: Iterable[int]) -> Iterator[dict[str, Any]]:
        """What some lines say, read one after the other."""
        return map(json.loads, self._lines(indices))

    def as_line(self, index: int, record: dict[str, Any]) -> bytes:
        """A line that may be appended."""
        return (json.dumps(self._key | {"index": index} | record, allow_nan=False) + "\n").encode()

    def append_line(self, index: int, line: bytes) -> None:
        """Writes a line. Where the disk is full or broken nothing of it is left, and OSError says so."""
        with named(self.path):
            if self._file is None:
                self._file = self.path.open("ab", buffering=0)
            start = self._file.seek(0, os.SEEK_END)
            try:
                written = 0
                while written < len(line):  # a disk that is nearly full takes a part
                    written += self._file.write(line[written:])
                if time.monotonic() - self._synced_s > _SYNC_S:
                    os.fsync(self._file.fileno())
                    self._synced_s = time.monotonic()
            except OSError:
                self._file.truncate(start)
                raise
        self._spans[index] = (start, len(line))

    def forget(self, index: int) -> None:
        """A line counts no more; the file loses it when it is sorted."""
        del self._spans[index]

    def sort(self) -> None:
        """Brings the lines into the order of their indices, each there once."""
        self.close()
        if not self._is_sorted():
            spans, end = {}, 0
            with replaced(self.path) as file:
                for index, line in zip(self.indices, self._lines(self.indices), strict=True):
                    file.write(line)
                    spans[index] = (end, len(line))
                    end += len(line)
            self._spans = spans

    def close(self) -> None:
        """Nothing is appended for now; what was is on the disk."""
        if self._file is not None:
            with named(self.path), self._file:
                os.fsync(self._file.fileno())
            self._file = None

    def _is_sorted(self) -> bool:
        end = 0
        for index in self.indices:
            start, length = self._spans[index]
            if start != end:
                return False
            end += length
        return self.path.exists() and self.path.stat().st_size == end

    def _lines(self, indices: Iterable[int]) -> Iterator[bytes]:
        indices = list(indices)
        if not indices:
            return  # there may be no file yet
        with self.path.open("rb") as file:
            for index in indices:
                start, length = self._spans[index]
                if file.tell() != start:
                    file.seek(start)
                yield file.read(length)

    def _load(self) -> int:
        """Finds the lines; how many bytes of them are whole."""
        end, damage = 0, None
        with self.path.open("rb") as file:
            for number, line in enumerate(file, start=1):
                if damage is not None:
                    raise ValueError(damage)
                try:
                    index = self._index_of(line)
                except OtherRun:
                    raise
                except (ValueError, KeyError, TypeError) as error:
                    damage = (
                        f"{self.path} line {number} is not a trial: {error!r}; without that line the"
                        " same command does the trial again"
                    )
                    if number == 1 and line.endswith(b"\n"):
                        raise ValueError(damage) from None  # a file of something else
                else:
                    self._spans[index] = (end, len(line))
                    end += len(line)
        return end

    def _index_of(self, line: bytes) -> int:
        if not line.endswith(b"\n"):
            raise ValueError("it has no end")
        record = json.loads(line)
        key, index = {name: record[name] for name in self._key}, record["index"]
        if not (isinstance(index, int) and index >= 0):
            raise ValueError(f"{index!r:.80} is no index")
        if key != self._key:
            raise OtherRun(
                f"{self.path.parent} holds trials of another configuration, seed or version of "
                "the code"
            )
        if self._beside is not None:
            told = self._beside._told.get(index, ())
            if told and checksum(line) not in told:
                raise ValueError("its checksum is another")
        if CHECKSUM in record:
            self._told[index] = (*self._told.get(index, ()), record[CHECKSUM])
        return index


@contextmanager
def replaced(path: Path) -> Iterator[BinaryIO]:
    """A file to be written anew: at any moment there is the old one or the new one, whole.

    Where writing fails the old one stays, and OSError names the file.
    """
    partial = path.with_name(path.name + ".partial")
    with named(path):
        try:
            with partial.open("wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            partial.replace(path)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise


@contextmanager
def named(path: Path) -> Iterator[None]:
    """An OSError that does not say of which file it is says it."""
    try:
        yield
    except OSError as error:
        if error.filename is not None or error.strerror is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error

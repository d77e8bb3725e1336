"""Many things of a few numbers each, kept as these numbers: of a scan each tenth of a second there soon are millions."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, ClassVar, Generic, Self, TypeVar, overload

import numpy as np

_Kept = TypeVar("_Kept")
_From = TypeVar("_From")
_ROWS = 1024
"""Of a block. Chosen: little of the last one is empty, and no row is ever moved, which leaves holes behind."""


class MadeWhenAsked(Sequence[_Kept], Generic[_Kept]):
    """Things that are made when they are asked for; those of a slice as they are then."""

    @abstractmethod
    def _one(self, at: int) -> _Kept:
        """One of them, counted from 0."""

    @overload
    def __getitem__(self, at: int) -> _Kept: ...
    @overload
    def __getitem__(self, at: slice) -> Sequence[_Kept]: ...
    def __getitem__(self, at: int | slice) -> _Kept | Sequence[_Kept]:
        rows = range(len(self))[at]
        return Seen(self, rows, _itself) if isinstance(rows, range) else self._one(rows)


class PackedRows(MadeWhenAsked[_Kept]):
    """A list of things that are made anew, of the numbers of what was put in, whenever one is asked for.

    A class of these says what a row is made of, and how a thing is made of it. `copy.copy` of one is another list.
    """

    DTYPE: ClassVar[np.dtype[Any]]

    def __init__(self, things: Iterable[_Kept] = ()) -> None:
        self._blocks, self._count = list[np.ndarray](), 0
        self._is_closed = False
        for thing in things:
            self.append(thing)

    def close(self) -> Self:
        """No more is put in, or changed, but in copies."""
        self._is_closed = True
        return self

    @staticmethod
    @abstractmethod
    def packed(thing: _Kept) -> tuple[Any, ...]:
        """The numbers of a thing, in the order of DTYPE."""

    @staticmethod
    @abstractmethod
    def unpacked(row: tuple[Any, ...]) -> _Kept:
        """The thing that these numbers were of."""

    def append(self, thing: _Kept) -> None:
        """One more. Raises TypeError where it was closed."""
        self._check_open()
        block, row = divmod(self._count, _ROWS)
        if block == len(self._blocks):
            self._blocks.append(np.empty(_ROWS, self.DTYPE))
        elif row == len(self._blocks[block]):  # of a copy
            more = np.empty(_ROWS - row, self.DTYPE)
            self._blocks[block] = np.concatenate([self._blocks[block], more])
        self._blocks[block][row] = self.packed(thing)
        self._count += 1

    def column(self, name: str) -> np.ndarray:
        """(N,) one number of each."""
        parts = [block[name] for block in self._blocks] or [np.empty(0, self.DTYPE)[name]]
        return np.concatenate(parts)[: self._count]

    def some(self, rows: np.ndarray) -> Self:
        """Another list of those of some numbers (R,)."""
        whole = np.concatenate([*self._blocks, np.empty(0, self.DTYPE)])[rows]
        other = type(self)()
        other._blocks = [whole[at : at + _ROWS].copy() for at in range(0, len(whole), _ROWS)]
        other._count = len(whole)
        return other

    def columns(self, *names: str) -> np.ndarray:
        """(N, ...) some numbers of each."""
        return np.stack([self.column(name) for name in names], axis=1)

    def __len__(self) -> int:
        return self._count

    def _one(self, at: int) -> _Kept:
        block, row = divmod(at, _ROWS)
        return self.unpacked(self._blocks[block].item(row))

    def __setitem__(self, at: int, thing: _Kept) -> None:
        self._check_open()
        block, row = divmod(range(self._count)[at], _ROWS)
        self._blocks[block][row] = self.packed(thing)

    def _filled(self) -> Iterator[np.ndarray]:
        """The rows, block by block, to be changed in place. Raises TypeError where it was closed."""
        self._check_open()
        for at, block in enumerate(self._blocks):
            yield block[: self._count - _ROWS * at]

    def _check_open(self) -> None:
        if self._is_closed:
            raise TypeError("these are read only: change a copy, as copy.copy makes it")

    def __copy__(self) -> Self:
        other = type(self)()
        rest = self._count - _ROWS * (len(self._blocks) - 1)
        other._blocks = [block.copy() for block in self._blocks[:-1]]
        other._blocks += [block[:rest].copy() for block in self._blocks[-1:]]
        other._count = self._count
        return other


class Seen(MadeWhenAsked[_Kept]):
    """What something makes of some of a sequence, one at a time: nothing of it is kept."""

    def __init__(self, of: Sequence[_From], rows: range, made: Callable[[_From], _Kept]) -> None:
        self._of: Sequence[Any] = of
        self._rows, self._made = rows, made

    def __len__(self) -> int:
        return len(self._rows)

    def _one(self, at: int) -> _Kept:
        return self._made(self._of[self._rows[at]])


def each(of: Sequence[_From], made: Callable[[_From], _Kept]) -> Sequence[_Kept]:
    """What something makes of each of a sequence."""
    return Seen(of, range(len(of)), made)


def _itself(one: _Kept) -> _Kept:
    return one

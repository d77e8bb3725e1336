"""Work that is done a piece at a time: the next scan need not wait for all of it."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeAlias, TypeVar

_Result = TypeVar("_Result")

Steps: TypeAlias = Generator[int, None, _Result]
"""Yields before each piece what it costs, in looks at what one scan says for one pose; returns what
comes of all."""


def all_at_once(steps: Steps[_Result]) -> _Result:
    """The result, with nothing in between."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: _Result = end.value
            return result

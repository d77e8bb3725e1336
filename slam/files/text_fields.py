"""Text of strangers: numbers in a line of a file, and what is shown of the rest."""

from __future__ import annotations

import math
from collections.abc import Sequence

_SHOWN = 40
"""Letters of what is none."""


def in_one_line(text: str, most: int) -> str:
    """So many letters of a stranger's text; what would end a line, or cannot be seen, as '?'."""
    return "".join(letter if letter.isprintable() else "?" for letter in text[:most])


def numbers(fields: Sequence[str], place: str) -> list[float]:
    """The fields as numbers. Raises ValueError that starts with the place where one is none."""
    try:
        return [float(field) for field in fields]
    except ValueError:
        bad = next(field for field in fields if not is_number(field))
        more = "..." if len(bad) > _SHOWN else ""
        said = f"{place}: expected a number, found {bad[:_SHOWN]!r}{more}"
        raise ValueError(said) from None


def finite_numbers(fields: Sequence[str], place: str) -> list[float]:
    """The same; raises ValueError for inf and nan as well."""
    found = numbers(fields, place)
    if not all(map(math.isfinite, found)):
        raise ValueError(f"{place}: a number is not finite")
    return found


def is_number(field: str) -> bool:
    """Whether a field is a number, be it inf or nan."""
    try:
        float(field)
    except ValueError:
        return False
    return True

"""Numbers of `summary.json` as a page shows them, each with the key under which it stands there."""

import math
from dataclasses import dataclass
from typing import Any

NOTHING = "-"


@dataclass(frozen=True)
class Number:
    """One number. key: its way through the file, by dots; scale: what it is shown in units of."""

    key: str
    value: float
    text: str
    scale: float = 1.0


Part = Number | str
Cell = list[Part]


def number(
    content: dict[str, Any], key: str, digits: int = 2, scale: float = 1.0, unit: str = ""
) -> Cell:
    """The number under a key, with its unit; a dash where there is null or no such key.

    Raises ValueError where there is something else.
    """
    value: Any = content
    for word in key.split("."):
        value = value[int(word)] if isinstance(value, list | tuple) else (value or {}).get(word)
    if value is None:
        return [NOTHING]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{key} is no number: {value!r}")
    shown = float(f"{scale * value:.{digits}f}") + 0.0  # no minus before a zero
    return [Number(key, value, f"{shown:.{digits}f}", scale), *([unit] if unit else [])]


def interval(content: dict[str, Any], key: str, digits: int = 2, scale: float = 1.0) -> Cell:
    """The two ends of an interval in brackets; nothing where it is null or was never worked out."""
    ends = [number(content, f"{key}.{end}", digits, scale) for end in (0, 1) if _has(content, key)]
    if len(ends) < 2:
        return []
    return [" [", *ends[0], ", ", *ends[1], "]"]


def _has(content: dict[str, Any], key: str) -> bool:
    value: Any = content
    for word in key.split("."):
        value = value.get(word) if isinstance(value, dict) else None
    return isinstance(value, list | tuple) and len(value) == 2

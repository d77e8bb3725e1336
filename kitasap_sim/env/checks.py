"""Numbers that users give, checked: what is none is refused by the name under which it came."""

from numbers import Real
from typing import Any

import numpy as np


def finite_numbers(values: Any, shape: tuple[int | None, ...], expected: str) -> np.ndarray:
    """The values as finite numbers of a shape, in which None stands for any length.

    Raises ValueError, saying what was expected and what came, for anything else.
    """
    try:
        array = np.asarray(values)
    except ValueError:  # rows of different lengths
        array = np.empty(0, dtype=object)
    fits = array.ndim == len(shape) and all(
        wanted is None or wanted == found for wanted, found in zip(shape, array.shape, strict=True)
    )
    if not fits or array.dtype.kind not in "iuf" or not np.isfinite(array).all():
        raise ValueError(f"{expected}, not {values!r}")
    return array.astype(float)


def number_between(value: Any, least: float, most: float, name: str) -> float:
    """The value, a number from least to most. Raises ValueError for anything else."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not least <= float(value) <= most:
        raise ValueError(f"{name}: from {least:g} to {most:g}, not {value!r}")
    return float(value)

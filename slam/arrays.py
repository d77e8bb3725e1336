"""Checks of arrays at the border of the library, made once when a type is created."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
_Number = TypeVar("_Number", bound=np.generic)


def frozen_array(values: ArrayLike, shape: tuple[int | None, ...], name: str) -> FloatArray:
    """A read-only float64 copy of the values; None in `shape` stands for any length. Values that are that
    already, and no view of others, are taken over, not copied: all scans of a laser have one array of
    angles. Whoever froze it writes to it no more.

    Raises ValueError when the shape is another one.
    """
    is_frozen = False
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        flags = values.flags
        is_frozen = flags.owndata and not flags.writeable
        if is_frozen and values.shape == shape:
            return values
    array = np.array(values, dtype=np.float64, copy=not is_frozen)
    fits = array.shape == shape or (
        array.ndim == len(shape)
        and all(
            expected is None or expected == found
            for expected, found in zip(shape, array.shape, strict=True)
        )
    )
    if not fits:
        expected_text = ", ".join("N" if size is None else str(size) for size in shape)
        raise ValueError(f"{name} must have shape ({expected_text}), not {array.shape}")
    array.flags.writeable = False
    return array


def read_only(array: FloatArray) -> FloatArray:
    """The same values, not to be written through: compiled code is made once more for arrays that may be,
    and a scan of the robot would wait for that."""
    view = array.view()
    view.flags.writeable = False
    return view


def diagonal_of(sigma: Sequence[float]) -> FloatArray:
    """(N, N) covariance of N standard deviations that have nothing to do with each other, read-only."""
    return _diagonal_of(tuple(sigma))


@lru_cache(maxsize=64)
def _diagonal_of(sigma: tuple[float, ...]) -> FloatArray:
    return read_only(np.diag(np.square(sigma)))


def checked_points(points: ArrayLike, name: str) -> FloatArray:
    """The points as float64 (N, 2), not copied when they are so already.

    Raises ValueError when they are not (N, 2) or not all finite.
    """
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 2:
        raise ValueError(f"{name} must have shape (N, 2), not {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite; use LaserScan.points, which drops no-returns")
    return array


def run_lengths(flags: BoolArray) -> IntArray:
    """(R,) how many neighbours are True in each run of such, in their order."""
    padded = np.concatenate([[False], flags, [False]])
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return np.asarray(edges[1::2] - edges[::2], dtype=np.int64)


def lengthened(array: NDArray[_Number], count: int) -> NDArray[_Number]:
    """An array (N, ...) with so many rows of zeros after it, which take memory once they are written to."""
    longer = np.zeros((len(array) + count, *array.shape[1:]), array.dtype)
    longer[: len(array)] = array
    return longer

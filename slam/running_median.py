"""The median of the last of many values."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray
from slam.kernels.running_median import take_among


class RunningMedian:
    """Of the last `most` values; kept in order, so that a value more costs no sorting."""

    def __init__(self, most: int) -> None:
        self._last: FloatArray = np.empty(most)
        self._in_order: FloatArray = np.empty(most)
        self._taken, self._median = 0, math.nan

    def __len__(self) -> int:
        return min(self._taken, len(self._last))

    def take(self, value: float) -> None:
        """Another value, which is a number and no NaN: that has no place in an order."""
        self._median = take_among(self._last, self._in_order, self._taken, value)
        self._taken += 1

    @property
    def median(self) -> float:
        """The mean of the two in the middle of an even number. Raises IndexError: there is no value."""
        if self._taken == 0:
            raise IndexError("a median is of one value at least: take one first")
        return self._median

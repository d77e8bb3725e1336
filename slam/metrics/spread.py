"""What is told of many errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Spread:
    """Errors in one unit, none negative: how large they are, and how many; all nan if there are none.

    std: around the mean, over all (not n - 1). q95, q99: quantiles.
    """

    count: int
    mean: float
    std: float
    rmse: float
    median: float
    q95: float
    q99: float
    max: float

    @staticmethod
    def of(errors: ArrayLike) -> Spread:
        """Of errors (N,), whose sign is left out."""
        sizes = np.abs(np.asarray(errors, dtype=np.float64))
        if len(sizes) == 0:
            return Spread(0, *[float("nan")] * 7)
        return Spread(
            len(sizes),
            float(sizes.mean()),
            float(sizes.std()),
            float(np.sqrt(np.mean(sizes**2))),
            *(float(value) for value in np.quantile(sizes, [0.5, 0.95, 0.99, 1.0])),
        )

    def scaled(self, factor: float) -> Spread:
        """The same in another unit."""
        sizes = (self.mean, self.std, self.rmse, self.median, self.q95, self.q99, self.max)
        return Spread(self.count, *(factor * size for size in sizes))

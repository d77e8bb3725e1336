"""How uncertain a laser's ranges are, and what that makes a point worth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.arrays import FloatArray

_MAX_REPEATS = 4
"""Chosen: 2.7 mm became 2.6 mm at most beyond it, for twice the time (100 poses, room_fig4)."""


@dataclass(frozen=True)
class RangeNoise:
    """Standard deviation of a laser's ranges: points (range [m], sigma [m]), straight between.

    Constant outside the points. Raises ValueError unless ranges increase and sigmas are above 0.
    """

    sigma_at_m: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        at_m = [at for at, _ in self.sigma_at_m]
        if not at_m or sorted(set(at_m)) != at_m or not all(map(math.isfinite, at_m)):
            raise ValueError(f"sigma_at_m needs increasing ranges, not {self.sigma_at_m}")
        if not all(math.isfinite(sigma) and sigma > 0.0 for _, sigma in self.sigma_at_m):
            raise ValueError(f"sigma_at_m needs sigmas above 0, not {self.sigma_at_m}")

    def sigma_m(self, ranges_m: ArrayLike) -> FloatArray:
        """(N,) standard deviation at each range (N,) [m]."""
        at_m, sigma_m = np.array(self.sigma_at_m).T
        return np.asarray(np.interp(np.asarray(ranges_m, dtype=np.float64), at_m, sigma_m))

    def repeats(self, ranges_m: ArrayLike) -> NDArray[np.intp]:
        """(N,) how often to count each point in a fit that knows no weights: once to four times.

        Least squares wants weights of 1 / sigma**2; a point given twice weighs twice. A point of
        median noise counts twice. All ones where the noise is the same everywhere.
        """
        sigma_m = self.sigma_m(ranges_m)
        if sigma_m.size == 0 or np.ptp(sigma_m) == 0.0:
            return np.ones(sigma_m.shape, dtype=np.intp)
        weights = 2.0 * (np.median(sigma_m) / sigma_m) ** 2
        return np.clip(np.rint(weights), 1, _MAX_REPEATS).astype(np.intp)

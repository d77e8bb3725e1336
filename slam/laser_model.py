"""What an estimator assumes of a laser. What the laser really does is another matter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slam.arrays import FloatArray
from slam.range_noise import RangeNoise


@dataclass(frozen=True)
class LaserModel:
    """The likelihood of a range, given the distance to the wall that the map has there.

    noise: standard deviation by range. range_min_m, range_max_m: what the laser can measure; walls
    outside are expected to give nothing. outlier_ratio: share of beams that tell nothing of the
    map (people, things moved), anywhere in the range with equal probability. mixed_ratio: share of
    the beams beside an edge that measure anything between the near and the far side of it.
    Raises ValueError where these do not fit together.
    """

    noise: RangeNoise
    range_min_m: float = 0.0
    range_max_m: float = 30.0
    outlier_ratio: float = 0.05
    mixed_ratio: float = 0.2

    def __post_init__(self) -> None:
        if not 0.0 <= self.range_min_m < self.range_max_m < math.inf:
            raise ValueError(
                f"a laser needs 0 <= range_min_m < range_max_m, finite,"
                f" not {self.range_min_m} and {self.range_max_m}"
            )
        if not (0.0 < self.outlier_ratio < 1.0 and 0.0 <= self.mixed_ratio < 1.0):
            raise ValueError(
                "outlier_ratio must lie between 0 and 1, mixed_ratio from 0 to below 1,"
                f" not at {self.outlier_ratio} and {self.mixed_ratio}"
            )

    @cached_property
    def outliers(self) -> FloatArray:
        """(2,) odds against a good beam: of an outlier, per metre of range [1/m]; of a mixed pixel."""
        span_m = self.range_max_m - self.range_min_m
        odds = self.outlier_ratio / (1.0 - self.outlier_ratio) / span_m
        return np.array([odds, self.mixed_ratio / (1.0 - self.mixed_ratio)])

    @cached_property
    def noise_table(self) -> FloatArray:
        """(K, 2) range [m] and standard deviation there [m]."""
        return np.array(self.noise.sigma_at_m, dtype=np.float64)

    @cached_property
    def limits_m(self) -> FloatArray:
        """(2,) smallest and largest range [m]."""
        return np.array([self.range_min_m, self.range_max_m])

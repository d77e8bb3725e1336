"""Points that fill a Gaussian evenly, the same ones always: for sums over what a Gaussian covers."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from slam.arrays import FloatArray, frozen_array

_BASES = (2, 3, 5)


def standard_normal_points(count: int) -> FloatArray:
    """(count, 3) points of a standard normal distribution; any long stretch of them fills it too.

    Halton's sequence (Halton, Numerische Mathematik 2, 1960) through the inverse of the normal
    distribution.
    """
    normal = NormalDist()
    points = [
        [normal.inv_cdf(_radical_inverse(number, base)) for base in _BASES]
        for number in range(1, count + 1)
    ]
    return frozen_array(np.array(points), (None, 3), "points")


def _radical_inverse(number: int, base: int) -> float:
    """The number's digits in a base, mirrored about the point: 6 in base 2, 110, gives 0.011."""
    value, place = 0.0, 1.0 / base
    while number:
        number, digit = divmod(number, base)
        value += digit * place
        place /= base
    return value

"""What the noise of a scan makes of its information, taken off that."""

from __future__ import annotations

import numpy as np

from slam.arrays import FloatArray
from slam.kernels import compiled
from slam.kernels.normal_equations import lower_root_into

_LEAST_LEFT = 0.1
"""Share of a scan's information that is left along any direction: how much of it noise makes is itself
known roughly. Chosen."""
_LEAST_KNOWN = 1e-9
"""Of the largest entry: a scan that tells less along some direction has nothing to be taken off."""


@compiled
def take_off(information: FloatArray, noise: FloatArray) -> None:
    """Information (3, 3) less what noise (3, 3) makes of it, in place; along each direction of both
    some is left."""
    root, left, other = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    largest = max(information[0, 0], information[1, 1], information[2, 2])
    if not lower_root_into(information, _LEAST_KNOWN * largest, root):
        return
    for j in range(3):
        for k in range(3):
            left[j, k] = (1.0 - _LEAST_LEFT) * information[j, k] - noise[j, k]
    if not lower_root_into(left, 0.0, other):
        _take_most_off(information, noise, root)
        return
    for j in range(3):
        for k in range(3):
            information[j, k] -= noise[j, k]


@compiled
def _take_most_off(information: FloatArray, noise: FloatArray, root: FloatArray) -> None:
    """As `take_off`, where noise makes too much of it along some direction; root: (3, 3) of information.

    Apart, and seldom: what finds directions is so much code that it drives all else from the cache, which
    took a twentieth of the front end's time.
    """
    # the noise where information is the same along all directions, and equal to one
    scaled = _divided(_divided(noise, root).T.copy(), root)
    shares, directions = np.linalg.eigh(0.5 * (scaled + scaled.T))
    along = np.empty(3)
    for k in range(3):
        share = min(shares[k], 1.0 - _LEAST_LEFT)
        if share > 0.0:
            for i in range(3):
                along[i] = 0.0
                for j in range(i + 1):
                    along[i] += root[i, j] * directions[j, k]
            for i in range(3):
                for j in range(3):
                    information[i, j] -= share * along[i] * along[j]


@compiled
def _divided(matrix: FloatArray, root: FloatArray) -> FloatArray:
    """The solution (3, 3) of root @ out = matrix, of a lower root. NumPy's, which asks for none, takes
    a machine seven seconds to compile."""
    out = np.empty((3, 3))
    for k in range(3):
        for i in range(3):
            left = matrix[i, k]
            for j in range(i):
                left -= root[i, j] * out[j, k]
            out[i, k] = left / root[i, i]
    return out

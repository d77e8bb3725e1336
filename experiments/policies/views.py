"""What would be seen anew from spots of a grid; an inner loop, compiled."""

import numpy as np

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.kernels import compiled

_RAYS = 72
_FAR_CELLS = 60
_DEEP_CELLS = 12
"""Chosen: rays of 3 m, no more than 0.6 m of it through what was not seen: it may hide a wall."""


@compiled
def unseen_from(
    is_seen: BoolArray,
    is_blocked: BoolArray,
    cells: IntArray,
) -> FloatArray:
    """(K, 3) from cells (K, 2): area not seen yet [cells], and x, y of its middle from there."""
    columns, rows = is_seen.shape
    found = np.zeros((len(cells), 3))
    for n in range(len(cells)):
        for ray in range(_RAYS):
            angle = 2.0 * np.pi * ray / _RAYS
            dx, dy = np.cos(angle), np.sin(angle)
            deep = 0
            for k in range(1, _FAR_CELLS):
                i = int(cells[n, 0] + 0.5 + k * dx)
                j = int(cells[n, 1] + 0.5 + k * dy)
                if i < 0 or j < 0 or i >= columns or j >= rows or is_blocked[i, j]:
                    break
                if is_seen[i, j]:
                    continue
                deep += 1
                if deep > _DEEP_CELLS:
                    break
                area = k * 2.0 * np.pi / _RAYS
                found[n, 0] += area
                found[n, 1] += area * k * dx
                found[n, 2] += area * k * dy
        if found[n, 0] > 0.0:
            found[n, 1] /= found[n, 0]
            found[n, 2] /= found[n, 0]
    return found

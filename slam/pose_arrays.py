"""Many poses at once: rows (x, y, theta) of an array (N, 3), as `SE2` is one."""

from __future__ import annotations

import numpy as np

from slam.arrays import FloatArray
from slam.se2 import wrap_angle


def composed(first: FloatArray, second: FloatArray) -> FloatArray:
    """`first @ second`, row by row; either may be a single row."""
    c, s = np.cos(first[..., 2]), np.sin(first[..., 2])
    x, y = second[..., 0], second[..., 1]
    columns = [
        first[..., 0] + c * x - s * y,
        first[..., 1] + s * x + c * y,
        wrap_angle(np.asarray(first[..., 2] + second[..., 2])),
    ]
    return np.stack(columns, axis=-1)


def between(first: FloatArray, second: FloatArray) -> FloatArray:
    """`first.inverse() @ second`, row by row: the second pose seen from the first."""
    c, s = np.cos(first[..., 2]), np.sin(first[..., 2])
    x, y = second[..., 0] - first[..., 0], second[..., 1] - first[..., 1]
    columns = [
        c * x + s * y,
        -s * x + c * y,
        wrap_angle(np.asarray(second[..., 2] - first[..., 2])),
    ]
    return np.stack(columns, axis=-1)

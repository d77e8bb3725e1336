"""Inner loops of the tasks, compiled by Numba once on each machine."""

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def see(
    is_left: np.ndarray,
    at: tuple[float, float, float],
    angles: np.ndarray,
    ranges: np.ndarray,
    reach: float,
) -> int:
    """How many cells (R, C) of those left the beams go through; these are left no more.

    at: row, column and heading of the laser, lengths in cells. angles, ranges: (N,) of the beams in
    its frame; each is looked at in the middle of every cell's length, no farther than reach.
    """
    rows, columns = is_left.shape
    x, y, heading = at
    count = 0
    for i in range(len(angles)):
        along_x, along_y = math.cos(heading + angles[i]), math.sin(heading + angles[i])
        way, end = 0.5, min(ranges[i], reach)
        while way < end:
            row, column = math.floor(x + way * along_x), math.floor(y + way * along_y)
            if 0 <= row < rows and 0 <= column < columns and is_left[row, column]:
                is_left[row, column] = False
                count += 1
            way += 1.0
    return count

"""Beams through the cells of a grid, cell by cell: slow and obvious."""

import math

import numpy as np


def free_length(solid: np.ndarray, x: float, y: float, angle: float) -> float:
    """How far a beam gets from a point until a solid cell or the end of the grid [cells].

    Amanatides and Woo, 1987.
    """
    column, row = math.floor(x), math.floor(y)
    dx, dy = math.cos(angle), math.sin(angle)
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    next_x = ((column + (dx > 0)) - x) / dx if dx else math.inf
    next_y = ((row + (dy > 0)) - y) / dy if dy else math.inf
    length = 0.0
    rows, columns = solid.shape
    while 0 <= row < rows and 0 <= column < columns and not solid[row, column]:
        if next_x < next_y:
            length, next_x, column = next_x, next_x + abs(1 / dx), column + step_x
        else:
            length, next_y, row = next_y, next_y + abs(1 / dy), row + step_y
    return length

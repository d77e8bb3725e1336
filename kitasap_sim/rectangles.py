"""Rectangles that tile a mask: few boxes in place of many cells."""

import numpy as np


def rectangles(mask: np.ndarray, at_most: int) -> np.ndarray:
    """(B, 4) rows and columns [first, end) of rectangles that cover the mask exactly, none twice.

    Greedy: from the first cell that is left, in order of the rows, as wide as it goes, then as high.
    Each row is first_row, first_column, end_row, end_column.
    Raises ValueError if more than `at_most` are needed.
    """
    left = np.array(mask, dtype=bool)
    rows, columns = left.shape
    found: list[tuple[int, int, int, int]] = []
    for row in range(rows):
        first = 0
        while first < columns:
            line = left[row, first:]
            start = first + int(line.argmax())
            if not left[row, start]:
                break
            is_gap = ~left[row, start:]
            end = start + int(is_gap.argmax()) if is_gap.any() else columns
            bottom = row + 1
            while bottom < rows and left[bottom, start:end].all():
                bottom += 1
            left[row:bottom, start:end] = False
            found.append((row, start, bottom, end))
            if len(found) > at_most:
                raise ValueError(f"more than {at_most} rectangles")
            first = end
    return np.array(found, dtype=int).reshape(-1, 4)

"""Where most points of a scan fall on surfaces of a map: see `slam.kernels.surface_map`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray, IntArray
from slam.kernels import compiled
from slam.kernels.surface_map import COLUMN, HELD, LEVEL, ROW, SIDES, STATE, USES, sides_of


@compiled
def count_on_walls(
    heads: NDArray[np.int32],
    sums: NDArray[np.float32],
    level: int,
    cell_m: float,
    points: FloatArray,
    least_x: float,
    least_y: float,
    headings: FloatArray,
    counts: NDArray[np.int32],
) -> None:
    """Into counts (H, X, Y): how many points (N, 3), base frame, fall into cells that have some.

    Of poses half a cell apart from least_x, least_y on [m], and at headings (H,) [rad].
    """
    half_m = 0.5 * cell_m
    reach_m = 0.0
    for i in range(points.shape[0]):
        reach_m = max(reach_m, math.hypot(points[i, 0], points[i, 1]))
    first_column = math.floor((least_x - reach_m) / cell_m) - 1
    first_row = math.floor((least_y - reach_m) / cell_m) - 1
    most_x, most_y = least_x + counts.shape[1] * half_m, least_y + counts.shape[2] * half_m
    columns = math.floor((most_x + reach_m) / cell_m) + 2 - first_column
    rows = math.floor((most_y + reach_m) / cell_m) + 2 - first_row
    # a bit for each side that has points, of half cells: from pose to pose a point moves by one, and
    # what lies in a row is looked up many at a time
    held = np.zeros((2 * columns, 2 * rows), np.uint8)
    for entry in range(heads.shape[0]):
        sides = np.uint8(heads[entry, STATE] >> HELD)
        if heads[entry, USES] <= 0 or heads[entry, STATE] >> LEVEL != level or sides == 0:
            continue
        a, b = heads[entry, COLUMN] - first_column, heads[entry, ROW] - first_row
        if 0 <= a < columns and 0 <= b < rows:
            for side in range(SIDES):
                if sums[entry, side, 0] < 0.5:
                    sides &= ~np.uint8(1 << side)
            for u in range(2):
                for v in range(2):
                    held[2 * a + u, 2 * b + v] = sides
    for k in range(headings.shape[0]):
        c, s = math.cos(headings[k]), math.sin(headings[k])
        for u in range(counts.shape[1]):
            for v in range(counts.shape[2]):
                counts[k, u, v] = 0
        for i in range(points.shape[0]):
            if math.isnan(points[i, 2]):
                continue
            px, py = points[i, 0], points[i, 1]
            # unsigned, lest each look up asks whether it counts from the end
            column = np.uint64(math.floor((least_x + c * px - s * py) / half_m) - 2 * first_column)
            row = np.uint64(math.floor((least_y + s * px + c * py) / half_m) - 2 * first_row)
            near, far = sides_of(points[i, 2] + headings[k])
            asked = np.uint8((1 << near) | (1 << far))
            for u in range(counts.shape[1]):
                seen = held[column + np.uint64(u)]
                for v in range(counts.shape[2]):
                    counts[k, u, v] += (seen[row + np.uint64(v)] & asked) != 0


@compiled
def peaks_into(counts: NDArray[np.int32], apart: tuple[int, int, int], peaks: IntArray) -> int:
    """Into peaks (K, 3): where counts (H, X, Y) are largest, one after the other; none within `apart` of a
    larger one, each way, and none that counts nothing. How many there are; counts about them are lost."""
    for found in range(peaks.shape[0]):
        most = 0
        for k in range(counts.shape[0]):
            for u in range(counts.shape[1]):
                for v in range(counts.shape[2]):
                    if counts[k, u, v] > most:
                        most = counts[k, u, v]
                        peaks[found, 0], peaks[found, 1], peaks[found, 2] = k, u, v
        if most == 0:
            return found
        middle = peaks[found]
        for k in range(
            max(middle[0] - apart[0], 0), min(middle[0] + apart[0] + 1, counts.shape[0])
        ):
            for u in range(
                max(middle[1] - apart[1], 0), min(middle[1] + apart[1] + 1, counts.shape[1])
            ):
                for v in range(
                    max(middle[2] - apart[2], 0), min(middle[2] + apart[2] + 1, counts.shape[2])
                ):
                    counts[k, u, v] = 0
    return int(peaks.shape[0])

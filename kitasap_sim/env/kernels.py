"""Inner loops of the tasks, compiled by Numba once on each machine."""

import math

import numpy as np

from kitasap_sim.compiled import compiled


@compiled
def see(
    is_left: np.ndarray,
    before: np.ndarray,
    now: np.ndarray,
    shares: np.ndarray,
    angles: np.ndarray,
    ranges: np.ndarray,
    reach: float,
) -> int:
    """How many cells (R, C) of those left the beams go through; these are left no more.

    before, now: (3,) row, column and heading of the laser at the start and at the end of a step,
    lengths in cells; shares: (N,) of the step, after which each beam is fired. angles, ranges: (N,)
    of the beams in the laser's frame; no beam counts farther than reach. From cell to cell as
    Amanatides and Woo (Eurographics 1987) go.
    """
    rows, columns = is_left.shape
    count = 0
    for i in range(len(angles)):
        x = before[0] + shares[i] * (now[0] - before[0])
        y = before[1] + shares[i] * (now[1] - before[1])
        heading = before[2] + shares[i] * (now[2] - before[2]) + angles[i]
        along_x, along_y = math.cos(heading), math.sin(heading)
        end = min(ranges[i], reach)
        row, column = math.floor(x), math.floor(y)
        step_row = 1 if along_x > 0.0 else -1
        step_column = 1 if along_y > 0.0 else -1
        # how far along the beam the next row and the next column begin, and one is wide
        wide_row = 1.0 / max(abs(along_x), 1e-12)
        wide_column = 1.0 / max(abs(along_y), 1e-12)
        next_row = (row + 1 - x if along_x > 0.0 else x - row) * wide_row
        next_column = (column + 1 - y if along_y > 0.0 else y - column) * wide_column
        way = 0.0
        while way < end:
            if 0 <= row < rows and 0 <= column < columns and is_left[row, column]:
                is_left[row, column] = False
                count += 1
            if next_row < next_column:
                way = next_row
                next_row += wide_row
                row += step_row
            else:
                way = next_column
                next_column += wide_column
                column += step_column
    return count


@compiled
def look_around(
    is_open: np.ndarray,
    spots: np.ndarray,
    rays: int,
    reach: float,
    step: float,
    share: float,
    is_seen: np.ndarray,
) -> None:
    """Marks in coarser cells (R, C) what rays all around from spots (K, 2) go through while they are
    over open cells (r, c), up to reach, looked at each step; lengths in cells, share of a coarse one.
    """
    rows, columns = is_open.shape
    for k in range(spots.shape[0]):
        for ray in range(rays):
            angle = 2.0 * math.pi * ray / rays
            along_x, along_y = math.cos(angle), math.sin(angle)
            way = 0.0
            while way < reach:
                x, y = spots[k, 0] + way * along_x, spots[k, 1] + way * along_y
                row, column = math.floor(x), math.floor(y)
                if not (0 <= row < rows and 0 <= column < columns and is_open[row, column]):
                    break
                is_seen[math.floor(x * share), math.floor(y * share)] = True
                way += step


@compiled
def leg_at(at: np.ndarray, along: float) -> int:
    """The leg of a polyline, lengths at (K,) at its corners, on which a length lies."""
    leg = 0
    while leg < len(at) - 2 and at[leg + 1] <= along:
        leg += 1
    return leg


@compiled
def nearest_along(
    corners: np.ndarray, at: np.ndarray, x: float, y: float, low: float, high: float
) -> tuple[float, float]:
    """Length along a polyline of corners (K, 2), between two, that is nearest to a point; how far."""
    best, best_off = low, math.inf
    for leg in range(leg_at(at, low), leg_at(at, high) + 1):
        x0, y0 = corners[leg, 0], corners[leg, 1]
        dx, dy = corners[leg + 1, 0] - x0, corners[leg + 1, 1] - y0
        length = at[leg + 1] - at[leg]
        along = ((x - x0) * dx + (y - y0) * dy) / length
        along = min(max(along, low - at[leg], 0.0), high - at[leg], length)
        share = along / length
        off = math.hypot(x - x0 - share * dx, y - y0 - share * dy)
        if off < best_off:
            best, best_off = at[leg] + along, off
    return best, best_off


@compiled
def seen_along(
    corners: np.ndarray, at: np.ndarray, lengths: np.ndarray, pose: np.ndarray, points: np.ndarray
) -> None:
    """Points (L, 2) of a polyline at lengths (L,) along it, in the frame of a pose (3,); its ends
    beyond."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(len(lengths)):
        leg = leg_at(at, lengths[i])
        share = min(max((lengths[i] - at[leg]) / (at[leg + 1] - at[leg]), 0.0), 1.0)
        dx = corners[leg, 0] + share * (corners[leg + 1, 0] - corners[leg, 0]) - pose[0]
        dy = corners[leg, 1] + share * (corners[leg + 1, 1] - corners[leg, 1]) - pose[1]
        points[i, 0] = c * dx + s * dy
        points[i, 1] = c * dy - s * dx

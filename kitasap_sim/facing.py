"""Which side of a cut surface is open: beams meet it from there only."""

import numpy as np

_ASIDE_M = 1e-5
"""Far above rounding, far below the thinnest sheet."""


def facing_out(segments: np.ndarray) -> np.ndarray:
    """(T, 2, 2) the outline (S, 2, 2) of one solid [m], each with the open side on its left.

    By the even-odd rule. Where it finds both sides open (a sheet that is no solid), the segment
    comes once in each direction.
    """
    if len(segments) < 3:  # encloses nothing: a wall made of a plane
        return np.concatenate([segments, segments[:, ::-1]])
    along = segments[:, 1] - segments[:, 0]
    lengths_m = np.hypot(*along.T)
    segments, along, lengths_m = (a[lengths_m > 0] for a in (segments, along, lengths_m))
    aside = _ASIDE_M * np.stack([-along[:, 1], along[:, 0]], axis=1) / lengths_m[:, None]
    middles = segments.mean(axis=1)
    is_open_left = ~_is_inside(middles + aside, segments)
    is_open_right = ~_is_inside(middles - aside, segments)
    # inside on either side is a seam between two parts of one mesh: no beam gets there, keep it once
    keeps = is_open_left | ~is_open_right
    return np.concatenate([segments[keeps], segments[is_open_right][:, ::-1]])


def _is_inside(points: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """(K,) whether points (K, 2) lie within an outline (S, 2, 2): odd crossings to either side."""
    inside = np.zeros(len(points), dtype=bool)
    (ax, ay), (bx, by) = outline[:, 0].T, outline[:, 1].T
    is_level = ay == by
    slope = np.divide(bx - ax, by - ay, where=~is_level, out=np.zeros_like(ax))
    for k in range(0, len(points), 256):  # in parts: a mesh may have thousands of segments
        x, y = points[k : k + 256, 0, None], points[k : k + 256, 1, None]
        is_level_with, at_x = (ay > y) != (by > y), ax + (y - ay) * slope
        right, left = is_level_with & (x < at_x), is_level_with & (x > at_x)
        # beside a sheet, one of the two crosses it
        inside[k : k + 256] = (right.sum(axis=1) % 2 == 1) & (left.sum(axis=1) % 2 == 1)
    return inside

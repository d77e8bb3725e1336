"""Where the surfaces that a scan saw face."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray, IntArray
from slam.kernels import compiled
from slam.kernels.beam_points import points_into

_MOST_NEIGHBOURS = 20
"""Chosen: of a point, to either side, that its direction is taken from."""
_GRAZED_M = 0.1
"""Chosen: a laser that is nearer to the line of a wall cannot tell which of its sides it sees."""


@compiled
def faced_ends_into(
    origins: FloatArray,
    directions: FloatArray,
    ranges: FloatArray,
    farthest: float,
    seen_from: FloatArray,
    blocked_m: float,
    least: int,
    reach_m: float,
    faced: FloatArray,
) -> int:
    """Into the first rows of faced (N, 3): where beams end, see `points_into`, and face, see `facings_into`. How
    many; none, where fewer than `least` of them are farther than blocked_m from where they are seen from."""
    points, variances = np.empty((ranges.shape[0], 2)), np.empty(ranges.shape[0])
    count: int = points_into(origins, directions, ranges, farthest, points)
    far = 0
    for i in range(count):
        far += math.hypot(points[i, 0] - seen_from[0], points[i, 1] - seen_from[1]) > blocked_m
    if far < least:
        return 0
    facings_into(points[:count], seen_from, reach_m, True, faced, variances)
    return count


@compiled
def facings_into(
    points: FloatArray,
    seen_from: FloatArray,
    reach_m: float,
    is_lone_told: bool,
    faced: FloatArray,
    variances: FloatArray,
) -> None:
    """Into faced (N, 3): the points (N, 2) of a scan, in their order, and where their surface faces.

    That is the side of the line through a point's neighbours, within reach_m of it and up to
    _MOST_NEIGHBOURS to either side, on which the laser was, seen_from (2,); of a lone point, the way
    to the laser [rad]; nan where the laser saw along the line, and, unless is_lone_told, for points
    that are lone because their surface is seen flat. Into variances (N,): of that direction [rad2],
    by how those neighbours scatter about their line; inf of a lone point.
    """
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        n = sx = sy = sxx = sxy = syy = 0.0
        for side in range(-1, 2, 2):
            j = i + side
            taken = 0
            while 0 <= j < points.shape[0] and taken < _MOST_NEIGHBOURS:
                dx, dy = points[j, 0] - x, points[j, 1] - y
                if dx * dx + dy * dy > reach_m * reach_m:
                    break
                n += 1.0
                sx += dx
                sy += dy
                sxx += dx * dx
                sxy += dx * dy
                syy += dy * dy
                j += side
                taken += 1
        n += 1.0
        cxx, cxy = sxx - sx * sx / n, sxy - sx * sy / n
        cyy = syy - sy * sy / n
        variances[i] = math.inf
        to_x, to_y = seen_from[0] - x, seen_from[1] - y
        if n >= 3.0:
            along = 0.5 * math.atan2(2.0 * cxy, cxx - cyy)
            reaching = 0.5 * (cxx + cyy + math.sqrt((cxx - cyy) ** 2 + 4.0 * cxy * cxy))
            if reaching > 0.0:
                variances[i] = max(cxx + cyy - reaching, 0.0) / ((n - 2.0) * reaching)
            off = math.cos(along) * to_y - math.sin(along) * to_x
            # the normal lies a quarter of a turn from the line, to the one side or the other
            facing = along + math.copysign(0.5 * math.pi, off)
            if abs(off) < _GRAZED_M:
                facing = math.nan
        elif is_lone_told or _is_far_out(points, i, seen_from, reach_m):
            facing = math.atan2(to_y, to_x)
        else:
            facing = math.nan
        faced[i, 0], faced[i, 1], faced[i, 2] = x, y, facing


@compiled
def _is_far_out(points: FloatArray, i: int, seen_from: FloatArray, reach_m: float) -> bool:
    """Whether beams lie so far apart at a point that it has no neighbours, however its surface faces."""
    x, y = points[i, 0] - seen_from[0], points[i, 1] - seen_from[1]
    for j in (i - 1, i + 1):
        if 0 <= j < points.shape[0]:
            dx, dy = points[j, 0] - seen_from[0], points[j, 1] - seen_from[1]
            length = math.sqrt(dx * dx + dy * dy)
            if abs(x * dy - y * dx) < reach_m * length and x * dx + y * dy > 0.0:
                return False
    return True


@compiled
def moved_into(points: FloatArray, x: float, y: float, theta: float, out: FloatArray) -> None:
    """Into out (N, 3): faced points (N, 3) in a frame in which theirs is at x, y, theta."""
    c, s = math.cos(theta), math.sin(theta)
    for i in range(points.shape[0]):
        px, py = points[i, 0], points[i, 1]
        out[i, 0], out[i, 1] = x + c * px - s * py, y + s * px + c * py
        out[i, 2] = points[i, 2] + theta


@compiled
def all_moved_in_place(poses: FloatArray, counts: IntArray, points: FloatArray) -> None:
    """Moves faced points (N, 3), those of one scan after those of another, so many each, counts (K,), by
    the scans' poses (K, 3)."""
    end = 0
    for k in range(counts.shape[0]):
        begin, end = end, end + counts[k]
        moved_into(points[begin:end], poses[k, 0], poses[k, 1], poses[k, 2], points[begin:end])

"""A scan laid on what was met before; an inner loop, compiled."""

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray
from slam.kernels import compiled

_FAR_M = 0.08
"""Chosen: a beam's end that lies farther than this from the line counts no more."""


@compiled
def nudged(
    evidence: NDArray[np.int8],
    hits_m: NDArray[np.float32],
    origin_m: FloatArray,
    cell_m: float,
    points_m: FloatArray,
    pose: FloatArray,
    steps: FloatArray,
    most_m: float,
    rounds: int,
) -> tuple[FloatArray, float]:
    """A pose (3,) moved downhill until points (K, 2) in its frame lie on the hits about them.

    steps: of a trial [m, rad]. What has not two hits within most_m is left out, at a cost. Returns
    the pose, and the share of the points that found two.
    """
    best = pose.copy()
    least, found = _misfit(evidence, hits_m, origin_m, cell_m, points_m, best, most_m)
    for _ in range(rounds):
        is_better = False
        for axis in range(3):
            for sign in (-1.0, 1.0):
                trial = best.copy()
                trial[axis] += sign * (steps[1] if axis == 2 else steps[0])
                misfit, count = _misfit(evidence, hits_m, origin_m, cell_m, points_m, trial, most_m)
                if misfit < least:
                    best, least, found, is_better = trial, misfit, count, True
        if not is_better:
            break
    return best, found / max(len(points_m), 1)


@compiled
def _misfit(
    evidence: NDArray[np.int8],
    hits_m: NDArray[np.float32],
    origin_m: FloatArray,
    cell_m: float,
    points_m: FloatArray,
    pose: FloatArray,
    most_m: float,
) -> tuple[float, int]:
    columns, rows = evidence.shape
    reach = int(np.ceil(most_m / cell_m))
    c, s = np.cos(pose[2]), np.sin(pose[2])
    total, found = 0.0, 0
    for k in range(len(points_m)):
        x = pose[0] + c * points_m[k, 0] - s * points_m[k, 1]
        y = pose[1] + s * points_m[k, 0] + c * points_m[k, 1]
        i0, j0 = int((x - origin_m[0]) // cell_m), int((y - origin_m[1]) // cell_m)
        # to the line through the two nearest hits: to the nearest alone would hold beams, which
        # meet walls far apart, where they were before
        first = second = most_m * most_m
        ax = ay = bx = by = 0.0
        for i in range(max(i0 - reach, 0), min(i0 + reach + 1, columns)):
            for j in range(max(j0 - reach, 0), min(j0 + reach + 1, rows)):
                if evidence[i, j] > 0:
                    dx, dy = hits_m[i, j, 0] - x, hits_m[i, j, 1] - y
                    square = dx * dx + dy * dy
                    if square < first:
                        second, bx, by = first, ax, ay
                        first, ax, ay = square, dx, dy
                    elif square < second:
                        second, bx, by = square, dx, dy
        if second < most_m * most_m:
            found += 1
            length = np.hypot(bx - ax, by - ay)
            off = abs(ax * by - ay * bx) / max(length, 1e-6)
            total += min(off * off, _FAR_M * _FAR_M)
        else:
            total += _FAR_M * _FAR_M
    return total, found

"""Directions and end points of beams."""

from __future__ import annotations

import math

from slam.arrays import FloatArray, IntArray
from slam.kernels import compiled


@compiled
def directions_into(angles: FloatArray, directions: FloatArray) -> None:
    """Into directions (N, 2): the unit vectors at angles (N,) [rad]."""
    for i in range(angles.shape[0]):
        directions[i, 0] = math.cos(angles[i])
        directions[i, 1] = math.sin(angles[i])


@compiled
def points_into(
    origins: FloatArray,
    directions: FloatArray,
    ranges: FloatArray,
    farthest: float,
    points: FloatArray,
) -> int:
    """Into the first rows of points (N, 2): where beams with a finite range below farthest end [m].

    How many.
    """
    count = 0
    for i in range(ranges.shape[0]):
        if -math.inf < ranges[i] < farthest:
            points[count, 0] = origins[i, 0] + ranges[i] * directions[i, 0]
            points[count, 1] = origins[i, 1] + ranges[i] * directions[i, 1]
            count += 1
    return count


@compiled
def are_all_first(points: FloatArray) -> bool:
    """Whether all points (N, 2) are the first of them, or there are none."""
    for i in range(1, points.shape[0]):
        if points[i, 0] != points[0, 0] or points[i, 1] != points[0, 1]:
            return False
    return True


@compiled
def note_ranges(
    noted: FloatArray, lengths: IntArray, next_: int, ranges: FloatArray, least: float
) -> int:
    """Writes the ranges (N,) of a scan into a row of noted ones (K, M), by turns, if any of them is finite, and
    its length: lengths (K,). Which row is next; -1: they are those of one that is noted."""
    count = 0
    for i in range(ranges.shape[0]):
        count += math.isfinite(ranges[i])
    if count == 0:
        return next_
    for k in range(noted.shape[0]):
        if lengths[k] == ranges.shape[0] and _are_same(noted[k], ranges, least):
            return -1
    lengths[next_] = ranges.shape[0]
    for i in range(ranges.shape[0]):
        noted[next_, i] = ranges[i]
    return int((next_ + 1) % noted.shape[0])


@compiled
def _are_same(first: FloatArray, second: FloatArray, least: float) -> bool:
    """Whether all numbers that are finite in both of two arrays, as far as the second (N,) goes, are equal, and
    these are at least so large a share of those finite in either."""
    both = either = 0
    for i in range(second.shape[0]):
        is_first, is_second = math.isfinite(first[i]), math.isfinite(second[i])
        if is_first and is_second and first[i] != second[i]:
            return False
        both += is_first and is_second
        either += is_first or is_second
    return both > 0 and both >= least * either


@compiled
def same_into(
    kept: FloatArray, ranges: FloatArray, noise_m: float, noise_share: float, shares: FloatArray
) -> float:
    """Into shares (K,): of beams that returned in a scan of ranges (N,) or in one of kept ones (K, N),
    the share that measured the same but for a noise; 0 where none returned. The largest of them."""
    most = 0.0
    for k in range(kept.shape[0]):
        same = either = 0
        for i in range(ranges.shape[0]):
            one, other = ranges[i], kept[k, i]
            is_hit, is_other = abs(one) < math.inf, abs(other) < math.inf
            either += is_hit or is_other
            same += is_hit and is_other and abs(one - other) < noise_m + noise_share * one
        shares[k] = same / either if either > 0 else 0.0
        most = max(most, shares[k])
    return most

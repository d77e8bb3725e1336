"""Which keyframes lie near one of them, by their poses (K, 3)."""

from __future__ import annotations

import math

from slam.arrays import FloatArray, IntArray
from slam.kernels import compiled
from slam.kernels.pose_graph import wrapped


@compiled
def alike(poses: FloatArray, index: int, near_m: float, near_rad: float, found: IntArray) -> int:
    """Into the first of found (K,): those less than so far from a keyframe, and turned by less; how many."""
    count = 0
    for k in range(poses.shape[0]):
        east, north = poses[k, 0] - poses[index, 0], poses[k, 1] - poses[index, 1]
        is_beside = east * east + north * north < near_m * near_m
        if is_beside and abs(wrapped(poses[k, 2] - poses[index, 2])) < near_rad:
            found[count] = k
            count += 1
    return count


@compiled
def seen_before(
    poses: FloatArray,
    later: int,
    starts: IntArray,
    least_way_m: float,
    radius_m: float,
    sigma_m: FloatArray,
    most_m: float,
    first: int,
    end: int,
    found: IntArray,
    away_m: FloatArray,
) -> int:
    """Into the first of found (K,): the keyframes before one that may have seen what it sees, of first to end - 1,
    the last one first; how many. Into away_m (K,): how far off they are, half a metre more for a radian.

    They are within radius_m and twice their sigma_m (K,), or most_m if that is more, and the robot went farther than
    least_way_m since. starts: (S,) the first of sessions, increasing; nobody knows how far it went to these.
    """
    count, way_m, session = 0, 0.0, starts.shape[0] - 1
    for k in range(later - 1, -1, -1):
        way_m += math.hypot(poses[k + 1, 0] - poses[k, 0], poses[k + 1, 1] - poses[k, 1])
        while session >= 0 and starts[session] > k:
            if starts[session] == k + 1:
                way_m += least_way_m
            session -= 1
        if k < first or k >= end or way_m <= least_way_m:
            continue
        off_m = math.hypot(poses[k, 0] - poses[later, 0], poses[k, 1] - poses[later, 1])
        if off_m <= radius_m + min(2.0 * sigma_m[k], most_m):
            found[count] = k
            away_m[count] = off_m + 0.5 * abs(wrapped(poses[k, 2] - poses[later, 2]))
            count += 1
    return count


@compiled
def pairs_near(
    poses: FloatArray,
    asked: IntArray,
    pieces: IntArray,
    is_within: bool,
    radius_m: float,
    apart: int,
    every: int,
    found: IntArray,
) -> int:
    """Into found (F, 2): every so many-th of the pairs of asked (A,) keyframes, increasing, that lie within a radius
    and have more than so many numbers between them, both of one of pieces (A,), which never decrease, or of two, in the
    order of the first and then of the second; how many pairs there are, whether they found room or not."""
    count, end = 0, 0
    for a in range(asked.shape[0]):
        one = asked[a]
        while end < asked.shape[0] and pieces[end] == pieces[a]:
            end += 1
        for b in range(a + 1, end) if is_within else range(end, asked.shape[0]):
            other = asked[b]
            if other - one <= apart:
                continue
            east, north = poses[other, 0] - poses[one, 0], poses[other, 1] - poses[one, 1]
            if east * east + north * north > radius_m * radius_m:
                continue
            if count % every == 0 and count // every < found.shape[0]:
                found[count // every, 0], found[count // every, 1] = one, other
            count += 1
    return count

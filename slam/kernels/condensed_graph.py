"""Steps from keyframe to keyframe taken together, and poses that follow those that were moved."""

from __future__ import annotations

import math

from slam.arrays import BoolArray, FloatArray
from slam.kernels import compiled
from slam.kernels.normal_equations import carry_into
from slam.kernels.pose_graph import wrapped


@compiled
def ways_over(
    motions: FloatArray,
    covariances: FloatArray,
    is_kept: BoolArray,
    ways: FloatArray,
    of_ways: FloatArray,
) -> None:
    """Into ways (K, 3) and of_ways (K, 3, 3), of each node that is kept: the way from the last one kept before it
    and its covariance, by motions (K, 3), each from the node before, and their covariances (K, 3, 3) at its end."""
    x = y = theta = 0.0
    covariance, carried = covariances[0] * 0.0, covariances[0] * 0.0
    for k in range(1, motions.shape[0]):
        c, s = math.cos(theta), math.sin(theta)
        ahead, aside, turn = motions[k, 0], motions[k, 1], motions[k, 2]
        x, y = x + c * ahead - s * aside, y + s * ahead + c * aside
        theta = wrapped(theta + turn)
        carry_into(covariance, ahead, aside, turn, carried)
        covariance[:] = carried + covariances[k]
        if is_kept[k]:
            ways[k, 0], ways[k, 1], ways[k, 2] = x, y, theta
            of_ways[k] = covariance
            x = y = theta = 0.0
            covariance[:] = 0.0


@compiled
def follow(before: FloatArray, is_moved: BoolArray, poses: FloatArray) -> None:
    """Into poses (K, 3), some of which were moved from before (K, 3), the first and the last among them: all others,
    as they lay beside the last of these and the next, by as much of either as they are near to it in number."""
    last = 0
    for k in range(1, poses.shape[0]):
        if not is_moved[k]:
            continue
        for j in range(last + 1, k):
            x, y, theta = _along(before, poses, last, j)
            east, north, turn = _along(before, poses, k, j)
            share = (j - last) / (k - last)
            poses[j, 0] = x + share * (east - x)
            poses[j, 1] = y + share * (north - y)
            poses[j, 2] = wrapped(theta + share * wrapped(turn - theta))
        last = k


@compiled
def _along(
    before: FloatArray, poses: FloatArray, with_k: int, j: int
) -> tuple[float, float, float]:
    """Where a pose is if it goes along with another one, from before to poses."""
    turn = poses[with_k, 2] - before[with_k, 2]
    c, s = math.cos(turn), math.sin(turn)
    east, north = before[j, 0] - before[with_k, 0], before[j, 1] - before[with_k, 1]
    x = poses[with_k, 0] + c * east - s * north
    return x, poses[with_k, 1] + s * east + c * north, wrapped(before[j, 2] + turn)

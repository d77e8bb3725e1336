"""A pose and the scale of the wheels that led to it, in one Kalman filter."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray
from slam.kernels import compiled
from slam.kernels.normal_equations import (
    LEAST_PIVOT,
    carry_into,
    inverse_into,
    lower_root_into,
    solve_by_root,
)
from slam.kernels.pose_graph import logarithm


@compiled
def predict(
    covariance: FloatArray,
    across: FloatArray,
    told_x: float,
    told_y: float,
    told_theta: float,
    scale: float,
    variance: float,
    spread: FloatArray,
    after: FloatArray,
) -> None:
    """Into after (3, 3): the covariance of the pose after a motion; across (3,), that with the scale, in place.

    told_x, told_y, told_theta: of the motion by the wheels, spread: (3, 3) its own covariance at its
    end. The robot went `scale` times as far, give or take what variance says.
    """
    c, s = math.cos(told_theta), math.sin(told_theta)
    x, y = scale * told_x, scale * told_y
    ahead, aside = c * told_x + s * told_y, c * told_y - s * told_x
    carry_into(covariance, x, y, told_theta, after)
    for j in range(3):
        for k in range(3):
            after[j, k] += spread[j, k]
    dx, dy = across[0] - y * across[2], across[1] + x * across[2]
    was_x, was_y = c * dx + s * dy, c * dy - s * dx
    after[0, 0] += 2.0 * was_x * ahead + variance * ahead * ahead
    after[1, 1] += 2.0 * was_y * aside + variance * aside * aside
    after[0, 1] += was_x * aside + was_y * ahead + variance * ahead * aside
    after[0, 2] += across[2] * ahead
    after[1, 2] += across[2] * aside
    after[1, 0], after[2, 0], after[2, 1] = after[0, 1], after[0, 2], after[1, 2]
    across[0], across[1] = was_x + variance * ahead, was_y + variance * aside


@compiled
def update(
    covariance: FloatArray,
    across: FloatArray,
    x: float,
    y: float,
    theta: float,
    c: float,
    s: float,
    information: FloatArray,
    pull: float,
) -> tuple[float, float, float, float, float, float]:
    """What a scan that moved the pose, by x, y, theta, tells of the scale; across (3,), the pose's covariance with
    it, in place.

    covariance: (3, 3) of the pose before; c, s: cosine and sine of the way's bearing; information: (3, 3) of the
    scan alone, pull: how much of it counts. Returned: by how much it lessens the scale's variance; the normalised
    innovation squared; how far the pose moved along the way, and the variance of that; what of `across` lay along
    it before, and does now.
    """
    innovation, root, gain = np.empty(3), np.empty((3, 3)), np.empty(3)
    weighed, joined = np.empty(3), np.empty((3, 3))
    innovation[0], innovation[1], innovation[2] = x, y, theta
    logarithm(innovation, innovation)
    ahead = c * innovation[0] + s * innovation[1]
    variance = c * c * covariance[0, 0] + s * s * covariance[1, 1] + 2.0 * c * s * covariance[0, 1]
    along_before = c * across[0] + s * across[1]
    lower_root_into(covariance, LEAST_PIVOT, root)
    solve_by_root(root, across, gain)
    solve_by_root(root, innovation, weighed)
    before = squared = after = 0.0
    for j in range(3):
        before += gain[j] * across[j]
        squared += weighed[j] * innovation[j]
    inverse_into(covariance, joined)
    for j in range(3):
        for k in range(3):
            joined[j, k] += pull * information[j, k]
    lower_root_into(joined, LEAST_PIVOT, root)
    solve_by_root(root, gain, across)
    for j in range(3):
        after += gain[j] * across[j]
    along_after = c * across[0] + s * across[1]
    return before - after, squared, ahead, variance, along_before, along_after

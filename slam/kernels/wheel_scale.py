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


@compiled
def predict(
    covariance: FloatArray,
    across: FloatArray,
    told: FloatArray,
    scale: float,
    variance: float,
    spread: FloatArray,
    after: FloatArray,
) -> None:
    """Into after (3, 3): the covariance of the pose after a motion; across (3,), that with the scale, in place.

    told: (3,) x, y, heading of the motion by the wheels, spread: (3, 3) its own covariance at its
    end. The robot went `scale` times as far, give or take what variance says.
    """
    c, s = math.cos(told[2]), math.sin(told[2])
    x, y = scale * told[0], scale * told[1]
    ahead, aside = c * told[0] + s * told[1], c * told[1] - s * told[0]
    carry_into(covariance, x, y, told[2], after)
    after += spread
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
    covariance: FloatArray, across: FloatArray, innovation: FloatArray, information: FloatArray
) -> tuple[float, float]:
    """By how much a scan lessens the scale's variance, and the normalised innovation squared; across
    (3,), the pose's covariance with the scale, in place.

    covariance: (3, 3) of the pose before, innovation: (3,) by which the scan moved it, information:
    (3, 3) of the scan alone.
    """
    root, gain, pull, joined = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty((3, 3))
    lower_root_into(covariance, LEAST_PIVOT, root)
    solve_by_root(root, across, gain)
    solve_by_root(root, innovation, pull)
    before = squared = after = 0.0
    for j in range(3):
        before += gain[j] * across[j]
        squared += pull[j] * innovation[j]
    inverse_into(covariance, joined)
    joined += information
    lower_root_into(joined, LEAST_PIVOT, root)
    solve_by_root(root, gain, across)
    for j in range(3):
        after += gain[j] * across[j]
    return before - after, squared

"""How far estimated poses are from true or reference ones. No estimator imports this."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from slam.arrays import FloatArray, frozen_array
from slam.se2 import wrap_angle


def pose_errors(estimated: ArrayLike, true: ArrayLike) -> FloatArray:
    """Estimated minus true, row by row: (N, 3) of x [m], y [m], theta [rad] in (-pi, pi].

    Both (N, 3), in one frame. Raises ValueError on other shapes.
    """
    estimated = frozen_array(estimated, (None, 3), "estimated")
    errors = estimated - frozen_array(true, estimated.shape, "true")
    errors[:, 2] = wrap_angle(errors[:, 2])
    return np.asarray(errors)


def absolute_trajectory_error_m(
    estimated: ArrayLike, true: ArrayLike, is_aligned: bool = False
) -> float:
    """ATE: root mean square of the position errors [m].

    is_aligned: after the rigid motion of the whole estimate that makes it smallest, for
    trajectories whose frame is a matter of choice (mapping); localisation has a map's frame.
    """
    estimated = frozen_array(estimated, (None, 3), "estimated")
    true = frozen_array(true, estimated.shape, "true")
    if len(estimated) == 0:
        return math.nan
    positions = aligned(estimated[:, :2], true[:, :2]) if is_aligned else estimated[:, :2]
    return float(np.sqrt(np.mean(np.sum((positions - true[:, :2]) ** 2, axis=1))))


def aligned(positions: FloatArray, onto: FloatArray) -> FloatArray:
    """The positions (N, 2) after the rotation and shift that bring them closest to `onto`."""
    centre, centre_onto = positions.mean(axis=0), onto.mean(axis=0)
    x, y = (positions - centre).T
    u, v = (onto - centre_onto).T
    turn_rad = math.atan2(float(np.sum(x * v - y * u)), float(np.sum(x * u + y * v)))
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    return np.asarray(np.column_stack([c * x - s * y, s * x + c * y]) + centre_onto)

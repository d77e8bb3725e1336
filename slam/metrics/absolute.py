"""Errors of poses against those of the same time, in one frame or after alignment."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from slam.arrays import FloatArray, frozen_array
from slam.metrics.spread import Spread
from slam.pose_arrays import composed
from slam.se2 import SE2, wrap_angle


@dataclass(frozen=True)
class AbsoluteErrors:
    """Absolute trajectory error: distances [m] and turns [rad] from the poses of the same time.

    T_true_estimated: the rigid motion of the estimate before; none where it was not aligned.
    """

    T_true_estimated: SE2
    position_m: Spread
    heading_rad: Spread


def pose_errors(estimated: ArrayLike, true: ArrayLike) -> FloatArray:
    """Estimated minus true, row by row: (N, 3) of x [m], y [m], theta [rad] in (-pi, pi].

    Both (N, 3), in one frame. Raises ValueError on other shapes.
    """
    estimated = frozen_array(estimated, (None, 3), "estimated")
    errors = estimated - frozen_array(true, estimated.shape, "true")
    errors[:, 2] = wrap_angle(errors[:, 2])
    return np.asarray(errors)


def absolute_errors(
    estimated: ArrayLike, true: ArrayLike, is_aligned: bool = True
) -> AbsoluteErrors:
    """ATE of poses (N, 3) against those of the same times (N, 3).

    is_aligned: after the rigid motion of the whole estimate that brings its positions closest, for
    trajectories whose frame is a matter of choice (mapping); localisation has a map's frame.
    """
    estimated = frozen_array(estimated, (None, 3), "estimated")
    true = frozen_array(true, estimated.shape, "true")
    T_true_estimated = SE2.identity()
    if is_aligned and len(estimated):
        T_true_estimated = alignment(estimated[:, :2], true[:, :2])
    errors = pose_errors(composed(T_true_estimated.as_array(), estimated), true)
    return AbsoluteErrors(
        T_true_estimated, Spread.of(np.hypot(errors[:, 0], errors[:, 1])), Spread.of(errors[:, 2])
    )


def absolute_trajectory_error_m(
    estimated: ArrayLike, true: ArrayLike, is_aligned: bool = False
) -> float:
    """ATE: root mean square of the position errors [m]; see `absolute_errors`."""
    return absolute_errors(estimated, true, is_aligned).position_m.rmse


def alignment(positions: FloatArray, onto: FloatArray) -> SE2:
    """The rigid motion that brings positions (N, 2) closest to others (N, 2), N > 0.

    Closed form of the least squares, as Horn's and Umeyama's without scale.
    """
    centre, centre_onto = positions.mean(axis=0), onto.mean(axis=0)
    x, y = (positions - centre).T
    u, v = (onto - centre_onto).T
    turn_rad = math.atan2(float(np.sum(x * v - y * u)), float(np.sum(x * u + y * v)))
    turned = SE2(0.0, 0.0, turn_rad) @ centre[np.newaxis]
    shift = centre_onto - turned[0]
    return SE2(float(shift[0]), float(shift[1]), turn_rad)

"""Relative pose error: how far the motion over some way, time or number of poses is off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from slam.arrays import FloatArray, IntArray, frozen_array
from slam.metrics.spread import Spread
from slam.pose_arrays import between


@dataclass(frozen=True)
class RelativeErrors:
    """Errors of motions: how far [m] and how much turned [rad] the end is off, seen from the start."""

    translation_m: Spread
    rotation_rad: Spread


def relative_errors(estimated: ArrayLike, true: ArrayLike, pairs: IntArray) -> RelativeErrors:
    """RPE over pairs (P, 2) of rows of poses (N, 3) and of those of the same times (N, 3)."""
    estimated = frozen_array(estimated, (None, 3), "estimated")
    true = frozen_array(true, estimated.shape, "true")
    first, second = pairs.T
    return errors_of_motions(
        between(estimated[first], estimated[second]), between(true[first], true[second])
    )


def errors_of_motions(estimated: FloatArray, true: FloatArray) -> RelativeErrors:
    """Of motions (P, 3) against what they should be (P, 3)."""
    off = between(true, estimated)
    return RelativeErrors(Spread.of(np.hypot(off[:, 0], off[:, 1])), Spread.of(off[:, 2]))


_TOLERANCE = 0.1
"""Of a distance that pairs are to be apart: evo's."""


def index_pairs(count: int, delta: int, is_overlapping: bool = True) -> IntArray:
    """(P, 2) of rows that are delta apart, of so many.

    is_overlapping: from each row on; else the next pair starts where the last one ended.
    Raises ValueError unless delta is positive.
    """
    return _pairs(np.arange(count, dtype=np.float64), float(delta), is_overlapping)


def time_pairs(times_s: ArrayLike, delta_s: float, is_overlapping: bool = True) -> IntArray:
    """(P, 2) of rows with the first that is delta_s later or more; the times (N,) increase."""
    return _pairs(frozen_array(times_s, (None,), "times_s"), delta_s, is_overlapping)


def way_pairs(poses: ArrayLike, delta_m: float, is_overlapping: bool = True) -> IntArray:
    """(P, 2) of rows with that which is most nearly delta_m of way farther along poses (N, 3).

    None where that is a tenth of delta_m nearer or farther, as evo takes all pairs. Not overlapping:
    with the first that is delta_m farther or more.
    """
    poses = frozen_array(poses, (None, 3), "poses")
    steps_m = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    way_m = np.concatenate([np.zeros(min(len(poses), 1)), np.cumsum(steps_m)])
    return _nearest(way_m, delta_m) if is_overlapping else _pairs(way_m, delta_m, False)


def _nearest(values: FloatArray, delta: float) -> IntArray:
    """Rows with the one behind whose value is most nearly larger by delta, within a tenth of it; the
    values do not fall."""
    _check_delta(delta)
    if len(values) < 2:
        return np.empty((0, 2), dtype=np.int64)
    first = np.arange(len(values))
    wanted = values + delta
    after = np.clip(np.searchsorted(values, wanted), 1, len(values) - 1)
    is_before = wanted - values[after - 1] <= np.abs(values[after] - wanted)
    second = np.where(is_before, after - 1, after)
    is_near = np.abs(values[second] - wanted) <= _TOLERANCE * delta * (1.0 + 1e-9)
    return np.column_stack([first, second])[is_near & (second > first)]


def _pairs(values: FloatArray, delta: float, is_overlapping: bool) -> IntArray:
    """Rows with the first one behind whose value is larger by delta; the values do not fall."""
    _check_delta(delta)
    if (np.diff(values) < 0.0).any():
        raise ValueError("a relative pose error over time needs times that do not go back")
    # sums of steps miss a round delta by rounding
    reached = values + delta - 1e-9 * delta
    second = np.searchsorted(values, reached)
    pairs = np.column_stack([np.arange(len(values)), second])[second < len(values)]
    if is_overlapping:
        return np.asarray(pairs, dtype=np.int64)
    chain, start = [], 0
    while start < len(pairs):
        chain.append(pairs[start])
        start = int(pairs[start, 1])
    return np.asarray(chain, dtype=np.int64).reshape(-1, 2)


def _check_delta(delta: float) -> None:
    if not delta > 0.0:
        raise ValueError(f"a relative pose error needs a delta above 0, not {delta}")

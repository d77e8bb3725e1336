"""The pose of a trajectory at any time: by its own poses, or carried there by wheel odometry."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.arrays import FloatArray, IntArray
from slam.pose_arrays import between, composed
from slam.se2 import wrap_angle
from slam.trajectory import Trajectory

_TORN_M, _TORN_SHARE, _TORN_RAD = 0.5, 0.5, 0.8
"""Chosen: no wheels that roll err by so much between two poses, and by so much of the way."""
_FASTEST_MPS = 10.0
"""Chosen: no wheeled robot in a building goes so fast, or turns as many radians a second."""
_SAME_STAMP_S = 1e-4
"""Stamps are written with six decimals, some with four."""


@dataclass(frozen=True, eq=False)
class PoseLookup:
    """Where a trajectory was at times that need not be its own.

    The pose at a time is, in this order: that of the same stamp, within 0.1 ms; with odometry, the
    poses before and after, each carried there by the wheels, the nearer in time counting more, but
    one alone where the wheels' own poses jump in between;
    between neighbours at most max_gap_s apart, straight between them, heading the short way. There
    is none otherwise, and none more than max_gap_s before the first pose or after the last one,
    where only odometry leads. Stamps may go back or repeat: the later line of a stamp counts.
    max_gap_s: chosen: a robot may turn by half in twice that.
    """

    trajectory: Trajectory
    odometry: Trajectory | None = None
    max_gap_s: float = 2.0
    _times_s: FloatArray = field(init=False, repr=False)
    _poses: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        ordered = self.trajectory.in_order()
        object.__setattr__(self, "_times_s", ordered.times_s)
        object.__setattr__(self, "_poses", ordered.poses)

    def at(self, times_s: ArrayLike) -> FloatArray:
        """Poses (M, 3) at the times (M,), rows of nan where there is none."""
        asked_s = np.asarray(times_s, dtype=np.float64)
        if len(self._times_s) == 0:
            return np.full((len(asked_s), 3), np.nan)
        after = np.searchsorted(self._times_s, asked_s)
        # at either end both neighbours are the pose there
        before = np.maximum(after - 1, 0)
        after = np.minimum(after, len(self._times_s) - 1)
        poses = self._between(asked_s, before, after)
        if self.odometry is not None:
            carried = self._carried(asked_s, before, after)
            poses = np.where(np.isfinite(carried), carried, poses)
        for neighbour in (before, after):
            is_same = np.abs(self._times_s[neighbour] - asked_s) <= _SAME_STAMP_S
            poses[is_same] = self._poses[neighbour[is_same]]
        return poses

    def _between(self, asked_s: FloatArray, before: IntArray, after: IntArray) -> FloatArray:
        """Straight between neighbours (M,); nan where they are too far apart, or none."""
        gap_s = self._times_s[after] - self._times_s[before]
        poses = self._blended(self._poses[before], self._poses[after], asked_s, before, after)
        poses[(gap_s > self.max_gap_s) | (before == after)] = np.nan
        return poses

    def _carried(self, asked_s: FloatArray, before: IntArray, after: IntArray) -> FloatArray:
        """Carried by the odometry from both neighbours (M,); nan where that has no pose."""
        assert self.odometry is not None
        odometry = PoseLookup(self.odometry, max_gap_s=self.max_gap_s)
        at_asked, at_poses = odometry.at(asked_s), odometry.at(self._times_s)
        forward, backward = (
            composed(self._poses[i], between(at_poses[i], at_asked)) for i in (before, after)
        )
        poses = self._blended(forward, backward, asked_s, before, after)
        is_torn = self._is_torn(forward, backward, before, after)
        since_m = _length(between(at_poses[before], at_asked))
        until_m = _length(between(at_asked, at_poses[after]))
        poses[is_torn] = np.where((since_m <= until_m)[:, np.newaxis], forward, backward)[is_torn]
        since_s, until_s = asked_s - self._times_s[before], self._times_s[after] - asked_s
        least_m = [_TORN_M + _FASTEST_MPS * np.abs(away_s) for away_s in (since_s, until_s)]
        poses[(since_m > least_m[0]) & (until_m > least_m[1])] = np.nan
        beyond_s = np.maximum(self._times_s[0] - asked_s, asked_s - self._times_s[-1])
        poses[beyond_s > self.max_gap_s] = np.nan
        return poses

    def _is_torn(
        self, forward: FloatArray, backward: FloatArray, before: IntArray, after: IntArray
    ) -> NDArray[np.bool_]:
        """(M,) whether the wheels' poses jump between two neighbours, as where they are set anew."""
        off = between(forward, backward)
        most_m = _TORN_M + _TORN_SHARE * self._way(before, after)
        is_far = np.hypot(off[:, 0], off[:, 1]) > most_m
        return np.asarray(is_far | (np.abs(wrap_angle(off[:, 2])) > _TORN_RAD))

    def _way(self, before: IntArray, after: IntArray) -> FloatArray:
        """(M,) how far neighbours are apart, a turn counting as in `_length` [m]."""
        return _length(between(self._poses[before], self._poses[after]))

    def _blended(
        self,
        by_before: FloatArray,
        by_after: FloatArray,
        asked_s: FloatArray,
        before: IntArray,
        after: IntArray,
    ) -> FloatArray:
        """Between what the two neighbours say, by the time from each."""
        gap_s = self._times_s[after] - self._times_s[before]
        share = (asked_s - self._times_s[before]) / np.where(gap_s > 0.0, gap_s, 1.0)
        share = np.where(gap_s > 0.0, share, 0.0)[:, np.newaxis]
        step = by_after - by_before
        step[:, 2] = wrap_angle(step[:, 2])
        poses = by_before + share * step
        poses[:, 2] = wrap_angle(poses[:, 2])
        return poses


def _length(motions: FloatArray) -> FloatArray:
    """(M,) of motions (M, 3): way [m], a turn by a radian counting as one metre."""
    return np.asarray(np.hypot(motions[:, 0], motions[:, 1]) + np.abs(wrap_angle(motions[:, 2])))

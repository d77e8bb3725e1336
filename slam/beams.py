"""The beams of one scan in the robot's frame: where each starts, where it looks, what it measured."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray, frozen_array
from slam.kernels import copy_into
from slam.kernels.beam_points import are_all_first, directions_into, points_into
from slam.measurements import LaserScan
from slam.se2 import SE2, wrap_angle

POINTS_WITHIN_M = 80.0
"""What maps are made of lies no farther from the laser: what the farthest of these lasers see (LMS200, data sheet).
By 40 m a hall of which nothing lay nearer was no map at all; five real logs are mapped as well by either."""
_FARTHEST_M = 1e5
"""A range beyond is a driver's way to say something else."""


@dataclass(frozen=True, eq=False)
class Beams:
    """One scan, its beams where they were fired from as seen from the base at the scan's stamp.

    origins_m: (N, 2) [m]; angles_rad: (N,) increasing, direction of each beam; ranges_m: (N,) as in
    `LaserScan`. A scan taken at rest has one origin for all; a moving one as many as beams.
    Raises ValueError on other shapes.
    """

    origins_m: FloatArray
    angles_rad: FloatArray
    ranges_m: FloatArray

    def __post_init__(self) -> None:
        angles_rad = frozen_array(self.angles_rad, (None,), "angles_rad")
        if len(angles_rad) and abs(middle_rad := (angles_rad[0] + angles_rad[-1]) / 2.0) > math.pi:
            # the same directions, said so that they lie about the front
            turns = round(float(middle_rad) / math.tau)
            angles_rad = frozen_array(angles_rad - turns * math.tau, (None,), "angles_rad")
        object.__setattr__(self, "angles_rad", angles_rad)
        shape = angles_rad.shape
        object.__setattr__(self, "ranges_m", frozen_array(self.ranges_m, shape, "ranges_m"))
        object.__setattr__(
            self, "origins_m", frozen_array(self.origins_m, (*shape, 2), "origins_m")
        )

    def __len__(self) -> int:
        return len(self.angles_rad)

    @staticmethod
    def of(scan: LaserScan, T_base_laser: SE2) -> Beams:
        """The beams of a scan taken at rest."""
        origins_m = np.empty((len(scan.angles_rad), 2))
        origins_m[:] = T_base_laser.x, T_base_laser.y
        return Beams(origins_m, T_base_laser.theta + scan.angles_rad, scan.ranges_m)

    def with_ranges(self, ranges_m: FloatArray) -> Beams:
        """The same beams, which measured other ranges (N,) [m]. Where they start and look is not computed
        again."""
        # not by way of `__init__`, which would check and freeze again what is so already
        other = object.__new__(Beams)
        other.__dict__.update(
            origins_m=self.origins_m,
            angles_rad=self.angles_rad,
            ranges_m=frozen_array(ranges_m, self.angles_rad.shape, "ranges_m"),
            directions=self.directions,
            middle_m=self.middle_m,
            _is_of_one_origin=self._is_of_one_origin,
        )
        if self._is_of_one_origin:  # else, directions are kept as seen from the middle
            other.__dict__["narrow_angles_rad"] = self.narrow_angles_rad
        return other

    def shortened(self, offset_m: float) -> Beams:
        """The same beams with ranges that are less by an offset [m], not below 0."""
        if offset_m == 0.0:
            return self
        ranges_m = np.where(
            np.isfinite(self.ranges_m), np.maximum(self.ranges_m - offset_m, 0.0), self.ranges_m
        )
        return self.with_ranges(ranges_m)

    def cut(self, range_max_m: float) -> Beams:
        """The same beams, of which those that end farther [m] have no return."""
        is_far = self.ranges_m > range_max_m
        if not is_far.any():
            return self
        return self.with_ranges(np.where(is_far, np.inf, self.ranges_m))

    @cached_property
    def directions(self) -> FloatArray:
        """(N, 2) unit vectors."""
        directions = np.empty((len(self), 2))
        directions_into(self.angles_rad, directions)
        return directions

    @cached_property
    def narrow_angles_rad(self) -> NDArray[np.float32]:
        """(N,) the directions [rad] in half the memory, to be kept."""
        return narrowed(self.angles_rad)

    @cached_property
    def middle_m(self) -> FloatArray:
        """(2,) the middle of the origins [m]."""
        if len(self) == 0:
            return np.zeros(2)
        if self._is_of_one_origin:
            first: FloatArray = self.origins_m[0].copy()
            return first
        middle: FloatArray = (self.origins_m.min(axis=0) + self.origins_m.max(axis=0)) / 2.0
        return middle

    @cached_property
    def spread_m(self) -> float:
        """No origin is farther than this from the middle [m]."""
        if self._is_of_one_origin:
            return 0.0
        return float(np.hypot(*(self.origins_m - self.middle_m).T).max(initial=0.0))

    @cached_property
    def _is_of_one_origin(self) -> bool:
        return bool(are_all_first(self.origins_m))

    def from_middle(self) -> tuple[FloatArray, FloatArray]:
        """(N,) directions [rad], increasing, and ranges (N,) [m] of where the beams end as seen from
        the middle of their origins; those that hit nothing look where they did. In their order, but
        where one beam's end close by lies beside the next one's."""
        if self._is_of_one_origin:
            return self.angles_rad, self.ranges_m
        angles_rad, ranges_m, is_hit = self.angles_rad.copy(), self.ranges_m.copy(), self.is_hit
        ends_m = self.origins_m[is_hit] - self.middle_m
        ends_m += ranges_m[is_hit, np.newaxis] * self.directions[is_hit]
        seen_rad = np.arctan2(ends_m[:, 1], ends_m[:, 0])
        angles_rad[is_hit] += wrap_angle(seen_rad - angles_rad[is_hit])
        ranges_m[is_hit] = np.hypot(*ends_m.T)
        order = np.argsort(angles_rad, kind="stable")
        angles_rad, ranges_m = angles_rad[order], ranges_m[order]
        # as those of one origin: to numba that is a type, and kernels would be compiled twice
        angles_rad.flags.writeable = ranges_m.flags.writeable = False
        return angles_rad, ranges_m

    @property
    def is_hit(self) -> NDArray[np.bool_]:
        """(N,) True where a beam measured a distance, less than any laser's limit."""
        return np.isfinite(self.ranges_m) & (self.ranges_m < _FARTHEST_M)

    @cached_property
    def points(self) -> FloatArray:
        """Where the beams hit, (M, 2) [m], base frame, in their order; hits only."""
        return self.points_within(_FARTHEST_M)

    def points_within(self, range_m: float) -> FloatArray:
        """As `points`, of those beams alone whose range is less [m]."""
        points = np.empty((len(self), 2))
        count = points_into(self.origins_m, self.directions, self.ranges_m, range_m, points)
        return points[:count]


def narrowed(numbers: FloatArray) -> NDArray[np.float32]:
    """The same in half the memory; NumPy's own way warns of some kinds of nan."""
    narrow = np.empty(numbers.shape, np.float32)
    copy_into(numbers, narrow)
    return narrow

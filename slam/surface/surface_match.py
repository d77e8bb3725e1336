"""A scan matched with the surfaces of a map: the pose, and what it tells of that."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray
from slam.kernels.normal_equations import inverse_of
from slam.lazy import lazy
from slam.records import record
from slam.se2 import SE2


@record
class SurfaceMatch:
    """A pose on the map, and how well the scan fits there.

    information: (3, 3) of the scan alone, in the base frame's tangent; joined: (3, 3) with the
    odometry's, as far as that was trusted. seen_ratio: share of the points where the map has a
    surface; inlier_ratio: of those, the share that lies on it. cost: mean over all points, 0 for
    one on a surface, 1 for one that is nowhere near. gain: by how much more than this information the
    scan was let pull at the pose. is_told_by_few: surfaces across the direction of which it tells least
    are few, and it fits nowhere else along that.
    """

    T_map_base: SE2
    information: FloatArray
    joined: FloatArray
    seen_ratio: float
    inlier_ratio: float
    cost: float
    gain: float
    is_told_by_few: bool = False

    @property
    def covariance(self) -> FloatArray:
        """(3, 3) of the pose."""
        result: FloatArray = inverse_of(self.joined)
        return result

    @property
    def place_information(self) -> FloatArray:
        """(2, 2) of x and y, whatever the heading is; zeros where the scan tells nothing of that."""
        known = self.information
        if not known[2, 2] > 0.0:
            return np.zeros((2, 2))
        left: FloatArray = known[:2, :2] - np.outer(known[:2, 2], known[:2, 2]) / known[2, 2]
        return left

    @lazy
    def least_facing(self) -> float:
        """Share of what the scan tells of its place, along the direction of which it tells least;
        half, where surfaces face every way; none, between two walls that run along."""
        # plain floats: of NumPy's, each operation takes five times as long
        (xx, xy, x), (_, yy, y), (_, _, turn) = self.information.tolist()
        total = xx + yy
        if not (total > 0.0 and turn > 0.0):
            return 0.0
        xx, yy, xy = xx - x * x / turn, yy - y * y / turn, xy - x * y / turn
        least: float = (0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)) / total
        return least

    @property
    def open_way(self) -> FloatArray | None:
        """(3,) tangent along which the scan, slid a metre and turned with it, fits all but as well: the
        direction of which it tells least. None where it tells nothing of its heading."""
        known = self.information
        if not known[2, 2] > 0.0:
            return None
        weakest = np.linalg.eigh(self.place_information)[1][:, 0]
        return np.array([*weakest, -known[:2, 2] @ weakest / known[2, 2]])

    def loosened_along_open(self, sigma_m: float) -> SurfaceMatch:
        """The same pose, so much less sure along the direction of which the scan tells least: of a match
        that was searched for, where neither that nor the wheels tell how far along it lies."""
        open_ = self.open_way
        if open_ is None:
            return self
        covariance = self.covariance + sigma_m**2 * np.outer(open_, open_)
        return replace(self, joined=inverse_of(covariance))

    def held_along_open(self, T_predicted: SE2, odometry: FloatArray) -> SurfaceMatch:
        """The same, with what it tells along its weakest direction left out: the odometry tells there.

        odometry: (3, 3) information of T_predicted, as it was when the two were matched. Degenerate
        directions left to the prediction: Zhang, Kaess and Singh, ICRA 2016; here the pose and its
        covariance are those of scan and odometry without that direction.
        """
        open_, known = self.open_way, self.gain * self.information
        if open_ is None:
            return self
        seen = known @ open_
        told = float(open_ @ seen)
        if not told > 0.0:
            return self
        share = np.outer(seen, seen) / told
        both = odometry + known
        pull = both @ (T_predicted.inverse() @ self.T_map_base).log()
        step = inverse_of(both - share) @ (pull - seen * (open_ @ pull) / told)
        return replace(
            self,
            T_map_base=T_predicted @ SE2.exp(step),
            information=self.information - share / self.gain,
            joined=self.joined - share / self.gain,
        )

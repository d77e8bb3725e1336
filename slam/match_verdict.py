"""When a match that knows its information is believed, and along which directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.kernels.normal_equations import widest


@dataclass(frozen=True)
class VerdictConfig:
    """When a match that knows its covariance is believed.

    min_beams: fewer tell of no room. min_inlier_ratio: share of the beams that the map explains;
    three pairs of legs leave nine tenths, a wrong pose in a room seldom more than half.
    max_behind_ratio: share that passed through walls; right poses stay below 3 %, and twice as much
    may pass where missing_inlier_ratio of the others fit: a cupboard was taken away.
    max_sigma_m, max_sigma_rad: wider than this along any direction, the scan leaves it open.
    """

    min_beams: int = 20
    min_inlier_ratio: float = 0.6
    max_behind_ratio: float = 0.15
    missing_inlier_ratio: float = 0.95
    max_sigma_m: float = 0.05
    max_sigma_rad: float = 0.035

    def is_open(self, information: FloatArray) -> bool:
        """True where some direction, or the heading, is not known well enough to be believed."""
        sigma_m, sigma_rad = widest(information)
        return not (sigma_m <= self.max_sigma_m and sigma_rad <= self.max_sigma_rad)

    def is_loose(self, information: FloatArray) -> bool:
        """True where a few points may be all that holds some direction: ten times wider and it is open."""
        sigma_m, sigma_rad = widest(information)
        return not (10.0 * sigma_m <= self.max_sigma_m and 10.0 * sigma_rad <= self.max_sigma_rad)

    def are_walls_missing(self, inlier_ratio: float, behind_ratio: float) -> bool:
        """Whether more walls are missing than may have been taken away."""
        is_rest_right = inlier_ratio >= self.missing_inlier_ratio * (1.0 - behind_ratio)
        return behind_ratio > (2.0 if is_rest_right else 1.0) * self.max_behind_ratio

    def held(self, information: FloatArray) -> FloatArray:
        """(3, 3) the part of an information that fixes something: none along what is open."""
        scale = np.array([self.max_sigma_m, self.max_sigma_m, self.max_sigma_rad])
        values, directions = np.linalg.eigh(information * np.outer(scale, scale))
        values = np.where(values > 1.0, values, 0.0)
        return np.asarray((directions * values) @ directions.T / np.outer(scale, scale))


def less_chance(beams: Beams, information: FloatArray, variance_rad2: float) -> FloatArray:
    """(3, 3) information without what normals wrong by chance, so far, seem to give."""
    weight = information[0, 0] + information[1, 1]
    lever_m2 = float(np.mean(np.sum(beams.points**2, axis=1)))
    share = 3.0 * variance_rad2 * weight
    values, directions = np.linalg.eigh(information - np.diag([share, share, share * lever_m2]))
    return np.asarray((directions * np.maximum(values, 0.0)) @ directions.T)

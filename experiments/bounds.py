"""The Cramer-Rao bound of a trial: how well its scan lets any method know the pose."""

import numpy as np

from experiments.methods import KnownPlace
from kitasap_sim.laser import LaserSpec
from slam.arrays import FloatArray
from slam.beam_likelihood import cramer_rao_bound
from slam.beams import Beams
from slam.laser_model import LaserModel
from slam.measurements import LaserScan
from slam.range_noise import RangeNoise
from slam.se2 import SE2

_UNDISTURBED_SIGMAS = 5.0
"""Chosen: noise alone goes beyond it once in two million beams; legs and mixed pixels mostly do."""


def scan_bound(
    known: KnownPlace, sensor: LaserSpec, scan: LaserScan, true_pose: FloatArray
) -> FloatArray:
    """(3, 3) bound on the covariance at a true pose (3,), base frame, for the undisturbed beams.

    sensor: the laser as it truly is. Undisturbed: the beam gave a range, and that of the wall that
    the map has there. inf on the diagonal where the scan leaves a direction open.
    """
    truth = LaserModel(
        RangeNoise(sensor.sigma_at_m), sensor.range_min_m, min(sensor.range_max_m, 1000.0)
    )
    T_map_base = SE2.from_array(true_pose)
    beams = Beams.of(scan, known.T_base_laser)
    ranges_m, _ = known.true_walls.ranges(beams, T_map_base)
    with np.errstate(invalid="ignore"):
        off_m = np.abs(beams.ranges_m - ranges_m)
    is_undisturbed = off_m <= _UNDISTURBED_SIGMAS * truth.noise.sigma_m(
        np.where(np.isfinite(ranges_m), ranges_m, 0.0)
    )
    return cramer_rao_bound(beams, known.true_walls, truth, T_map_base, is_undisturbed)


def nees(error: FloatArray, covariance: FloatArray) -> float:
    """Normalised estimation error squared: 3 on average where a covariance (3, 3) tells the truth.

    error: (3,) of the same tangent. Bar-Shalom, Li and Kirubarajan (2001), Section 5.4.
    """
    return float(error @ np.linalg.solve(covariance, error))

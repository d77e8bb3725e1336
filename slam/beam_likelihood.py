"""The most likely pose of a scan on a map of walls, its covariance, and the bound on both."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.kernels.beam_likelihood import (
    BEHIND,
    COST,
    INLIERS,
    OFFSET_CROSS,
    OFFSET_INFORMATION,
    OFFSET_PULL,
    SUM_COUNT,
    USED,
    look,
    residual_scale,
)
from slam.kernels.beam_search import maximise, sharpen
from slam.laser_model import LaserModel
from slam.se2 import SE2
from slam.segment_map import SegmentMap

_NO_OUTLIERS = np.array([1e-30, 0.0])


@dataclass(frozen=True)
class BeamConfig:
    """How `match_beams` searches, and what it makes of the result.

    blurs_m: standard deviation of the position that is added to each beam, stage by stage: about
    how far off the start may be, then a tenth of it. tolerance_sigmas: step, in standard deviations
    of the pose, that is none.
    smooth_sigmas, smooth_bend: a beam's range counts as smooth where, over so many standard
    deviations of the pose, it keeps to its tangent within so many sigmas of its noise.
    edge_nodes, edge_reach_sigmas: where the likelihood of a beam that passes an edge is looked at.
    edge_blurs: times that likelihood is averaged with its neighbours. chosen: 2 makes the NEES 3.
    max_scale: residuals that scatter wider than this times the laser's noise mean that the noise is
    assumed too small; the match is then done again with what was seen. Noise alone, and three
    pairs of legs, stay below 1.25 in ten thousand scans.
    min_offset_sigmas: a range offset common to all beams counts as real from here on.
    """

    blurs_m: tuple[float, ...] = (0.02, 0.003)
    max_steps: int = 12
    tolerance_sigmas: float = 0.03
    smooth_sigmas: float = 2.0
    smooth_bend: float = 1.0
    edge_nodes: int = 33
    edge_reach_sigmas: float = 3.5
    edge_sweeps: int = 4
    edge_blurs: int = 2
    max_scale: float = 1.3
    min_offset_sigmas: float = 4.5

    def __post_init__(self) -> None:
        if not self.blurs_m or min(self.blurs_m) <= 0.0:
            raise ValueError(f"blurs_m needs lengths above 0, not {self.blurs_m}")
        if self.max_steps < 1 or self.edge_nodes < 3 or self.edge_sweeps < 1:
            raise ValueError(f"a search needs 1 step, 3 nodes and 1 sweep at least, not {self}")


@dataclass(frozen=True, eq=False)
class BeamMatch:
    """A pose and what the beams say of it.

    information: (3, 3) inverse covariance of the tangent (x, y, theta) in the base frame:
    true pose = T_map_base @ SE2.exp(noise). cost: mean squared residual in sigmas, each beam's
    counted as 16 at most. used: beams that could tell. inlier_ratio: share of them within four
    sigmas; behind_ratio: share that ended behind the wall they should have met.
    scale: scatter of the residuals in units of the laser's noise. offset_m, offset_sigma_m: range
    offset common to all beams.
    """

    T_map_base: SE2
    information: FloatArray
    is_settled: bool
    steps: int
    used: int
    cost: float
    inlier_ratio: float
    behind_ratio: float
    scale: float
    offset_m: float
    offset_sigma_m: float

    @property
    def covariance(self) -> FloatArray:
        """(3, 3) of the tangent in the base frame; inf along what nothing fixes."""
        return covariance_of(self.information)


def covariance_of(information: FloatArray) -> FloatArray:
    """(3, 3) inverse of an information matrix; where it is singular, inf on the diagonal."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    normalised = information / np.outer(scale, scale)
    if not np.isfinite(normalised).all() or np.linalg.eigvalsh(normalised)[0] < 1e-12:
        return np.diag(np.full(3, np.inf))
    return np.asarray(np.linalg.inv(normalised) / np.outer(scale, scale))


def match_beams(
    beams: Beams,
    segment_map: SegmentMap,
    laser: LaserModel,
    T_map_base: SE2,
    config: BeamConfig | None = None,
) -> BeamMatch:
    """The pose near T_map_base from which the map explains the ranges best.

    Maximum likelihood of the beam model (Thrun, Burgard and Fox, Probabilistic Robotics, Section
    6.3: Gaussian about the map's range, or anything), by Gauss-Newton on ray-cast residuals, from
    blurred to sharp. Beams at edges, of which an exact map tells most and a gradient nothing, are
    joined last.
    """
    config = config or BeamConfig()
    noise, passes = laser.noise_table, 0
    while True:
        match = _matched(beams, segment_map, laser, noise, T_map_base, config)
        passes += 1
        if match.scale <= config.max_scale or passes == 2 or match.used < 30:
            return match
        noise = noise * [1.0, match.scale]
        T_map_base = match.T_map_base


def _matched(
    beams: Beams,
    segment_map: SegmentMap,
    laser: LaserModel,
    noise: FloatArray,
    T_map_base: SE2,
    config: BeamConfig,
) -> BeamMatch:
    pose, information, sums = T_map_base.as_array(), np.zeros((3, 3)), np.zeros(SUM_COUNT)
    predicted, is_kept = np.full(len(beams), np.inf), np.ones(len(beams), dtype=np.bool_)
    scene = (
        segment_map.vertices, segment_map.walls, segment_map.normals, segment_map.sigma_m,
        beams.origins_m, beams.directions, beams.angles_rad, beams.middle_m, beams.spread_m,
        beams.ranges_m, noise, laser.limits_m, laser.outliers,
    )  # fmt: skip
    steps, is_settled = maximise(
        *scene, np.array(config.blurs_m), config.max_steps, config.tolerance_sigmas, pose, information,
        sums, predicted,
    )  # fmt: skip
    verdict = sums.copy()
    if segment_map.is_exact and verdict[INLIERS] >= 3 and is_settled:
        nodes = np.linspace(-config.edge_reach_sigmas, config.edge_reach_sigmas, config.edge_nodes)
        sharpen(
            *scene, config.max_steps, config.tolerance_sigmas,
            np.array([config.smooth_sigmas, config.smooth_bend]), nodes, config.edge_sweeps,
            config.edge_blurs, pose, information, sums, predicted, is_kept,
        )  # fmt: skip
    scale = float(residual_scale(laser.noise_table, beams.ranges_m, predicted, is_kept))
    pose, information, offset_m, offset_sigma_m = _offset_freed(pose, information, sums, config)
    used = int(verdict[USED])
    return BeamMatch(
        T_map_base=SE2.from_array(pose),
        information=information,
        is_settled=bool(is_settled) and bool(np.isfinite(pose).all()),
        steps=steps,
        used=used,
        cost=verdict[COST] / max(used, 1),
        inlier_ratio=verdict[INLIERS] / max(used, 1),
        behind_ratio=verdict[BEHIND] / max(used, 1),
        scale=scale,
        offset_m=offset_m,
        offset_sigma_m=offset_sigma_m,
    )


def _offset_freed(
    pose: FloatArray, information: FloatArray, sums: FloatArray, config: BeamConfig
) -> tuple[FloatArray, FloatArray, float, float]:
    """Pose and information had the laser an unknown offset, where the scan shows that it has one.

    And the offset with its standard deviation [m]. The fourth unknown of the same least squares,
    eliminated by its Schur complement.
    """
    cross = sums[OFFSET_CROSS : OFFSET_CROSS + 3]
    covariance = covariance_of(information)
    if not np.isfinite(covariance).all():
        return pose, information, 0.0, math.inf
    response = covariance @ cross  # how far an offset of a metre would push the pose
    left = sums[OFFSET_INFORMATION] - float(cross @ response)
    if not left > 0.0:
        return pose, information, 0.0, math.inf
    offset_m, sigma_m = sums[OFFSET_PULL] / left, 1.0 / math.sqrt(left)
    if abs(offset_m) < config.min_offset_sigmas * sigma_m:
        return pose, information, offset_m, sigma_m
    moved = SE2.from_array(pose) @ SE2.exp(-offset_m * response)
    widened = covariance + np.outer(response, response) * sigma_m**2
    return moved.as_array(), np.linalg.inv(widened), offset_m, sigma_m


def fisher_information(
    beams: Beams,
    segment_map: SegmentMap,
    laser: LaserModel,
    T_map_base: SE2,
    is_counted: NDArray[np.bool_] | None = None,
) -> FloatArray:
    """(3, 3) Fisher information of x, y, theta (base frame) in one scan of a known map.

    Censi, "On achievable accuracy for range-finder localization", ICRA 2007: the sum over the beams
    of the squared gradient of the range over its variance. Of `beams` only origins and directions
    matter; is_counted: (N,) those that tell, all by default. Walls out of the laser's limits tell
    nothing. The noise's own change with range adds 2e-4 of it and is left out.
    """
    ranges_m, hit_walls = segment_map.ranges(beams, T_map_base, laser.range_max_m)
    information, pull, sums = np.zeros((3, 3)), np.zeros(3), np.zeros(SUM_COUNT)
    counted = np.ones(len(beams), dtype=np.bool_) if is_counted is None else is_counted
    ranges_m = np.where(ranges_m < laser.range_min_m, np.inf, ranges_m)
    look(
        segment_map.normals, segment_map.sigma_m, beams.origins_m, beams.directions, ranges_m,
        laser.noise_table, np.array([-np.inf, np.inf]), _NO_OUTLIERS, 0.0, T_map_base.theta,
        ranges_m, hit_walls, counted, information, pull, sums,
    )  # fmt: skip
    return information


def cramer_rao_bound(
    beams: Beams,
    segment_map: SegmentMap,
    laser: LaserModel,
    T_map_base: SE2,
    is_counted: NDArray[np.bool_] | None = None,
) -> FloatArray:
    """(3, 3) least covariance of any unbiased estimate of the pose (base frame); inf if none is.

    The bound of the ranges' slopes alone. Their jumps at edges, which no gradient describes, tell
    as well, so that an estimator that uses an exact map's edges may lie below.
    """
    return covariance_of(fisher_information(beams, segment_map, laser, T_map_base, is_counted))

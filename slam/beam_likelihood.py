"""The most likely pose of a scan on a map of walls, its covariance, and the bound on both."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray, IntArray, run_lengths
from slam.beams import Beams
from slam.kernels.beam_likelihood import (
    BEHIND,
    COST,
    INLIERS,
    SUM_COUNT,
    USED,
    free_offset,
    look,
    residual_scale,
)
from slam.kernels.beam_search import maximise, reach_of, sharpen
from slam.kernels.normal_equations import covariance_into, widest
from slam.laser_model import LaserModel
from slam.scan_match import PoseInformation
from slam.se2 import SE2
from slam.surface.normal_points import standard_normal_points
from slam.surface.segment_map import SegmentMap, is_near_by

_SHARP_M = 0.02
"""Where a scan tells the position less well, edges are no matter of small shifts."""
_FITS_AT_ALL = 0.5
_FEW_BEAMS = 30
_NEAR_BLUR_M = 0.05
_MISSING_AT_ALL, _PASSED_M, _RUN = 0.01, 0.1, 3
"""Chosen: of beams behind their walls, below which no wall is missing; so far behind, and so many of
them side by side, that it is neither noise nor light mixed at an edge."""
_NO_BLURS = np.empty(0)
_NO_OUTLIERS = np.array([1e-30, 0.0])
_POINTS = standard_normal_points(256)
"""Where `_widen` looks. Chosen: 64 missed second answers that a hundredth of the smooth beams' volume
holds."""
_OPEN_SHARE = 1e-9
_WIDER = 1.6
"""Chosen: times the variance; less is what so many points cannot tell."""
_RIGHT_AFTER_ALL = 0.55
"""Times what edges tell: `doubt` holds their beams for wrong more often than they are. As fitted to
five thousand poses at rest, of two lasers in two places: with 0.5 their mean NEES is 2.94."""


@dataclass(frozen=True)
class BeamConfig:
    """How `match_beams` searches, and what it makes of the result.

    blurs_m: standard deviation of the position that is added to each beam, stage by stage: about
    how far off the start may be, then a tenth of it. tolerance_sigmas: step, in standard deviations
    of the pose, that is none.
    smooth_sigmas, smooth_bend: a beam's range counts as smooth where, over so many standard
    deviations of the pose, it keeps to its tangent within so many sigmas of its noise.
    edge_nodes, edge_reach_sigmas: where the likelihood of a beam that passes an edge is looked at.
    edge_blurs: times that likelihood is averaged with its neighbours. chosen: 1.
    scales: residuals that scatter so many times wider than the laser's noise, between the two, mean
    that the noise is assumed too small; the match is then done again with what was seen. Noise
    alone, and three pairs of legs, stay below the first; at a wrong pose they scatter wider still.
    offset_prior: probability that a laser's ranges have an offset common to all, and its standard
    deviation if they have [m]. chosen: one laser in ten, 5 mm.
    """

    blurs_m: tuple[float, ...] = (0.02, 0.003)
    max_steps: int = 12
    tolerance_sigmas: float = 0.5
    smooth_sigmas: float = 2.0
    smooth_bend: float = 1.0
    edge_nodes: int = 33
    edge_reach_sigmas: float = 3.5
    edge_sweeps: int = 4
    edge_blurs: int = 1
    scales: tuple[float, float] = (1.3, 3.5)
    offset_prior: tuple[float, float] = (0.1, 0.005)

    def __post_init__(self) -> None:
        if not self.blurs_m or min(self.blurs_m) <= 0.0:
            raise ValueError(f"blurs_m needs lengths above 0, not {self.blurs_m}")
        if self.max_steps < 1 or self.edge_nodes < 3 or self.edge_sweeps < 1:
            raise ValueError(f"a search needs 1 step, 3 nodes and 1 sweep at least, not {self}")

    @cached_property
    def blurs(self) -> FloatArray:
        """blurs_m as an array."""
        return np.array(self.blurs_m)

    @cached_property
    def smoothness(self) -> FloatArray:
        """(2,) smooth_sigmas and smooth_bend."""
        return np.array([self.smooth_sigmas, self.smooth_bend])

    @cached_property
    def offset_odds(self) -> FloatArray:
        """offset_prior as an array."""
        return np.array(self.offset_prior)

    @cached_property
    def nodes(self) -> FloatArray:
        """(edge_nodes,) evenly over edge_reach_sigmas to either side."""
        return np.linspace(-self.edge_reach_sigmas, self.edge_reach_sigmas, self.edge_nodes)


@dataclass(frozen=True, eq=False)
class BeamMatch:
    """A pose and what the beams say of it.

    information: (3, 3) inverse covariance of the tangent (x, y, theta) in the base frame:
    true pose = T_map_base @ SE2.exp(noise). cost: mean squared residual in sigmas, each beam's
    counted as 16 at most. used: beams that could tell. inlier_ratio: share of them within four
    sigmas; behind_ratio: share that ended behind the wall they should have met.
    scale: scatter of the residuals in units of the laser's noise. offset_m, offset_sigma_m: range
    offset common to all beams. noise_scale: times the laser's noise with which the pose was found.
    missing_ratio: share that went through an exact map's walls side by side, not at edges.
    smooth: what the beams say that pass no edge; None where edges are not told apart.
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
    smooth: PoseInformation | None = None
    noise_scale: float = 1.0
    missing_ratio: float = 0.0

    @property
    def covariance(self) -> FloatArray:
        """(3, 3) of the tangent in the base frame; inf on its diagonal where a direction is open."""
        return covariance_of(self.information)


def covariance_of(information: FloatArray) -> FloatArray:
    """(3, 3) inverse of an information matrix; where it is singular, inf on the diagonal."""
    covariance = np.empty((3, 3))
    covariance_into(information, covariance)
    return covariance


def match_beams(
    beams: Beams,
    segment_map: SegmentMap,
    laser: LaserModel,
    T_map_base: SE2,
    config: BeamConfig | None = None,
    near_information: FloatArray | None = None,
) -> BeamMatch:
    """The pose near T_map_base from which the map explains the ranges best.

    near_information: (3, 3) of T_map_base, where it is known to millimetres already: the blurred
    stages are then left out.

    Maximum likelihood of the beam model (Thrun, Burgard and Fox, Probabilistic Robotics, Section
    6.3: Gaussian about the map's range, or anything), by Gauss-Newton on ray-cast residuals, from
    blurred to sharp. Beams at edges, of which an exact map tells most and a gradient nothing, are
    joined last.
    """
    config = config or BeamConfig()
    is_near = near_information is not None or config.blurs_m[0] <= _NEAR_BLUR_M
    is_near = is_near and segment_map.is_exact
    reach_m = float(reach_of(laser.limits_m))
    walls = segment_map.seen_from(beams, T_map_base, reach_m) if is_near else segment_map
    match = _matched(beams, walls, laser, laser.noise_table, T_map_base, config, near_information)
    if is_near and not is_near_by(T_map_base, match.T_map_base):
        walls = segment_map
        match = _matched(beams, walls, laser, laser.noise_table, T_map_base, config)
    low, high = config.scales
    if not low < match.scale < high or match.inlier_ratio < _FITS_AT_ALL or match.used < _FEW_BEAMS:
        return match
    noise = laser.noise_table * [1.0, match.scale]
    again = _matched(beams, walls, laser, noise, match.T_map_base, config)
    # how well it fits is told by the noise assumed: with a noise wide enough everything fits
    return replace(
        again,
        cost=match.cost,
        inlier_ratio=match.inlier_ratio,
        behind_ratio=match.behind_ratio,
        missing_ratio=match.missing_ratio,
        scale=match.scale,
        noise_scale=match.scale,
    )


def _matched(
    beams: Beams,
    segment_map: SegmentMap,
    laser: LaserModel,
    noise: FloatArray,
    T_map_base: SE2,
    config: BeamConfig,
    near_information: FloatArray | None = None,
) -> BeamMatch:
    pose, information, sums = T_map_base.as_array(), np.zeros((3, 3)), np.zeros(SUM_COUNT)
    blurs = config.blurs
    # on a map made of scans things stand that have gone since: the beam may have passed them, and
    # is compared with that wall on its way which is nearest to what it measured
    is_first = segment_map.is_exact
    targets = np.zeros(len(beams)) if is_first else np.where(beams.is_hit, beams.ranges_m, 0.0)
    if near_information is not None:
        information[:], blurs = near_information, _NO_BLURS
    predicted, is_kept = np.empty(len(beams)), np.ones(len(beams), dtype=np.bool_)
    hit_walls = np.empty(len(beams), dtype=np.int64)
    scene = (
        segment_map.vertices, segment_map.walls, segment_map.normals, segment_map.sigma_m,
        beams.origins_m, beams.directions, beams.angles_rad, beams.middle_m, beams.spread_m,
        beams.ranges_m, noise, laser.limits_m, laser.outliers,
    )  # fmt: skip
    steps, is_settled = maximise(
        *scene, blurs, config.max_steps, config.tolerance_sigmas, targets, pose, information,
        sums, predicted, hit_walls,
    )  # fmt: skip
    verdict = sums.copy()
    is_sharp = widest(information)[0] < _SHARP_M
    is_sharpened = bool(segment_map.is_exact and is_sharp and is_settled)
    smooth_pose, smooth_information, moments = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    smooth_sums = np.empty(SUM_COUNT)
    if is_sharpened:
        sharpen(
            *scene, config.smoothness, config.nodes, config.edge_sweeps,
            config.edge_blurs, pose, information, sums, predicted, hit_walls, is_kept, _POINTS,
            smooth_pose, smooth_information, smooth_sums, moments,
        )  # fmt: skip
    scale = float(residual_scale(laser.noise_table, beams.ranges_m, predicted, is_kept))
    smooth, told = None, information
    if is_sharpened:
        told = information.copy()
        information += _RIGHT_AFTER_ALL * (information - smooth_information)
        free_offset(smooth_information, smooth_sums, config.offset_odds, smooth_pose)
        smooth = PoseInformation(SE2.from_array(smooth_pose), smooth_information)
    offset_m, offset_sigma_m = free_offset(information, sums, config.offset_odds, pose)
    if is_sharpened:
        _widen(told, moments, smooth_information, information)
    used, behind_ratio = int(verdict[USED]), float(verdict[BEHIND]) / max(int(verdict[USED]), 1)
    missing_ratio = 0.0
    if segment_map.is_exact and behind_ratio > _MISSING_AT_ALL:
        is_passed = _is_passed(beams, segment_map, SE2.from_array(pose), predicted, hit_walls)
        runs = run_lengths(is_passed)
        missing_ratio = float(runs[runs >= _RUN].sum()) / max(used, 1)
    return BeamMatch(
        T_map_base=SE2(pose[0], pose[1], pose[2]),
        information=information,
        is_settled=bool(is_settled) and math.isfinite(pose[0] + pose[1] + pose[2]),
        steps=steps,
        used=used,
        cost=float(verdict[COST]) / max(used, 1),
        inlier_ratio=float(verdict[INLIERS]) / max(used, 1),
        behind_ratio=behind_ratio,
        missing_ratio=missing_ratio,
        scale=scale,
        offset_m=float(offset_m),
        offset_sigma_m=float(offset_sigma_m),
        smooth=smooth,
    )


def _widen(
    told: FloatArray, moments: FloatArray, smooth: FloatArray, information: FloatArray
) -> None:
    """Makes an information (3, 3), in place, less sure along the ways in which samples of what edges
    say scatter wider about the pose, moments (3, 3), than the Gaussian told (3, 3) of them; never less
    sure than the smooth beams (3, 3)."""
    # in units of its own deviations it is 1 every way
    if np.vdot(told, moments) < 2.0 + _WIDER or not (_is_closed(told) and _is_closed(information)):
        return
    root = np.linalg.cholesky(told)
    values, directions = np.linalg.eigh(root.T @ moments @ root)
    if not values[-1] > _WIDER:
        return
    # of what is left with the offset open, the same shares
    values = np.where(values > _WIDER, values, 1.0)
    root = np.linalg.cholesky(information)
    information[:] = root @ (directions / values) @ directions.T @ root.T
    root = np.linalg.cholesky(information)
    values, directions = np.linalg.eigh(np.linalg.solve(root, np.linalg.solve(root, smooth).T))
    if values[-1] > 1.0:
        information[:] = root @ (directions * np.maximum(values, 1.0)) @ directions.T @ root.T


def _is_closed(information: FloatArray) -> bool:
    """Whether it tells something every way: an open direction is no matter of edges."""
    values = np.linalg.eigvalsh(information)
    return bool(values[0] > _OPEN_SHARE * values[-1])


def _is_passed(
    beams: Beams, segment_map: SegmentMap, T_map_base: SE2, ranges_m: FloatArray, walls: IntArray
) -> NDArray[np.bool_]:
    """(N,) which beams end well behind the walls that they should have met, at ranges_m (N,)."""
    directions = SE2(0.0, 0.0, T_map_base.theta) @ beams.directions
    cosines = np.abs(np.sum(segment_map.normals[walls] * directions, axis=1))
    with np.errstate(invalid="ignore"):
        beyond_m = (beams.ranges_m - ranges_m) * cosines
    return np.asarray(beams.is_hit & (walls >= 0) & (beyond_m > _PASSED_M))


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

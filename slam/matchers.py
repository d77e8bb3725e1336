"""The methods: each finds the pose of a scan on a map that it knows, from a predicted pose."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from slam.arrays import FloatArray
from slam.beam_likelihood import BeamConfig, BeamMatch, match_beams
from slam.beams import Beams
from slam.icp import CoarseToFineConfig, IcpConfig, match_scan, match_scan_coarse_to_fine
from slam.laser_model import LaserModel
from slam.lines import LineConfig, LineMap, match_lines
from slam.map_errors import MetSurfaces
from slam.match_verdict import VerdictConfig, less_chance
from slam.observability import as_far_as_held
from slam.point_map import PointMap
from slam.range_noise import RangeNoise
from slam.scan_match import IcpStep, MatchStatus, RangeFit, ScanMatch
from slam.scan_matching import SurfelMatch, SurfelMatchConfig, match_surfels
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from slam.surface.surfel_grid import SurfelGrid


class Matcher(Protocol):
    """A method: finds the pose of a scan on a map that it knows, from a predicted pose.

    Whatever keeps this signature works in a `Localizer`; it may search the whole map.
    """

    def __call__(self, beams: Beams, T_predicted: SE2) -> ScanMatch:
        """T_map_base of the scan, and whether to believe it."""
        ...


@dataclass(frozen=True)
class OdometryMatcher:
    """Method `odometry`: dead reckoning. The scan is not looked at, so nothing is ever matched."""

    def __call__(self, beams: Beams, T_predicted: SE2) -> ScanMatch:
        """The prediction."""
        return ScanMatch(T_predicted, MatchStatus.NOT_ATTEMPTED)


@dataclass(frozen=True)
class LineMatcher:
    """Method `line`: the laboratory's before the paper, straight lines matched with known walls."""

    line_map: LineMap
    config: LineConfig = field(default_factory=LineConfig)

    def __call__(self, beams: Beams, T_predicted: SE2) -> ScanMatch:
        """The pose that lays the scan's lines on the known walls."""
        return match_lines(beams, self.line_map, T_predicted, self.config)


@dataclass(frozen=True)
class PaperMatcher:
    """Method `paper`: plain point-to-point ICP from the odometry pose."""

    point_map: PointMap
    config: IcpConfig = field(default_factory=IcpConfig)

    def __call__(self, beams: Beams, T_predicted: SE2) -> ScanMatch:
        """The pose at which step 5 ended."""
        match = match_scan(beams.points, self.point_map, T_predicted, self.config)
        return as_far_as_held(match, beams, self.point_map, T_predicted)


@dataclass(frozen=True)
class Open3dMatcher:
    """Method `open3d`: Open3D's ICP, coarse to fine, run to convergence and judged.

    range_noise: of the laser; points of near, surer ranges then count more. None: all count alike.
    """

    point_map: PointMap
    config: CoarseToFineConfig = field(default_factory=CoarseToFineConfig)
    range_noise: RangeNoise | None = None

    def __call__(self, beams: Beams, T_predicted: SE2) -> ScanMatch:
        """The pose at which the finest stage settled."""
        points_base = beams.points
        if self.range_noise is not None:
            repeats = self.range_noise.repeats(beams.ranges_m[beams.is_hit])
            points_base = np.repeat(points_base, repeats, axis=0)
        match = match_scan_coarse_to_fine(points_base, self.point_map, T_predicted, self.config)
        return as_far_as_held(match, beams, self.point_map, T_predicted)


_REPEATED = 0.12
"""Of the covariance of one scan of `fast` on exact walls: means of 40 scans from each of 24 poses
have 0.13 of it for a squared error (room_fig4, URG-04LX), where independent ones have 0.025."""


def _on_wrong_map(match: ScanMatch, met: MetSurfaces) -> ScanMatch:
    """A match, less sure by what the map's own errors do to it: the same in all scans from there."""
    assert match.information is not None
    by_map = met.pose_covariance(match.T_map_base)
    # (R + D)^-1 for an R that may have no inverse
    information = np.linalg.solve(np.eye(3) + match.information @ by_map, match.information)
    information = (information + information.T) / 2.0
    share = float(np.linalg.eigvals(information @ by_map).real.max())
    return replace(match, information=information, repeated=min(max(share, _REPEATED), 1.0))


_NEAR_HEADINGS_RAD = (0.0, 0.175, -0.175, 0.35, -0.35)
_NEAR_SHIFTS_M = ((0.0, 0.0), (0.2, 0.0), (-0.2, 0.0), (0.0, 0.2), (0.0, -0.2))

_NEAR_COST = 0.2
"""Below it the surfels have found the pose to a few millimetres, and the blurred stages can be left
out."""
_NEAR_TURNS_RAD = (0.0, 0.06, -0.06)
_FAR_BLURS_M = (0.1, 0.03, 0.003)
"""From a start ten centimetres off: legs near by, which hide half the room, draw no beam over."""


def _starts_around(T_predicted: SE2) -> Iterable[SE2]:
    """Poses within 20 cm or 20 degrees of the predicted one, itself not among them."""
    for x, y in _NEAR_SHIFTS_M:
        for heading_rad in _NEAR_HEADINGS_RAD:
            if x or y or heading_rad:
                yield T_predicted @ SE2(x, y, heading_rad)


@dataclass(frozen=True)
class FastMatcher:
    """Method `fast`: Gauss-Newton on the surfaces of a grid, in tens of microseconds.

    good_cost: below it the first result stands; above, other starts within 20 cm and 20 degrees
    are tried. max_cost: above it no pose is believed. Costs are 0.15 at a right pose, 0.25 in a
    crowd, above 0.5 at a wrong one.
    """

    grid: SurfelGrid
    laser: LaserModel
    config: SurfelMatchConfig = field(default_factory=SurfelMatchConfig)
    verdict: VerdictConfig = field(default_factory=VerdictConfig)
    good_cost: float = 0.3
    max_cost: float = 0.45

    def __call__(self, beams: Beams, T_predicted: SE2) -> ScanMatch:
        """The pose at which the points lie on the surfaces."""
        found = self.nearest(beams, T_predicted)
        path = (
            IcpStep(T_predicted, math.inf, 0),
            IcpStep(found.T_map_base, found.cost, found.point_count),
        )
        match = ScanMatch(
            found.T_map_base,
            MatchStatus.LOST,
            found.cost,
            found.point_count,
            path,
            found.information,
            # the kernel makes of a squared residual of q sigmas q / (6 + q) of a cost
            log_likelihood=-3.0 * found.cost * found.point_count,
            repeated=_REPEATED,
        )
        judged = self._judged(match, beams, found)
        if self.grid.is_exact:
            return judged
        noise = self.laser.noise
        return _on_wrong_map(
            judged, MetSurfaces.of_points(beams, self.grid, noise, found.T_map_base)
        )

    def _judged(self, match: ScanMatch, beams: Beams, found: SurfelMatch) -> ScanMatch:
        """The match with its status, and of its information what is held."""
        if found.point_count < self.verdict.min_beams or not found.cost <= self.max_cost:
            return match
        sure = self.sure_of(beams, found.information)
        if self.verdict.is_loose(sure):
            sure = self.sure_as_seen(beams, found.T_map_base)
        if self.verdict.is_open(sure):
            held_information = self.verdict.held(sure)
            return replace(match, status=MatchStatus.DEGENERATE, information=held_information)
        is_settled = found.is_settled
        return replace(
            match, status=MatchStatus.MATCHED if is_settled else MatchStatus.NOT_CONVERGED
        )

    def sure_of(self, beams: Beams, information: FloatArray) -> FloatArray:
        """(3, 3) information without what normals that are wrong by chance seem to give."""
        return less_chance(beams, information, self.grid.normal_sigma_rad**2)

    def sure_as_seen(self, beams: Beams, T_map_base: SE2) -> FloatArray:
        """(3, 3) information of those surfaces alone that the scan's own points show to face so.

        Of fitted walls the scan's points also say better how each faces: the cells of a grid make
        stairs of a slanted wall, which seem to hold a scan along it.
        """
        met = MetSurfaces.of_points(beams, self.grid, self.laser.noise, T_map_base)
        if self.grid.is_exact:
            return self.sure_of(beams, met.that_face_as_seen(beams.middle_m).information())
        seen, variance_rad2 = met.facing_as_seen(beams.middle_m, self.grid.normal_sigma_rad)
        return less_chance(beams, seen.information(), variance_rad2)

    def nearest(self, beams: Beams, T_predicted: SE2) -> SurfelMatch:
        """The best of what the starts lead to; the predicted pose alone, where that is good."""
        scan = (beams.points, beams.middle_m, self.grid, self.laser.noise_table)
        best = match_surfels(*scan, T_predicted, self.config)
        if best.cost <= self.good_cost or best.point_count == 0:
            return best
        others = [match_surfels(*scan, start, self.config) for start in _starts_around(T_predicted)]
        return min([best, *others], key=lambda match: match.cost)


@dataclass(frozen=True)
class LimitMatcher:
    """Method `limit`: the most likely pose by the beams' own ranges, its covariance with it.

    fast: finds the neighbourhood, in which the likelihood is then climbed.
    good_inlier_ratio: below it, all starts around are climbed from, and the best is taken.
    """

    segment_map: SegmentMap
    laser: LaserModel
    fast: FastMatcher
    config: BeamConfig = field(default_factory=BeamConfig)
    verdict: VerdictConfig = field(default_factory=VerdictConfig)
    good_inlier_ratio: float = 0.8

    def __call__(self, beams: Beams, T_predicted: SE2) -> ScanMatch:
        """The pose from which the map explains the ranges best."""
        if len(beams.points) < self.verdict.min_beams:
            return ScanMatch(T_predicted, MatchStatus.LOST)
        near = self.fast.nearest(beams, T_predicted)
        known = near.information if near.is_settled and near.cost <= _NEAR_COST else None
        best = self._climbed(beams, near.T_map_base, self.config, known)
        if best.inlier_ratio < self.good_inlier_ratio or not best.is_settled:
            best = self._best_around(beams, T_predicted, best)
        path = (
            IcpStep(T_predicted, math.inf, 0),
            IcpStep(near.T_map_base, near.cost, near.point_count),
            IcpStep(best.T_map_base, best.cost, best.used),
        )
        fit = RangeFit(
            best.inlier_ratio, best.scale, best.offset_m, best.offset_sigma_m, best.missing_ratio,
            self.laser.noise,
        )  # fmt: skip
        information = sure = best.information
        if not self.segment_map.is_exact:
            information = sure = self.fast.sure_of(beams, information)
            if self.verdict.is_loose(sure):
                sure = self.fast.sure_as_seen(beams, best.T_map_base)
        status = self._status(best, sure)
        if status is MatchStatus.DEGENERATE:
            information = self.verdict.held(sure)
        match = ScanMatch(
            best.T_map_base,
            status,
            best.cost,
            best.used,
            path,
            information,
            fit,
            log_likelihood=-0.5 * best.used * (best.cost - 1.0),
            repeated=_REPEATED,
            smooth=best.smooth,
        )
        if self.segment_map.is_exact:
            return match
        return _on_wrong_map(
            match,
            MetSurfaces.of_beams(
                beams, self.segment_map, self.laser, best.T_map_base, best.noise_scale
            ),
        )

    def _climbed(
        self, beams: Beams, T_start: SE2, config: BeamConfig, known: FloatArray | None = None
    ) -> BeamMatch:
        return match_beams(beams, self.segment_map, self.laser, T_start, config, known)

    def _best_around(self, beams: Beams, T_predicted: SE2, best: BeamMatch) -> BeamMatch:
        """The most likely of what the prediction and the starts around it lead to, from afar."""
        scan = (beams.points, beams.middle_m, self.fast.grid, self.laser.noise_table)
        found = [
            match_surfels(*scan, T_start, self.fast.config)
            for T_start in _starts_around(T_predicted)
        ]
        found.sort(key=lambda match: match.cost)
        near = [T_predicted @ SE2(0.0, 0.0, turn_rad) for turn_rad in _NEAR_TURNS_RAD]
        starts = [*near, *(match.T_map_base for match in found[:3])]
        from_afar = replace(self.config, blurs_m=_FAR_BLURS_M)
        ends = [best, *(self._climbed(beams, T_start, from_afar) for T_start in starts)]
        return min(ends, key=lambda match: (not match.is_settled, match.cost))

    def _status(self, match: BeamMatch, information: FloatArray) -> MatchStatus:
        verdict = self.verdict
        fits = match.inlier_ratio >= verdict.min_inlier_ratio
        if (
            match.used < verdict.min_beams
            or not fits
            or verdict.are_walls_missing(match.inlier_ratio, match.behind_ratio)
        ):
            return MatchStatus.LOST
        if verdict.is_open(information):
            return MatchStatus.DEGENERATE
        return MatchStatus.MATCHED if match.is_settled else MatchStatus.NOT_CONVERGED

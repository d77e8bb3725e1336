"""Where on the map a scan may have been taken, with no idea beforehand."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from slam.arrays import BoolArray, FloatArray
from slam.beams import Beams
from slam.evidence import Evidence, EvidenceConfig, evidence_of
from slam.in_steps import Steps, all_at_once
from slam.kernels.normal_equations import inverted, widest
from slam.laser_model import LaserModel
from slam.likelihood_grid import LikelihoodGrid, SearchConfig, layout, spread
from slam.scan_matching import SurfelMatchConfig, match_surfels
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from slam.surface.surfel_grid import SurfelGrid

_SQUARE_M = 1.6
"""Chosen: 256 positions; a quarter or four times as many take as long."""
_HALF_SQUARE_M = 1.0001 * math.sqrt(0.5) * _SQUARE_M
"""From its middle to a corner, and above rounding."""

_SEARCH, REFINED = 50, 3
"""What the search of the grid costs, on the Intel log, and `Relocalizer.refined`: see `Steps`."""

FreeSpace = Callable[[FloatArray], BoolArray]
"""Says of positions (N, 2) [m], map frame, whether the robot may be there."""


@dataclass(frozen=True)
class RelocalizerConfig:
    """How a `Relocalizer` works.

    search: over the whole map. evidence: None: what suits the map. first, last: how a candidate is
    refined, on few points and on all; carried: one that wheels brought here; fit: how far off a
    surface a point is that does not lie on it; chosen: what walls made of scans are off. apart_m,
    apart_rad: poses closer than both are one hypothesis. max_refined: the best candidates that are
    refined on all points. max_behind: of log-likelihood, behind the best, at which a hypothesis is
    not worth returning. sure_score: a candidate with so much of the best one's score is refined on all
    points as well. loose_m: standard deviation from which on a scan holds a direction loosely;
    ridge_m: how far along it to look for what is as likely; ridge_scale: of log-likelihood, a
    difference that may be chance. chosen, all three: on the Intel log, where walls are 5 cm off and
    a step of as much changes it by four at random; ACES, Freiburg and MIT do not contradict.
    """

    search: SearchConfig = field(default_factory=SearchConfig)
    evidence: EvidenceConfig | None = None
    first: SurfelMatchConfig = field(
        default_factory=lambda: SurfelMatchConfig(scales_m=(0.15, 0.05), strides=(1, 1))
    )
    last: SurfelMatchConfig = field(
        default_factory=lambda: SurfelMatchConfig(scales_m=(0.05, 0.0), strides=(2, 1))
    )
    carried: SurfelMatchConfig = field(
        default_factory=lambda: SurfelMatchConfig(scales_m=(0.3, 0.1, 0.0), strides=(4, 2, 1))
    )
    fit: SurfelMatchConfig = field(
        default_factory=lambda: SurfelMatchConfig(scales_m=(0.05,), strides=(1,), max_steps=1)
    )
    apart_m: float = 0.3
    apart_rad: float = math.radians(8.0)
    max_refined: int = 8
    max_behind: float = 100.0
    sure_score: float = 0.85
    loose_m: float = 0.015
    ridge_m: float = 0.2
    ridge_scale: float = 4.0


@dataclass(frozen=True)
class Hypothesis:
    """A pose where a scan may have been taken, and what the scan says for it.

    log_likelihood: summed over the scans that were joined; evidence: of the last one. surface_fit:
    summed as well, which of several that are nearly as likely comes first. violations: shares of
    beams that went through walls, summed as well.
    """

    T_map_base: SE2
    evidence: Evidence
    log_likelihood: float
    surface_fit: float = 0.0
    violations: float = 0.0


@dataclass(frozen=True, eq=False)
class Relocalizer:
    """Finds a scan anywhere on a map: branch and bound, refined, then asked what contradicts it."""

    segment_map: SegmentMap
    surfels: SurfelGrid
    grid: LikelihoodGrid
    laser: LaserModel
    config: RelocalizerConfig

    @staticmethod
    def of(
        segment_map: SegmentMap,
        surfels: SurfelGrid,
        laser: LaserModel,
        is_free: FreeSpace | None = None,
        config: RelocalizerConfig | None = None,
    ) -> Relocalizer:
        """For a map of walls. is_free: where to search; None: in front of the walls."""
        config = config or RelocalizerConfig()
        evidence = config.evidence or EvidenceConfig.fit_for(segment_map)
        config = replace(config, evidence=evidence)
        cell_m = config.search.cell_m
        reach_m = laser.range_max_m
        # refuses a map too large before it is cut into pieces
        layout(segment_map.segments.reshape(-1, 2), reach_m, config.search)
        points = segment_map.sampled(cell_m / 4.0)[0]
        open_side = is_free or in_front_of(segment_map, cell_m)
        grid = LikelihoodGrid.of(points, reach_m, open_side, config.search)
        return Relocalizer(segment_map, surfels, grid, laser, config)

    def __call__(self, beams: Beams) -> list[Hypothesis]:
        """The places where the scan may have been taken, the most likely first; none for no hits."""
        return all_at_once(self.in_steps(beams))

    def in_steps(self, beams: Beams) -> Steps[list[Hypothesis]]:
        """The same, a piece at a time."""
        points = beams.points
        search = self.config.search
        few = spread(points, search.cell_m, search.max_points, np.inf)
        yield _SEARCH
        candidates = self.grid.search(points)
        starts = [candidate.T_map_base for candidate in candidates]
        found = []
        for start in starts:
            yield 1
            found.append(self._refined(beams, few, start, self.config.first))
        # legs near by may lead astray those few points
        first = candidates[: self.config.max_refined]
        least = self.config.sure_score * max((one.score for one in first), default=0.0)
        for one in first:
            if one.score >= least:
                yield REFINED
                found.append(self.refined(beams, one.T_map_base))
        if not self.segment_map.is_exact:
            # where the map is poor, refining may lead away from a pose that was right
            for start in starts:
                yield 1
                found.append(self.at(beams, start))
        again = self.distinct(found)[: self.config.max_refined]
        yield len(again)
        last = [self._refined(beams, points, one.T_map_base, self.config.last) for one in again]
        return self.distinct(one for pair in zip(again, last, strict=True) for one in pair)

    def refined(self, beams: Beams, T_map_base: SE2) -> Hypothesis:
        """The hypothesis near a pose, on all points; the pose itself where that is more likely."""
        # from afar a likelihood as wide as the way to go misleads at times, a narrow one at others
        return max(
            self.at(beams, T_map_base),
            self._refined(beams, beams.points, T_map_base, self.config.carried),
            self._refined(beams, beams.points, T_map_base, self.config.last),
            key=lambda hypothesis: hypothesis.log_likelihood,
        )

    def at(self, beams: Beams, T_map_base: SE2) -> Hypothesis:
        """What the scan says for a pose as it is."""
        evidence = evidence_of(
            beams, self.segment_map, self.laser, T_map_base, self.config.evidence
        )
        return Hypothesis(
            T_map_base, evidence, evidence.log_likelihood, violations=evidence.violation_ratio
        )

    def surface_fit(self, beams: Beams, hypothesis: Hypothesis) -> float:
        """Log-likelihood of the scan's points to lie on the map's surfaces, at a pose as it is.

        0 where the map is exactly known, and evidence misses nothing. On a map made of scans it is
        jagged, each beam meeting one short wall or its neighbour: what is left of it between two
        corridors that look alike is chance, and how near the points lie tells more.
        """
        if self.segment_map.is_exact:
            return 0.0
        # the kernel makes of a squared residual of q sigmas q / (6 + q) of a cost
        return -3.0 * self.off_surfaces(beams, hypothesis.T_map_base) * hypothesis.evidence.used

    def off_surfaces(self, beams: Beams, T_map_base: SE2) -> float:
        """Share of the scan's points that lie on no surface at a pose, each as far as it does not.

        Says less than `at`, in a thirtieth of its time.
        """
        match = match_surfels(
            beams.points, beams.middle_m, self.surfels, self.laser.noise_table, T_map_base,
            self.config.fit,
        )  # fmt: skip
        return match.cost

    def centred(self, beams: Beams, T_map_base: SE2) -> SE2:
        """The middle of what is as likely as a pose, along a direction that is held loosely.

        Along a corridor of fitted walls the likelihood is jagged, and its highest point is chance.
        The pose itself where the points hold all directions.
        """
        config = self.config
        match = match_surfels(
            beams.points, beams.middle_m, self.surfels, self.laser.noise_table, T_map_base,
            config.last,
        )  # fmt: skip
        if widest(match.information)[0] < config.loose_m:
            return T_map_base
        covariance = inverted(match.information)
        _, directions = np.linalg.eigh(covariance[:2, :2])
        along = covariance[:, :2] @ directions[:, 1]
        along /= math.hypot(along[0], along[1])
        steps_m = np.arange(-4, 5) * (config.ridge_m / 4.0)
        likelihoods = [
            self.at(beams, T_map_base @ SE2.exp(step_m * along)).log_likelihood
            for step_m in steps_m
        ]
        weights = np.exp((np.array(likelihoods) - max(likelihoods)) / config.ridge_scale)
        return T_map_base @ SE2.exp(float(weights @ steps_m / weights.sum()) * along)

    def distinct(
        self, hypotheses: Iterable[Hypothesis], max_behind: float | None = None
    ) -> list[Hypothesis]:
        """The best of each place, best first; none so much less likely than the best of all.

        max_behind: None: as configured.
        """
        if max_behind is None:
            max_behind = self.config.max_behind
        apart = self.config.apart_m, self.config.apart_rad
        kept: list[Hypothesis] = []
        for one in sorted(hypotheses, key=lambda one: -one.log_likelihood):
            if kept and one.log_likelihood < kept[0].log_likelihood - max_behind:
                break
            if not any(one.T_map_base.is_near(other.T_map_base, *apart) for other in kept):
                kept.append(one)
        return kept

    def _refined(
        self, beams: Beams, points: FloatArray, T_start: SE2, config: SurfelMatchConfig
    ) -> Hypothesis:
        match = match_surfels(
            points, beams.middle_m, self.surfels, self.laser.noise_table, T_start, config
        )
        return self.at(beams, match.T_map_base)


def in_front_of(segment_map: SegmentMap, slack_m: float) -> FreeSpace:
    """Where some wall's open side is the nearest of all walls; anywhere, if walls have two.

    slack_m: so far behind a wall still counts.
    """
    if not segment_map.is_one_sided:
        return lambda points: np.ones(len(points), dtype=np.bool_)
    samples, owners = segment_map.sampled(slack_m / 2.0)
    normals, tree = segment_map.normals[owners], cKDTree(samples)

    def is_free_at(points: FloatArray) -> BoolArray:
        _, nearest = tree.query(points)
        return np.asarray(np.sum((points - samples[nearest]) * normals[nearest], axis=1) > -slack_m)

    def of_square(middle: FloatArray, distance_m: float) -> int:
        """1 where all of a square is free, 0 where none, -1 where that is to be looked at."""
        # one of these is nearest, wherever in the square
        near = tree.query_ball_point(middle, distance_m + 2.0 * _HALF_SQUARE_M)
        in_front_m = np.sum((middle - samples[near]) * normals[near], axis=1) + slack_m
        if in_front_m.min() > _HALF_SQUARE_M:
            return 1
        return 0 if in_front_m.max() < -_HALF_SQUARE_M else -1

    def is_free(points: FloatArray) -> BoolArray:
        # far from all walls each look takes long, and squares tell as much
        squares = np.floor(points / _SQUARE_M).astype(np.int64)
        _, first, of_point = np.unique(
            squares[:, 0] * (1 << 32) + squares[:, 1], return_index=True, return_inverse=True
        )
        middles = (squares[first] + 0.5) * _SQUARE_M
        distances_m = np.asarray(tree.query(middles)[0])
        told = [of_square(*one) for one in zip(middles, distances_m.tolist(), strict=True)]
        found = np.array(told, dtype=np.int64)[of_point]
        is_open: BoolArray = found == 1
        is_open[found < 0] = is_free_at(points[found < 0])
        return is_open

    return is_free

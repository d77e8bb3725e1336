"""How well scans fit a map where they were taken and where they were not, learnt from the map itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from slam.beams import Beams
from slam.in_steps import Steps, all_at_once
from slam.kernels.beam_search import reach_of
from slam.relocalization import Relocalizer
from slam.se2 import SE2

_SCANS = 150
_FEWEST = 3
_LEG_M = 0.06
_STRIDE_M = 0.25
"""A person in the way: two legs of this radius, so far apart."""
_VIRTUAL_SCAN = 6
"""What one costs, in looks: see `Steps`."""


@dataclass(frozen=True)
class VerdictLimits:
    """What is usual on one map for one laser.

    usual_inlier_ratio: fewer beams than that fit once in a hundred right poses; usual_violation_ratio:
    more go through walls as seldom. wrong_inlier_ratio: as many fit at one in a hundred poses where
    the scan was not taken. usual_unexplained: of log-likelihood, per beam: more is left as seldom.
    """

    usual_inlier_ratio: float
    usual_violation_ratio: float
    wrong_inlier_ratio: float
    usual_unexplained: float

    @staticmethod
    def usual_for(relocalizer: Relocalizer, beams: Beams) -> VerdictLimits:
        """What is usual for lasers such as the one of `beams`, found once for each map.

        Its fan is rounded before, so that the numbers do not depend on which scan comes first.
        """
        return all_at_once(VerdictLimits.usual_in_steps(relocalizer, beams))

    @staticmethod
    def usual_in_steps(relocalizer: Relocalizer, beams: Beams) -> Steps[VerdictLimits]:
        """The same, a piece at a time: it takes half a second, where it is found for the first time."""
        fan = _Fan.of(beams)
        known = _KNOWN.setdefault(relocalizer, {})
        if fan not in known:
            known[fan] = yield from VerdictLimits._learnt(relocalizer, fan.beams())
        return known[fan]

    @staticmethod
    def calibrated(relocalizer: Relocalizer, beams: Beams, people: int = 3) -> VerdictLimits:
        """Of virtual scans with the directions of `beams`, drawn from the map and the laser's model.

        Ray-cast from places the search looks at, with the noise assumed, walls as uncertain as the
        map says, and people in the way. The same numbers at each call. Of fewer than three beams,
        which fit anywhere or nowhere, it learns nothing.
        """
        return all_at_once(VerdictLimits._learnt(relocalizer, beams, people))

    @staticmethod
    def _learnt(relocalizer: Relocalizer, beams: Beams, people: int = 3) -> Steps[VerdictLimits]:
        if len(beams) < _FEWEST:
            return _UNKNOWN
        rng = np.random.default_rng(0)
        places = _places(relocalizer, rng)
        right, violations, wrong, unexplained = [], [], [], []
        last: Beams | None = None
        for T_map_base in places:
            yield _VIRTUAL_SCAN
            scan = virtual_scan(relocalizer, beams, T_map_base, rng, people)
            if np.count_nonzero(scan.is_hit) < 0.1 * len(scan):
                continue
            nearly = T_map_base @ SE2(*rng.normal(0.0, [0.005, 0.005, 0.002]))
            at = relocalizer.at(scan, nearly).evidence
            right.append(at.inlier_ratio)
            violations.append(at.violation_ratio)
            unexplained.append(at.unexplained)
            if last is not None:
                wrong.append(relocalizer.at(last, T_map_base).evidence.inlier_ratio)
            last = scan
        if len(wrong) < 10:
            return _UNKNOWN
        return VerdictLimits(
            float(np.percentile(right, 1.0)),
            float(np.percentile(violations, 99.0)),
            float(np.percentile(wrong, 99.0)),
            float(np.percentile(unexplained, 99.0)),
        )


_UNKNOWN = VerdictLimits(0.8, 0.1, 0.5, 0.8)
"""Chosen: where a map has hardly a place from which walls are in reach, so that it teaches nothing;
rooms and lasers of ours have 0.9 and more, 0.05 and less, 0.3 to 0.6, and 0.6 to 0.8."""


@dataclass(frozen=True)
class _Fan:
    """The directions of a scan, rounded: those of one laser, whatever the robot's motion was."""

    count: int
    first_deg: int
    last_deg: int
    middle_cm: tuple[int, int]

    @staticmethod
    def of(beams: Beams) -> _Fan:
        ends = beams.angles_rad[[0, -1]] if len(beams) else np.zeros(2)
        first, last = (10 * round(math.degrees(end) / 10.0) for end in ends)
        x, y = (5 * round(20.0 * along) for along in beams.middle_m)
        return _Fan(len(beams), first, last, (x, y))

    def beams(self) -> Beams:
        """As many, evenly between the ends, from one origin."""
        angles = np.radians(np.linspace(self.first_deg, self.last_deg, self.count))
        middle_m = np.array(self.middle_cm) / 100.0
        return Beams(np.tile(middle_m, (self.count, 1)), angles, np.zeros(self.count))


_KNOWN: WeakKeyDictionary[Relocalizer, dict[_Fan, VerdictLimits]] = WeakKeyDictionary()


def virtual_scan(
    relocalizer: Relocalizer,
    beams: Beams,
    T_map_base: SE2,
    rng: np.random.Generator,
    people: int = 0,
) -> Beams:
    """What the laser would measure at a pose, if map and model were right, and people about."""
    walls, laser = relocalizer.segment_map, relocalizer.laser
    ranges_m, hits = walls.ranges(beams, T_map_base, float(reach_of(laser.limits_m)))
    sigma_m = laser.noise.sigma_m(np.minimum(ranges_m, laser.range_max_m))
    wall_sigma_m = np.where(hits >= 0, walls.sigma_m[hits], 0.0)
    ranges_m = ranges_m + rng.normal(size=len(beams)) * np.hypot(sigma_m, wall_sigma_m)
    for _ in range(people):
        bearing, away_m = rng.uniform(-math.pi, math.pi), rng.uniform(0.5, 3.0)
        for side in (-0.5, 0.5):
            at = bearing + side * _STRIDE_M / away_m
            is_met = np.abs(np.angle(np.exp(1j * (beams.angles_rad - at)))) < _LEG_M / away_m
            ranges_m[is_met & (ranges_m > away_m)] = away_m
    ranges_m[ranges_m > laser.range_max_m] = np.inf
    ranges_m[ranges_m < max(laser.range_min_m, 0.0)] = np.nan
    return beams.with_ranges(ranges_m)


def _places(relocalizer: Relocalizer, rng: np.random.Generator) -> list[SE2]:
    """Poses at which the search looks, some way from all walls."""
    grid = relocalizer.grid
    rows, columns = np.nonzero(grid.is_open[0])
    picks = rng.permutation(len(rows))
    x = grid.origin_m[0] + (columns + 0.5) * grid.config.cell_m
    y = grid.origin_m[1] + (rows + 0.5) * grid.config.cell_m
    found: list[SE2] = []
    all_round = Beams(np.zeros((36, 2)), np.linspace(-math.pi, math.pi, 36, False), np.zeros(36))
    for pick in picks[: 20 * _SCANS]:
        T_map_base = SE2(x[pick], y[pick], rng.uniform(-math.pi, math.pi))
        around_m, _ = relocalizer.segment_map.ranges(all_round, T_map_base, 1e3)
        # a place inside: walls nearly all round, none of them too near to stand
        if np.isfinite(around_m).mean() > 0.9 and around_m.min() > 0.2:
            found.append(T_map_base)
        if len(found) == _SCANS:
            break
    return found

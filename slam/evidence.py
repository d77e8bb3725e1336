"""What a scan says for a pose on a map: how likely it is there, and what contradicts the map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.kernels.beam_evidence import (
    EVIDENCE_COUNT,
    FITS,
    LOG_LIKELIHOOD,
    MISSED,
    PASSED,
    SHORT,
    USED,
    weigh,
)
from slam.kernels.beam_search import reach_of
from slam.laser_model import LaserModel
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap


@dataclass(frozen=True)
class EvidenceConfig:
    """How `evidence_of` weighs the beams of a scan.

    elsewhere_odds, through_odds, behind_odds, silent_odds: of a beam against one that meets its
    wall: that ends where the map has none (somebody stands there); that goes through a wall to
    another (a door was closed, a chair taken away); through a wall to nowhere; that does not
    come back. blur_m, blur_rad: how far off poses and walls may be. thickness_m: beams that end
    less behind a wall have not gone through it. beam_rad: beams closer than this share what is
    wrong with the map about them, and count for one together; chosen: 1 degree.
    """

    elsewhere_odds: float = 0.05
    through_odds: float = 0.02
    behind_odds: float = 0.01
    silent_odds: float = 0.1
    blur_m: float = 0.01
    blur_rad: float = 0.003
    thickness_m: float = 0.0
    beam_rad: float = math.radians(1.0)

    def __post_init__(self) -> None:
        if not 0.0 < float(self.odds.min()) <= float(self.odds.max()) < 1.0:
            raise ValueError(f"odds must lie between 0 and 1, not at {self.odds.tolist()}")

    @staticmethod
    def fit_for(segment_map: SegmentMap) -> EvidenceConfig:
        """As it is for a map that is exactly known; wider for one that was made of scans.

        chosen on the Intel, ACES and Freiburg logs: there walls are 5 cm off, and a quarter of a
        scan may go through what stood there when the map was made.
        """
        if segment_map.is_exact:
            return EvidenceConfig()
        return EvidenceConfig(
            elsewhere_odds=0.1,
            through_odds=0.2,
            behind_odds=0.1,
            silent_odds=0.3,
            blur_m=0.05,
            blur_rad=0.01,
            thickness_m=0.3,
        )

    @cached_property
    def odds(self) -> FloatArray:
        """(4,) in the order above."""
        return np.array(
            [self.elsewhere_odds, self.through_odds, self.behind_odds, self.silent_odds]
        )


@dataclass(frozen=True)
class Evidence:
    """What one scan says for one pose.

    log_likelihood: of its ranges, 0 where all of them fit. used: beams that could tell,
    each counting what `EvidenceConfig.beam_rad` makes of it. Of these inlier_ratio met their walls;
    violation_ratio went through a wall; short_ratio ended before it; missed_ratio did not return.
    """

    log_likelihood: float
    used: float
    inlier_ratio: float
    violation_ratio: float
    short_ratio: float
    missed_ratio: float

    @property
    def unexplained(self) -> float:
        """Of log-likelihood, per beam that could tell."""
        return -self.log_likelihood / max(self.used, 1.0)


def evidence_of(
    beams: Beams,
    segment_map: SegmentMap,
    laser: LaserModel,
    T_map_base: SE2,
    config: EvidenceConfig | None = None,
) -> Evidence:
    """What the scan says for the pose. All zeros for a scan of nothing."""
    config = config or EvidenceConfig.fit_for(segment_map)
    reach_m = float(reach_of(laser.limits_m))
    first, first_walls = segment_map.ranges(beams, T_map_base, reach_m)
    nearest, walls = first, first_walls
    if not segment_map.is_exact:
        # what stood there when the map was made may have gone since
        targets = np.where(beams.is_hit, beams.ranges_m, 0.0)
        nearest, walls = segment_map.ranges(beams, T_map_base, reach_m, targets)
    sums = np.zeros(EVIDENCE_COUNT)
    weigh(
        segment_map.normals, segment_map.sigma_m, beams.directions, beams.ranges_m,
        laser.noise_table, laser.limits_m, config.odds,
        float(laser.outliers[1]), config.blur_m, config.blur_rad, config.thickness_m,
        T_map_base.theta, first, first_walls, nearest, walls, _weight(beams, config.beam_rad), sums,
    )  # fmt: skip
    used = max(float(sums[USED]), 1e-12)
    return Evidence(
        float(sums[LOG_LIKELIHOOD]), float(sums[USED]), float(sums[FITS]) / used,
        float(sums[PASSED]) / used, float(sums[SHORT]) / used, float(sums[MISSED]) / used,
    )  # fmt: skip


def _weight(beams: Beams, beam_rad: float) -> float:
    """What each beam counts: by its share of the angle that counts for one."""
    if len(beams) < 2:
        return 1.0
    step_rad = float(beams.angles_rad[-1] - beams.angles_rad[0]) / (len(beams) - 1)
    return min(1.0, step_rad / beam_rad)

"""How a tracker's matches are judged, and when its robot is lost."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from slam.guard.hypotheses_config import HypothesesConfig
from slam.guard.laser_faults import LaserFaultConfig
from slam.guard.slip import SlipConfig
from slam.guard.unmapped import UnmappedConfig
from slam.guard.usual_fit import UsualFitConfig


@dataclass(frozen=True)
class GuardConfig:
    """How a `Guard` judges.

    hypotheses, unmapped: None: what suits the map. jump_m, jump_rad: standard deviations of a match
    beside what it claims, when its innovation is judged; max_jump: normalised innovation squared that
    no wheel explains: 30 is exceeded by chance once in a million. patience: scans in a row that
    nothing explains before the robot says that it is lost. turn_rad: steps of looking around.
    off_surfaces: share of the points that lie on no surface, below which a scan may well be where
    the wheels lead; near_m, near_rad: of a place within both a matcher may find its way there, which
    reaches 0.2 m. recheck_drop, recheck_m: a scan that was found to fit here best is not searched
    for again before it fits so much worse, or the robot went so far. Chosen, all of these.
    """

    hypotheses: HypothesesConfig | None = None
    usual: UsualFitConfig = field(default_factory=UsualFitConfig)
    slip: SlipConfig = field(default_factory=SlipConfig)
    laser_faults: LaserFaultConfig = field(default_factory=LaserFaultConfig)
    unmapped: UnmappedConfig | None = None
    jump_m: float = 0.03
    jump_rad: float = math.radians(1.2)
    max_jump: float = 30.0
    patience: int = 3
    turn_rad: float = math.radians(40.0)
    off_surfaces: float = 0.5
    near_m: float = 0.5
    near_rad: float = math.radians(30.0)
    recheck_drop: float = 0.05
    recheck_m: float = 0.5

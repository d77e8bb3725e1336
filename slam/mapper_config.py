"""How a `Mapper` works: all that was chosen, in one place."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slam.arrays import FloatArray
from slam.backend.joint_adjustment import AdjustmentConfig
from slam.backend.older_keyframes import RECENT
from slam.backend.session_joining import JoiningConfig
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.strays import StrayConfig
from slam.loop_closing import LoopConfig
from slam.map_checks.map_consistency import ConsistencyConfig
from slam.slam_map import STEP_SIGMA


@dataclass(frozen=True)
class MapperConfig:
    """How a `Mapper` works.

    drift_m, drift_rad: by which two keyframes may lie otherwise for each metre of the shortest way
    between them, over steps and loops, start_m, start_rad beside that; most_drift: (m, rad) that is
    looked for at most. solve_every: keyframes after which the poses are adjusted, if there are new
    loops, by so many online_iterations at most; recent: keyframes all of which are, and
    none of which is let go, see `OlderKeyframes`. step_sigma: (m, m, rad) of the motion between two keyframes beside
    what the front end says. crowd: keyframes within crowd_m and crowd_rad of one, of which no more
    scans are kept, and of those asked for loops but one in crowd_every: memory and time grow with the
    map, not with the drive. patient_rounds, patient_inlier_ratio: of loops looked for where a map does
    not hold together. Chosen, all of these.
    is_odometry_doubted: what odometry tells is where a scan is looked for first, and no more; what
    scans say against it still counts. range_offset_m: by which all ranges are too long, as known before.
    """

    front_end: FrontEndConfig = field(default_factory=FrontEndConfig)
    loops: LoopConfig = field(default_factory=LoopConfig)
    adjustment: AdjustmentConfig = field(default_factory=AdjustmentConfig)
    consistency: ConsistencyConfig = field(default_factory=ConsistencyConfig)
    joining: JoiningConfig = field(default_factory=JoiningConfig)
    strays: StrayConfig = field(default_factory=StrayConfig)
    start_m: float = 0.1
    drift_m: float = 0.01
    start_rad: float = 0.02
    drift_rad: float = 0.002
    most_drift: tuple[float, float] = (3.5, 0.35)
    solve_every: int = 25
    online_iterations: int = 1
    recent: int = RECENT
    step_sigma: tuple[float, float, float] = STEP_SIGMA
    crowd: int = 8
    crowd_m: float = 0.4
    crowd_rad: float = 0.35
    crowd_every: int = 4
    patient_rounds: int = 3
    patient_inlier_ratio: float = 0.78
    is_odometry_doubted: bool = False
    range_offset_m: float = 0.0

    def drifted(self, ways_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """By how much keyframes may lie otherwise (K,) [m], (K,) [rad] at the end of such ways (K,)."""
        sigma_m = np.minimum(self.start_m + self.drift_m * ways_m, self.most_drift[0])
        sigma_rad = np.minimum(self.start_rad + self.drift_rad * ways_m, self.most_drift[1])
        return sigma_m, sigma_rad

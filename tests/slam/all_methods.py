"""Every method that looks at scans, made ready for a map of walls, as the experiments make them."""

from __future__ import annotations

import numpy as np

from slam.icp import CoarseToFineConfig, IcpConfig, StopRule
from slam.laser_model import LaserModel
from slam.lines import LineMap
from slam.localization import Localizer, LocalizerConfig
from slam.matchers import (
    FastMatcher,
    LimitMatcher,
    LineMatcher,
    Matcher,
    Open3dMatcher,
    PaperMatcher,
)
from slam.point_map import PointMap
from slam.range_noise import RangeNoise
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from slam.surface.surfel_grid import SurfelGrid
from tests.slam.synthetic import sampled

METHODS = ("line", "paper", "open3d", "fast", "limit")
SIGMA_M = 0.01
MODEL = LaserModel(RangeNoise(((1.0, SIGMA_M),)), 0.02, 10.0)
# as experiments.paper has it
PAPER = IcpConfig(max_pair_distance_m=10.0, threshold_m2=1.6e-3, stop_rule=StopRule.FIRST_BELOW)


def matchers(segments: np.ndarray, laser: LaserModel = MODEL) -> dict[str, Matcher]:
    """The methods by name for walls (S, 2, 2)."""
    points, segment_map = PointMap(sampled(segments, 0.01), 0.01), SegmentMap(segments)
    fast = FastMatcher(SurfelGrid.of(segment_map), laser)
    # one start heading: a fifth of the time, and the prediction is near here
    one = CoarseToFineConfig(start_headings_rad=(0.0,))
    return {
        "line": LineMatcher(LineMap(segments)),
        "paper": PaperMatcher(points, PAPER),
        "open3d": Open3dMatcher(points, one, laser.noise),
        "fast": fast,
        "limit": LimitMatcher(segment_map, laser, fast),
    }


def localizer(
    name: str,
    matcher: Matcher,
    believed: SE2,
    T_base_laser: SE2,
    config: LocalizerConfig | None = None,
) -> Localizer:
    """As the experiments make it: the paper knows no deskewing."""
    config = config or LocalizerConfig(deskew=name != "paper")
    return Localizer(matcher, believed, T_base_laser, config)

"""2D lidar localisation and mapping: NumPy in, NumPy out, no simulator, no ROS.

Where to begin:

- `read_log` reads a recorded drive (CARMEN, ROS bag, encoder ticks) as a `Log`, whose
  `measurements()` are `Measurement`s; your own scans and odometry make them as well.
- `Mapper` makes a `SlamMap` of them; `write_slam_map` and `read_slam_map` keep it. `IcpMapper` maps
  as the paper does, by plain ICP on all points seen so far.
- `Localizer` follows the robot on a map and says how far its `Estimate` is to be believed
  (`Verdict`). `SlamMap.localizer` makes one; `KnownMap` does of an `OccupancyGrid`, which `read_map`
  reads from a ROS map.
- Each method is a `Matcher`: `LimitMatcher` (the most accurate), `FastMatcher`, `Open3dMatcher`,
  `PaperMatcher`, `LineMatcher`, `OdometryMatcher`; a function of your own is one, too.

Poses are `SE2`: x, y [m], theta [rad], counter-clockwise; `T_a_b` takes coordinates in b to a.
Open3D is not imported before its first use.
"""

from slam.beam_likelihood import BeamConfig, cramer_rao_bound, fisher_information, match_beams
from slam.beams import Beams
from slam.calibration import Calibration, CalibrationConfig, calibrate
from slam.files.map_files import read_map, write_map
from slam.files.slam_map_files import read_slam_map, write_slam_map
from slam.frontend.keyframes import StepStatus
from slam.guard.guard_config import GuardConfig
from slam.icp import CoarseToFineConfig, IcpConfig, StopRule, match_scan, match_scan_coarse_to_fine
from slam.icp_mapping import IcpMap, IcpMapper
from slam.known_map import KnownMap
from slam.laser_model import LaserModel
from slam.lines import LineMap, match_lines
from slam.localization import Estimate, Localizer, LocalizerConfig
from slam.loop_closing import Loop
from slam.lost import Guard
from slam.map_checks.map_consistency import MapVerdict
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper, MapperStep
from slam.match_verdict import VerdictConfig
from slam.matchers import (
    FastMatcher,
    LimitMatcher,
    LineMatcher,
    Matcher,
    OdometryMatcher,
    Open3dMatcher,
    PaperMatcher,
)
from slam.measurements import LaserScan, Measurement
from slam.occupancy_grid import OccupancyGrid
from slam.odometry import DifferentialDrive, OdometryNoise, WheelModel
from slam.point_map import PointMap
from slam.range_noise import RangeNoise
from slam.readers.carmen import read_carmen
from slam.readers.log import Log, LogChoice
from slam.readers.recognition import read_log
from slam.readers.ticks import read_ticks
from slam.relocalization import Hypothesis, Relocalizer
from slam.scan_match import IcpStep, MatchStatus, RangeFit, ScanMatch
from slam.scan_matching import SurfelMatchConfig, match_surfels
from slam.se2 import SE2
from slam.slam_map import SlamMap
from slam.surface.segment_map import SegmentMap
from slam.surface.surfaces import Surfaces
from slam.surface.surfel_grid import SurfelGrid
from slam.trajectory import Trajectory, read_tum, write_tum
from slam.verdict import Status, Verdict
from slam.warm_up import warm_up
from slam.wheel_prior import WheelPrior

__all__ = [
    "SE2",
    "BeamConfig",
    "Beams",
    "Calibration",
    "CalibrationConfig",
    "CoarseToFineConfig",
    "DifferentialDrive",
    "Estimate",
    "FastMatcher",
    "Guard",
    "GuardConfig",
    "Hypothesis",
    "IcpConfig",
    "IcpMap",
    "IcpMapper",
    "IcpStep",
    "KnownMap",
    "LaserModel",
    "LaserScan",
    "LimitMatcher",
    "LineMap",
    "LineMatcher",
    "Localizer",
    "LocalizerConfig",
    "Log",
    "LogChoice",
    "Loop",
    "MapVerdict",
    "Mapper",
    "MapperConfig",
    "MapperStep",
    "MatchStatus",
    "Matcher",
    "Measurement",
    "OccupancyGrid",
    "OdometryMatcher",
    "OdometryNoise",
    "Open3dMatcher",
    "PaperMatcher",
    "PointMap",
    "RangeFit",
    "RangeNoise",
    "Relocalizer",
    "ScanMatch",
    "SegmentMap",
    "SlamMap",
    "Status",
    "StepStatus",
    "StopRule",
    "Surfaces",
    "SurfelGrid",
    "SurfelMatchConfig",
    "Trajectory",
    "Verdict",
    "VerdictConfig",
    "WheelModel",
    "WheelPrior",
    "calibrate",
    "cramer_rao_bound",
    "fisher_information",
    "match_beams",
    "match_lines",
    "match_scan",
    "match_scan_coarse_to_fine",
    "match_surfels",
    "read_carmen",
    "read_log",
    "read_map",
    "read_slam_map",
    "read_ticks",
    "read_tum",
    "warm_up",
    "write_map",
    "write_slam_map",
    "write_tum",
]

"""2D lidar localisation and mapping: NumPy in, NumPy out, no simulator, no ROS.

Open3D is not imported before its first use.
"""

from slam.beam_likelihood import BeamConfig, cramer_rao_bound, fisher_information, match_beams
from slam.beams import Beams
from slam.calibration import Calibration, CalibrationConfig, calibrate
from slam.icp import CoarseToFineConfig, IcpConfig, StopRule, match_scan, match_scan_coarse_to_fine
from slam.known_map import KnownMap
from slam.laser_model import LaserModel
from slam.lines import LineMap, match_lines
from slam.localization import Estimate, Localizer, LocalizerConfig
from slam.lost import Guard, GuardConfig
from slam.map_consistency import MapVerdict
from slam.map_files import read_map, write_map
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper
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
from slam.odometry import DifferentialDrive, OdometryNoise
from slam.point_map import PointMap
from slam.range_noise import RangeNoise
from slam.readers.carmen import read_carmen
from slam.readers.recognition import read_log
from slam.readers.ticks import read_ticks
from slam.relocalization import Hypothesis, Relocalizer
from slam.scan_match import MatchStatus, ScanMatch
from slam.scan_matching import SurfelMatchConfig, match_surfels
from slam.se2 import SE2
from slam.segment_map import SegmentMap
from slam.slam_map import SlamMap
from slam.slam_map_files import read_slam_map, write_slam_map
from slam.surfel_grid import SurfelGrid
from slam.trajectory import Trajectory, read_tum, write_tum
from slam.verdict import Status, Verdict
from slam.warm_up import warm_up

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
    "KnownMap",
    "LaserModel",
    "LaserScan",
    "LimitMatcher",
    "LineMap",
    "LineMatcher",
    "Localizer",
    "LocalizerConfig",
    "MapVerdict",
    "Mapper",
    "MapperConfig",
    "MatchStatus",
    "Matcher",
    "Measurement",
    "OccupancyGrid",
    "OdometryMatcher",
    "OdometryNoise",
    "Open3dMatcher",
    "PaperMatcher",
    "PointMap",
    "RangeNoise",
    "Relocalizer",
    "ScanMatch",
    "SegmentMap",
    "SlamMap",
    "Status",
    "StopRule",
    "SurfelGrid",
    "SurfelMatchConfig",
    "Trajectory",
    "Verdict",
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

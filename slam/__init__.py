"""2D lidar localisation and mapping: NumPy in, NumPy out, no simulator, no ROS.

Open3D is not imported before its first use.
"""

from slam.icp import CoarseToFineConfig, IcpConfig, StopRule, match_scan, match_scan_coarse_to_fine
from slam.lines import LineMap, match_lines
from slam.localization import (
    Estimate,
    LineMatcher,
    Localizer,
    Matcher,
    OdometryMatcher,
    Open3dMatcher,
    PaperMatcher,
)
from slam.measurements import LaserScan, Measurement
from slam.odometry import DifferentialDrive, OdometryNoise
from slam.point_map import PointMap
from slam.range_noise import RangeNoise
from slam.readers.carmen import read_carmen
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2
from slam.trajectory import Trajectory, read_tum, write_tum

__all__ = [
    "SE2",
    "CoarseToFineConfig",
    "DifferentialDrive",
    "Estimate",
    "IcpConfig",
    "LaserScan",
    "LineMap",
    "LineMatcher",
    "Localizer",
    "MatchStatus",
    "Matcher",
    "Measurement",
    "OdometryMatcher",
    "OdometryNoise",
    "Open3dMatcher",
    "PaperMatcher",
    "PointMap",
    "RangeNoise",
    "ScanMatch",
    "StopRule",
    "Trajectory",
    "match_lines",
    "match_scan",
    "match_scan_coarse_to_fine",
    "read_carmen",
    "read_tum",
    "write_tum",
]

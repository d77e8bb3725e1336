"""Self-localisation: odometry predicts, the laser corrects (Section 3.2, Fig. 2)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from slam.icp import (
    CoarseToFineConfig,
    IcpConfig,
    match_scan,
    match_scan_coarse_to_fine,
)
from slam.lines import LineConfig, LineMap, match_lines
from slam.measurements import LaserScan, Measurement
from slam.point_map import PointMap
from slam.range_noise import RangeNoise
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2


class Matcher(Protocol):
    """A method: finds the pose of a scan on a map that it knows, from a predicted pose.

    Whatever keeps this signature works in a `Localizer`; it may search the whole map.
    """

    def __call__(self, scan: LaserScan, T_base_laser: SE2, T_predicted: SE2) -> ScanMatch:
        """T_map_base of the scan, and whether to believe it."""
        ...


@dataclass(frozen=True)
class OdometryMatcher:
    """Method `odometry`: dead reckoning. The scan is not looked at, so nothing is ever matched."""

    def __call__(self, scan: LaserScan, T_base_laser: SE2, T_predicted: SE2) -> ScanMatch:
        """The prediction."""
        return ScanMatch(T_predicted, MatchStatus.NOT_ATTEMPTED)


@dataclass(frozen=True)
class LineMatcher:
    """Method `line`: the laboratory's before the paper, straight lines matched with known walls."""

    line_map: LineMap
    config: LineConfig = field(default_factory=LineConfig)

    def __call__(self, scan: LaserScan, T_base_laser: SE2, T_predicted: SE2) -> ScanMatch:
        """The pose that lays the scan's lines on the known walls."""
        return match_lines(scan, self.line_map, T_predicted, T_base_laser, self.config)


@dataclass(frozen=True)
class PaperMatcher:
    """Method `paper`: plain point-to-point ICP from the odometry pose."""

    point_map: PointMap
    config: IcpConfig = field(default_factory=IcpConfig)

    def __call__(self, scan: LaserScan, T_base_laser: SE2, T_predicted: SE2) -> ScanMatch:
        """The pose at which step 5 ended."""
        return match_scan(scan.points(T_base_laser), self.point_map, T_predicted, self.config)


@dataclass(frozen=True)
class Open3dMatcher:
    """Method `open3d`: Open3D's ICP, coarse to fine, run to convergence and judged.

    range_noise: of the laser; points of near, surer ranges then count more. None: all count alike.
    """

    point_map: PointMap
    config: CoarseToFineConfig = field(default_factory=CoarseToFineConfig)
    range_noise: RangeNoise | None = None

    def __call__(self, scan: LaserScan, T_base_laser: SE2, T_predicted: SE2) -> ScanMatch:
        """The pose at which the finest stage settled."""
        points_base = scan.points(T_base_laser)
        if self.range_noise is not None:
            repeats = self.range_noise.repeats(scan.ranges_m[scan.is_hit])
            points_base = np.repeat(points_base, repeats, axis=0)
        return match_scan_coarse_to_fine(points_base, self.point_map, T_predicted, self.config)


@dataclass(frozen=True)
class Estimate:
    """What the robot believes after one measurement.

    T_map_base: the pose matched, or the predicted one where nothing matched.
    """

    time_s: float
    T_predicted: SE2
    T_map_base: SE2
    match: ScanMatch

    @property
    def is_matched(self) -> bool:
        """False when the pose is the odometry's word alone."""
        return self.match.is_matched


class Localizer:
    """Follows a robot on a known map. `T_map_base` is its pose at the last measurement."""

    def __init__(self, matcher: Matcher, T_map_base: SE2, T_base_laser: SE2) -> None:
        self.matcher = matcher
        self.T_map_base = T_map_base
        self.T_base_laser = T_base_laser

    def update(self, measurement: Measurement) -> Estimate:
        """One pass of Fig. 2. Without a match the prediction stands."""
        T_predicted = self.T_map_base @ measurement.motion  # step 1
        match = self.matcher(measurement.scan, self.T_base_laser, T_predicted)  # steps 2 to 7
        self.T_map_base = match.T_map_base if match.is_matched else T_predicted
        return Estimate(measurement.time_s, T_predicted, self.T_map_base, match)

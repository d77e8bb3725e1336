"""The paper's mapping (Section 3.3, Fig. 3): each scan placed on the point database by plain ICP."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray
from slam.icp import IcpConfig, StopRule, match_scan
from slam.measurements import Measurement
from slam.point_map import PointMap
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2
from slam.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class IcpMap:
    """What an `IcpMapper` has made: where each scan was taken, and the points (K, 2) [m]."""

    trajectory: Trajectory
    points: FloatArray


FIG_3 = IcpConfig(stop_rule=StopRule.CONVERGED)
"""Step 8: "less than the threshold and converges"."""


class IcpMapper:
    """Self-localisation and mapping as the paper has it: no submaps, no loops, no verdict.

    spacing_m: of the points in the database. A scan that does not match leaves the robot where the
    odometry has it, and the database as it is. config None: by the odometry alone, every scan.
    """

    def __init__(
        self,
        T_base_laser: SE2,
        config: IcpConfig | None = FIG_3,
        spacing_m: float = 0.02,
    ) -> None:
        self.config = config
        self.T_map_base = SE2.identity()
        self.point_map = PointMap(np.empty((0, 2)), spacing_m)
        self._T_base_laser = T_base_laser
        self._times_s: list[float] = []
        self._poses: list[FloatArray] = []

    def update(self, measurement: Measurement) -> ScanMatch | None:
        """Places one scan; None where there is nothing to match it with."""
        T_predicted = self.T_map_base @ measurement.motion  # step 1: odometry
        points_base = measurement.scan.points(self._T_base_laser)
        match = None
        if self.config is not None and len(self.point_map):
            match = match_scan(points_base, self.point_map, T_predicted, self.config)  # 2 to 7
        is_matched = match is not None and match.status is MatchStatus.MATCHED
        self.T_map_base = match.T_map_base if match is not None and is_matched else T_predicted
        if is_matched or match is None:
            self.point_map.integrate(self.T_map_base @ points_base)  # step 8: the database
        self._times_s.append(measurement.time_s)
        self._poses.append(self.T_map_base.as_array())
        return match

    def finish(self) -> IcpMap:
        """The map as it is now."""
        poses = np.array(self._poses).reshape(-1, 3)
        return IcpMap(Trajectory(np.array(self._times_s), poses), self.point_map.points)

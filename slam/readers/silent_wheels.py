"""Odometry that says nothing: poses that never change, of a robot whose scans do."""

from __future__ import annotations

import numpy as np

from slam.arrays import FloatArray
from slam.se2 import SE2

_OTHER_M = 0.3
_MOST_OTHER = 0.5
"""Share of a scan's beams that see another range than in the first scan: so many only do where the
robot moved, whoever walks by."""
_LEAST_SCANS = 0.1
_LEAST_BEAMS = 10
"""Chosen, all of these."""


SILENT = "its poses never change, and its scans do: the scans alone tell the motion"


class SilentWheels:
    """Told of a log's poses and scans, whether its wheels were silent while the robot drove.

    Logs of scans alone often have poses all the same, where a format asks for some. A robot that
    stood has such poses as well: its scans are about the same. has_moved: two poses differ.
    """

    def __init__(self) -> None:
        self._T_first: SE2 | None = None
        self.has_moved = False
        self._first_m: FloatArray | None = None
        self._scans = self._others = 0

    def add_pose(self, T_odom_base: SE2) -> None:
        """One pose of the odometry."""
        if self._T_first is None:
            self._T_first = T_odom_base
        self.has_moved = self.has_moved or T_odom_base != self._T_first

    def add_scan(self, ranges_m: FloatArray) -> None:
        """One scan; without a return where a range is not finite."""
        if self.has_moved:
            return
        if self._first_m is None or len(self._first_m) != len(ranges_m):
            self._first_m = ranges_m
        is_seen = np.isfinite(ranges_m) & np.isfinite(self._first_m)
        seen = int(np.count_nonzero(is_seen))
        if seen < _LEAST_BEAMS:
            return
        off_m = np.abs(ranges_m[is_seen] - self._first_m[is_seen])
        self._scans += 1
        self._others += bool(np.count_nonzero(off_m > _OTHER_M) > _MOST_OTHER * seen)

    @property
    def is_silent(self) -> bool:
        """Whether the poses, if there were any, are to be taken for none."""
        return not self.has_moved and self._others > _LEAST_SCANS * self._scans

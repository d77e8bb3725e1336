"""A laser that gives old scans once more: the same noise twice is no second look."""

from __future__ import annotations

from collections import deque

from slam.kernels.beam_points import has_finite
from slam.measurements import LaserScan

_MOST = 4
"""Chosen: a driver's ring of buffers is seldom longer."""


class FrozenLaser:
    """Knows its last scans that had returns, so that one which comes again is seen for what it is.

    What comes between, scans without returns among it, makes it no other.
    """

    def __init__(self) -> None:
        self._kept: deque[LaserScan] = deque(maxlen=_MOST)

    def repeats(self, scan: LaserScan) -> bool:
        """Whether a scan is one of the last ones: see `LaserScan.repeats`. Else it is from now on."""
        for kept in self._kept:
            if scan.repeats(kept):
                return True
        if has_finite(scan.ranges_m):
            self._kept.append(scan)
        return False

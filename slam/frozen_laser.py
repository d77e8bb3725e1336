"""A laser that gives old scans once more: the same noise twice is no second look."""

from __future__ import annotations

import numpy as np

from slam.arrays import FloatArray, IntArray
from slam.kernels.beam_points import note_ranges
from slam.measurements import LaserScan

_MOST = 4
"""Chosen: a driver's ring of buffers is seldom longer."""
_SAME_BEAMS = 0.9
"""Chosen: of the beams of two scans, those with a range in both; each of these must be the same."""


class FrozenLaser:
    """Knows its last scans that had returns, so that one which comes again is seen for what it is.

    What comes between, scans without returns among it, makes it no other.
    """

    def __init__(self) -> None:
        self._noted: FloatArray = np.empty((_MOST, 0))
        self._lengths: IntArray = np.zeros(_MOST, np.int64)
        self._next = 0

    def repeats(self, scan: LaserScan) -> bool:
        """Whether a scan is one of the last ones, its ranges bit for bit, but for a few beams that came back in
        one of both alone. Else it is from now on."""
        ranges_m = scan.ranges_m
        if len(ranges_m) > self._noted.shape[1]:
            wider = np.empty((_MOST, len(ranges_m)))
            wider[:, : self._noted.shape[1]] = self._noted
            self._noted = wider
        row = note_ranges(self._noted, self._lengths, self._next, ranges_m, _SAME_BEAMS)
        if row < 0:
            return True
        self._next = row
        return False

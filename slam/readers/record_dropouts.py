"""Odometry that stands still from one record to the next, at full pace, or where scans deny it: encoders that drop
out do that."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray
from slam.measurements import LaserScan
from slam.readers.pace import UsualSpeed
from slam.readers.record_clock import RecordClock
from slam.se2 import SE2

NOTHING = 1e-6
"""[m], [rad]: records that differ by less say the same."""
_PACE = 0.5
"""Share of its usual speed at which no robot stops."""
_BRAKES_MPS2 = 0.5
"""Chosen: of 307 stands in five real logs none of a second begins so."""
_STANDS_S = 1.0, 30.0
"""Drivers tell the same several times, and ticks are few, for less; whoever stands for longer has stood."""
LIKE = 0.8
"""Share of a scan's beams that measure the same where the robot stands: cheap lasers lose some. Of
scans taken 0.3 m apart and more, in four real logs, one of a hundred is as alike. Chosen, all of them."""
_ON_RADPS = 0.3
"""That a robot turns at who denies that it stands. Chosen."""


class RecordDropouts:
    """Told of all records, how unsure their motions are where odometry stands that was driving just now."""

    def __init__(self) -> None:
        self._clock, self._usual = RecordClock(), UsualSpeed()
        self._pace_mps = self._pace_radps = 0.0
        self._untold_m2 = self._untold_rad2 = 0.0
        self._is_abrupt = self._is_denied = False
        self._still_s, self._told_s = 0.0, 0.0
        self._before: LaserScan | None = None
        self._standing: LaserScan | None = None

    def take(self, time_s: float, motion: SE2, is_denied: bool = False) -> None:
        """Notes a record, by its motion since the one before. is_denied: scans to come deny that the robot
        stands."""
        self._clock.take(time_s)
        if not self._clock.since_s > 0.0:  # the first record, and stamps that stand or go back
            return
        way_m, turn_rad = math.hypot(motion.x, motion.y), abs(motion.theta)
        if max(way_m, turn_rad) < NOTHING:
            self._still_s += self._clock.since_s
            if is_denied:
                self._deny()
            return
        if self._is_unsure:
            self._tell_stand()
            self._untold_m2 += min(way_m, self._pace_mps * self._still_s) ** 2
            self._untold_rad2 += min(turn_rad, self._pace_radps * self._still_s) ** 2
        # where a few records say the same by turns, one tells of the time since the last that did not
        elapsed_s = self._clock.elapsed_s + self._still_s
        self._pace_mps, self._pace_radps = way_m / elapsed_s, turn_rad / elapsed_s
        self._usual.take(self._pace_mps)
        self._is_abrupt, self._is_denied = self._is_full_pace(elapsed_s), False
        self._still_s = self._told_s = 0.0
        self._standing = None

    def covariance(self, scan: LaserScan) -> FloatArray | None:
        """(3, 3) to be added to that of the motion since the scan before, in the robot's frame at its end: as
        far as it would have gone on; None where odometry is believed, or a scan sees that the robot stands."""
        self._look(scan)
        if self._is_unsure:
            if self._before is not None and scan.likeness(self._before) >= LIKE:
                self._is_abrupt = self._is_denied = False
                self._untold_m2 = self._untold_rad2 = 0.0
            else:
                self._tell_stand()
        if self._is_unsure or self._still_s == 0.0:
            self._before = scan
        untold_m2, untold_rad2 = self._untold_m2, self._untold_rad2
        self._untold_m2 = self._untold_rad2 = 0.0
        is_told = untold_m2 == untold_rad2 == 0.0
        return None if is_told else np.diag([untold_m2, untold_m2, untold_rad2])

    def _look(self, scan: LaserScan) -> None:
        """Whether a scan denies that the robot stands where one before was taken that odometry tells of no way
        since."""
        if self._still_s == 0.0:
            return
        if self._standing is None:
            self._standing = scan
        elif self._still_s >= _STANDS_S[0] and scan.likeness(self._standing) < LIKE:
            self._deny()

    def _deny(self) -> None:
        self._is_denied = True
        self._pace_mps = max(self._pace_mps, self._usual.mps or 0.0)
        self._pace_radps = max(self._pace_radps, _ON_RADPS)

    def _tell_stand(self) -> None:
        """Adds how far the robot may have gone on that stands, but for what scans were told already."""
        more_s2 = self._still_s**2 - self._told_s**2
        self._untold_m2 += self._pace_mps**2 * more_s2
        self._untold_rad2 += self._pace_radps**2 * more_s2
        self._told_s = self._still_s

    @property
    def _is_unsure(self) -> bool:
        is_lost = self._is_abrupt and _STANDS_S[0] <= self._still_s <= _STANDS_S[1]
        return is_lost or self._is_denied

    def _is_full_pace(self, elapsed_s: float) -> bool:
        """Whether no robot stops from one such record to the next."""
        usual_mps = self._usual.mps
        if usual_mps is None:
            return False
        return self._pace_mps > max(_PACE * usual_mps, _BRAKES_MPS2 * elapsed_s)

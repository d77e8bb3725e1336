"""Odometry that tells between two of its records of a way that no robot goes in the time: it has jumped."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray
from slam.readers.pace import FASTEST, Pace
from slam.readers.record_clock import RecordClock
from slam.se2 import SE2

_STILL = SE2.identity()
_FAR = 0.5
"""[m], [rad] more than the record before: less is as a slip of wheels, which scans bear."""
_USUAL, _KNOWN = (2.0, 4.0), 1000
"""[m/s], [rad/s] that a robot may go though it never did, and records on its way from which that is known. What
is faster, and no more than any robot goes, may be a jump."""
_UNSURE, _SPEEDS_UP = (0.05, 0.05), (2.0, 4.0)
"""Of what it did instead of a jump: [m], [rad], and by how much it may speed up [m/s2], [rad/s2]."""
_SILENT, _SILENT_S = (0.02, 0.05), 2.0
"""[m/s], [rad/s] up to which a record tells of next to nothing; after so long a time [s] one may tell of all that
was driven meanwhile. Whoever is silent for longer has stood."""
_BRIEF, _GAP = 0.5, 5.0
"""Usual intervals: of records that come at once, and after which one may have waited."""
_AGAIN = 3
"""So many jumps in a row are how it drives now."""
_ASIDE, _DECIDED_M = 0.05, 1.0
"""Share of the squared ways up to which a robot does not drive aside; and the way after a jump that tells whether
it does since. Chosen, all of them."""


class RecordJumps:
    """Told of all records, which of the motions between two of them are none.

    Where the heading alone jumped, and the places go on as they did, a robot that never drove aside seems to
    from then on: its motions are turned back.
    """

    def __init__(self) -> None:
        self._clock = RecordClock()
        self._along, self._turning = Pace(), Pace()
        self._before, self._in_a_row, self._driven = _STILL, 0, 0
        self._late_s = self._silent_s = 0.0
        self._way_m2 = self._aside_m2 = 0.0
        self._heading = _Heading()

    def believed(self, time_s: float, motion: SE2) -> tuple[SE2, FloatArray | None]:
        """The motion since the last record, and what is to be added to its (3, 3) covariance, in the robot's
        frame at its end; None where it is believed. Else the robot went on as it did."""
        self._clock.take(time_s)
        elapsed_s, usual_s = self._clock.elapsed_s, self._clock.usual_s
        # a scan's record often says again where the odometry's own was
        says_again = self._clock.since_s < _BRIEF * usual_s and motion.is_near(_STILL, 1e-6, 1e-6)
        if not elapsed_s > 0.0 or says_again:
            return motion, None
        late_s = self._late_s + (self._silent_s if self._silent_s <= _SILENT_S else 0.0)
        self._late_s = elapsed_s if elapsed_s > _GAP * usual_s else 0.0
        motion = self._heading.turned_back(motion)
        way_m, turn_rad = _way(motion)
        is_far = max(way_m, turn_rad) > _FAR
        if is_far and self._is_faster(motion, late_s, FASTEST):
            self._in_a_row += 1
            if self._aside_m2 <= _ASIDE * self._way_m2:
                self._heading.jumped((self._before.inverse() @ motion).theta)
            return self._before, self._unsure(elapsed_s, SE2.identity())
        is_doubted = (
            is_far
            and self._driven >= _KNOWN
            and self._silent_s == 0.0  # else it is rather told late
            and self._is_faster(motion, late_s, _USUAL)
        )
        self._along.take(way_m / (elapsed_s + late_s))
        self._turning.take(turn_rad / (elapsed_s + late_s))
        if is_doubted:
            self._in_a_row += 1
            return self._before, self._unsure(elapsed_s, self._before.inverse() @ motion)
        self._in_a_row, self._before = 0, motion
        self._way_m2 += way_m**2
        self._aside_m2 += motion.y**2
        is_silent = way_m <= _SILENT[0] * elapsed_s and turn_rad <= _SILENT[1] * elapsed_s
        self._silent_s = self._silent_s + elapsed_s if is_silent else 0.0
        self._driven += not is_silent
        return motion, None

    def _is_faster(self, motion: SE2, late_s: float, floors: tuple[float, float]) -> bool:
        """Whether a robot that may always go as fast as the floors does not go so in a record, and for a time
        of which odometry told nothing before, be it that it stood or that it went on."""
        if not self._clock.is_known or self._in_a_row == _AGAIN:
            return False
        # who brakes goes other than before as well
        ways = _way(motion), _way(self._before.inverse() @ motion)
        mores = (min(more) for more in zip(*ways, strict=True))
        elapsed_s, paces = self._clock.elapsed_s, (self._along, self._turning)
        return any(
            more > max(_FAR, pace.most_in(elapsed_s, late_s, floor))
            for more, pace, floor in zip(mores, paces, floors, strict=True)
        )

    @staticmethod
    def _unsure(elapsed_s: float, more: SE2) -> FloatArray:
        """(3, 3) of going on as before for so long, or by so much more."""
        sigma_m, sigma_rad = (
            max(least, most * elapsed_s**2, way)
            for least, most, way in zip(_UNSURE, _SPEEDS_UP, _way(more), strict=True)
        )
        return np.diag(np.square([sigma_m, sigma_m, sigma_rad]))


def _way(motion: SE2) -> tuple[float, float]:
    """How far [m] and by how much [rad] a robot went and turned."""
    return math.hypot(motion.x, motion.y), abs(motion.theta)


class _Heading:
    """By how much a heading jumped, if it did alone: then the motions lead less aside turned back by it."""

    def __init__(self) -> None:
        self._jump_rad = self._way_m = self._aside_m2 = self._turned_aside_m2 = 0.0

    def jumped(self, angle_rad: float) -> None:
        """It did, once more."""
        self._jump_rad = angle_rad + (self._jump_rad if self._is_alone else 0.0)
        self._way_m = self._aside_m2 = self._turned_aside_m2 = 0.0

    @property
    def _is_alone(self) -> bool:
        return self._turned_aside_m2 < self._aside_m2

    def turned_back(self, motion: SE2) -> SE2:
        """A motion as it is told, or as it would be had the heading not jumped."""
        way_m = math.hypot(motion.x, motion.y)
        if self._jump_rad == 0.0 or way_m == 0.0:
            return motion
        c, s = math.cos(self._jump_rad), math.sin(self._jump_rad)
        turned = SE2(c * motion.x - s * motion.y, s * motion.x + c * motion.y, motion.theta)
        if self._way_m < _DECIDED_M:
            self._way_m += way_m
            self._aside_m2 += motion.y**2
            self._turned_aside_m2 += turned.y**2
        return turned if self._is_alone else motion

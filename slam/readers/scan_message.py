"""One `sensor_msgs/LaserScan` as `slam` wants it: increasing angles, REP-117, a time for each beam."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from slam.arrays import FloatArray
from slam.measurements import LaserScan, check_stamped
from slam.se2 import SE2

_MOST_BEAMS = 100_000
"""Chosen: the finest lasers have some ten thousand."""
_MOST_TURN = 1.01
"""Chosen: of lasers that see all around, some count the first beam twice."""
_LONGEST_SWEEP_S = 10.0
"""Chosen, as in `LaserScan`: what takes longer has a wrong time_increment, and no time is known."""


@dataclass(frozen=True, eq=False)
class ScanMessage:
    """A sweep as its message tells it: beam after beam, in the order in which they were fired.

    start_s: when the first beam was fired; interval_s: from one to the next, 0 where not known.
    first_rad, step_rad: where they point; the step is negative of a laser that turns clockwise.
    """

    start_s: float
    interval_s: float
    first_rad: float
    step_rad: float
    range_min_m: float
    range_max_m: float
    ranges: np.ndarray
    place: str

    @staticmethod
    def of(content: Any, stamp_s: float, place: str) -> ScanMessage:
        """The sweep of a message. Raises ValueError, that starts with the place, if it is none."""
        ranges = content.ranges
        if len(ranges) > _MOST_BEAMS:
            raise ValueError(f"{place}: {len(ranges)} beams; expected {_MOST_BEAMS} at most")
        first_rad, step_rad = float(content.angle_min), float(content.angle_increment)
        turn = abs(step_rad) * (len(ranges) - 1) / math.tau
        if not (math.isfinite(first_rad) and math.isfinite(step_rad) and turn <= _MOST_TURN):
            raise ValueError(
                f"{place}: {len(ranges)} beams from angle_min {first_rad:g} by angle_increment"
                f" {step_rad:g}; expected angles in radians, no more than a turn"
            )
        if step_rad == 0.0 and len(ranges) > 1:
            raise ValueError(f"{place}: angle_increment is 0, so all beams point the same way")
        least_m, most_m = float(content.range_min), float(content.range_max)
        if not (most_m > 0.0 and most_m > least_m):
            raise ValueError(
                f"{place}: range_min {least_m:g} and range_max {most_m:g}; expected metres, between"
                " which the laser measures"
            )
        try:
            check_stamped("stamp", stamp_s, SE2.identity())
        except ValueError as error:
            raise ValueError(f"{place}: {error}") from error
        interval_s = float(content.time_increment)
        is_told = 0.0 < interval_s * max(len(ranges) - 1, 1) <= _LONGEST_SWEEP_S
        return ScanMessage(
            stamp_s, interval_s if is_told else 0.0, first_rad, step_rad, least_m, most_m, ranges,
            place,
        )  # fmt: skip

    @property
    def end_s(self) -> float:
        """When the last beam was fired; the stamp where the beams have no times."""
        return self.start_s + self.interval_s * max(len(self.ranges) - 1, 0)

    def scan(self, is_flipped: bool, no_return_m: float) -> LaserScan:
        """The sweep as a scan, stamped by its last beam.

        is_flipped: the laser hangs upside down; its angles are then those seen from above. What is not
        below no_return_m [m] is no return, as is what is not below range_max; 0 and negative is
        invalid, as no laser measures it; what else is below range_min is too close.
        """
        beams = np.arange(len(self.ranges))
        angles_rad = self.first_rad + self.step_rad * beams
        if is_flipped:
            angles_rad = -angles_rad
        # around 0, whichever turn the driver counts in
        middle_rad = (angles_rad[0] + angles_rad[-1]) / 2.0
        angles_rad = angles_rad - math.tau * round(middle_rad / math.tau)
        ranges_m = self._marked(no_return_m)
        times_s = None
        if self.interval_s > 0.0:
            times_s = np.asarray(self.start_s + self.interval_s * beams, dtype=np.float64)
        if len(beams) > 1 and angles_rad[1] < angles_rad[0]:
            angles_rad, ranges_m = angles_rad[::-1], ranges_m[::-1]
            times_s = None if times_s is None else times_s[::-1]
        try:
            return LaserScan(self.end_s, angles_rad, ranges_m, times_s)
        except ValueError as error:
            raise ValueError(f"{self.place}: {error}") from error

    def _marked(self, no_return_m: float) -> FloatArray:
        """(N,) ranges [m] as `LaserScan` wants them."""
        with np.errstate(invalid="ignore"):  # a nan that signals is a nan
            ranges_m = self.ranges.astype(np.float64)
        is_invalid = np.isnan(ranges_m) | (np.isfinite(ranges_m) & (ranges_m <= 0.0))
        # the message has its limits in single precision, as the ranges
        is_near = ranges_m < self.range_min_m
        ranges_m[ranges_m >= min(self.range_max_m, no_return_m)] = np.inf
        ranges_m[is_near] = -np.inf
        ranges_m[is_invalid] = np.nan
        return ranges_m

"""A scan to be judged, and what is known of the pose before it is looked at."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slam.arrays import BoolArray, FloatArray
from slam.beams import Beams
from slam.evidence import Evidence
from slam.scan_match import ScanMatch
from slam.se2 import SE2


@dataclass(frozen=True, eq=False)
class Look:
    """A scan to be judged: its stamp, its beams, and how they are matched from a pose on."""

    time_s: float
    beams: Beams
    matcher: Callable[[Beams, SE2], ScanMatch]

    def matched(self, T_start: SE2) -> ScanMatch:
        """The scan matched."""
        return self.matcher(self.beams, T_start)

    def matched_without(self, is_left_out: BoolArray, T_start: SE2) -> ScanMatch:
        """The scan matched, but for some of its beams, (N,)."""
        beams = self.beams
        ranges_m = np.where(is_left_out, np.nan, beams.ranges_m)
        return self.matcher(beams.with_ranges(ranges_m), T_start)


@dataclass(frozen=True, eq=False)
class Step:
    """What is known of the pose before a scan is looked at.

    T_last: at the last one. told: the motion since, by the wheels; noise: (3, 3) of its tangent.
    T_predicted: where that leads; covariance: (3, 3) of its tangent.
    """

    T_last: SE2
    T_predicted: SE2
    covariance: FloatArray
    noise: FloatArray

    @property
    def told(self) -> SE2:
        """The motion since the last scan, by the wheels."""
        return self.T_last.inverse() @ self.T_predicted

    def jump(self, match: ScanMatch, sigmas: tuple[float, float], most: float) -> str | None:
        """That a match is farther from the prediction than wheels and laser explain, in words.

        sigmas: [m] and [rad] of a match beside what it claims. most: innovation squared, in
        variances, that may be chance.
        """
        innovation = (self.T_predicted.inverse() @ match.T_map_base).log()
        bound = self.covariance + np.diag(np.square([sigmas[0], sigmas[0], sigmas[1]]))
        known = match.information
        if known is None:
            squared = float(innovation @ np.linalg.solve(bound, innovation))
        else:  # (bound + known^-1)^-1, which needs no inverse where a direction is open
            told = np.linalg.solve(np.eye(3) + known @ bound, known @ innovation)
            squared = float(innovation @ told)
        if not squared > most:
            return None
        off_m = math.hypot(innovation[0], innovation[1])
        return (
            f"carried away: the scan is {off_m:.2f} m and {math.degrees(abs(innovation[2])):.0f}"
            " degrees from where the wheels say"
        )


@dataclass(frozen=True, eq=False)
class Fit:
    """How a scan fits where it was matched, and what is not as usual about it, in words."""

    match: ScanMatch
    T_map_base: SE2
    evidence: Evidence
    misfits: tuple[str, ...]
    jump: str | None

"""The record of matching one scan with the map, whatever the method."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from slam.arrays import FloatArray
from slam.range_noise import RangeNoise
from slam.se2 import SE2

_WIDE = 2.0
"""Chosen: three pairs of legs in view leave it below 1.3."""


class MatchStatus(enum.Enum):
    """How a match ended."""

    MATCHED = "matched"
    LOST = "lost"  # no pairs, or the best fit found is a poor one: the pose is not to be used
    NOT_CONVERGED = "not converged"  # the iterations ran out first: not to be used either
    DEGENERATE = "degenerate"  # the scan leaves a direction open: the pose along it is a guess
    NOT_ATTEMPTED = "not attempted"  # dead reckoning: the scan was not looked at


@dataclass(frozen=True)
class IcpStep:
    """One pass of the loop: the pose judged, expression (1) there [m2], and how many pairs it had.

    Without pairs the error is inf: a mean over nothing is not a perfect fit.
    """

    T_map_base: SE2
    error_m2: float
    pair_count: int


@dataclass(frozen=True)
class RangeFit:
    """How the ranges of a scan fit the map and the laser's model at the pose found.

    inlier_ratio: share of the beams within four sigmas. scale: scatter of the residuals in units of
    the noise assumed. offset_m, offset_sigma_m: range offset common to all beams. missing_ratio:
    share of the beams that went through walls of an exact map. noise: that which was assumed, None
    where it is not told.
    """

    inlier_ratio: float
    scale: float
    offset_m: float
    offset_sigma_m: float
    missing_ratio: float = 0.0
    noise: RangeNoise | None = None


@dataclass(frozen=True, eq=False)
class PoseInformation:
    """A pose and the (3, 3) inverse covariance of its tangent, as in `ScanMatch`."""

    T_map_base: SE2
    information: FloatArray


@dataclass(frozen=True)
class ScanMatch:
    """The pose found for one scan, and whether it is to be believed.

    error_m2 and pair_count belong to T_map_base; history has one step per pass of the loop.
    information: (3, 3) inverse covariance of the tangent (x, y, theta) in the base frame, true pose
    = T_map_base @ SE2.exp(noise), zero along what the scan leaves open; None: nothing is claimed.
    log_likelihood: of the scan there, but for a constant, or None: to compare poses of one scan.
    repeated: share of the covariance whose error is the same in all scans from one pose.
    smooth: the same without the edges, whose errors are the same in every scan from one pose; None
    where they are not told apart.
    """

    T_map_base: SE2
    status: MatchStatus
    error_m2: float = math.inf
    pair_count: int = 0
    history: tuple[IcpStep, ...] = ()
    information: FloatArray | None = field(default=None, compare=False)
    fit: RangeFit | None = None
    log_likelihood: float | None = None
    repeated: float = 0.0
    smooth: PoseInformation | None = field(default=None, compare=False)

    @property
    def is_matched(self) -> bool:
        """True when the pose is to be believed."""
        return self.status is MatchStatus.MATCHED

    @property
    def said(self) -> str:
        """How it ended, in words; of one not to be used also what its ranges say of the noise."""
        words = f"scan match: {self.status.value}"
        if self.fit is not None and self.fit.scale > _WIDE:
            words += (
                f"; about the best pose near by ranges scatter {self.fit.scale:.1f} times as wide as"
                " the laser's noise: another place, or a noise assumed too small"
            )
        return words

    @staticmethod
    def from_history(history: Sequence[IcpStep], status: MatchStatus) -> ScanMatch:
        """The match that ended with the last step of its history."""
        last = history[-1]
        return ScanMatch(last.T_map_base, status, last.error_m2, last.pair_count, tuple(history))

    @staticmethod
    def lost(history: Sequence[IcpStep]) -> ScanMatch:
        """The match that was given up at the last step of its history."""
        return ScanMatch.from_history(history, MatchStatus.LOST)

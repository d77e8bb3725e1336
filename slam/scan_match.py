"""The record of matching one scan with the map, whatever the method."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

from slam.se2 import SE2


class MatchStatus(enum.Enum):
    """How a match ended."""

    MATCHED = "matched"
    LOST = "lost"  # no pairs, or the best fit found is a poor one: the pose is not to be used
    NOT_CONVERGED = "not converged"  # the iterations ran out first: not to be used either
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
class ScanMatch:
    """The pose found for one scan, and whether it is to be believed.

    error_m2 and pair_count belong to T_map_base; history has one step per pass of the loop.
    """

    T_map_base: SE2
    status: MatchStatus
    error_m2: float = math.inf
    pair_count: int = 0
    history: tuple[IcpStep, ...] = ()

    @property
    def is_matched(self) -> bool:
        """True when the pose is to be believed."""
        return self.status is MatchStatus.MATCHED

    @staticmethod
    def from_history(history: Sequence[IcpStep], status: MatchStatus) -> ScanMatch:
        """The match that ended with the last step of its history."""
        last = history[-1]
        return ScanMatch(last.T_map_base, status, last.error_m2, last.pair_count, tuple(history))

    @staticmethod
    def lost(history: Sequence[IcpStep]) -> ScanMatch:
        """The match that was given up at the last step of its history."""
        return ScanMatch.from_history(history, MatchStatus.LOST)

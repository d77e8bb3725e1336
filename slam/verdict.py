"""What a robot says of its pose, and what of a scan match it is to be corrected by."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from slam.relocalization import Hypothesis
from slam.scan_match import MatchStatus, ScanMatch


class Status(enum.Enum):
    """What a robot can say of its pose."""

    TRACKING = "tracking"  # the pose is believed
    UNSURE = "unsure"  # a best guess: the scan says too little, or too much for one place
    LOST = "lost"  # the pose believed before is wrong, or nothing on the map explains the scans


@dataclass(frozen=True)
class Verdict:
    """What the robot says of its pose, and why.

    reasons: in words, empty where all is as usual. hypotheses: places it may be at, most likely
    first, at each scan for which the map was searched, that with which it tracks again among them.
    recovery_s: at that scan, the time since it was lost, or since the first scan of one that had
    no idea.
    """

    status: Status
    reasons: tuple[str, ...] = ()
    hypotheses: tuple[Hypothesis, ...] = ()
    recovery_s: float | None = None


@dataclass(frozen=True)
class Judgement:
    """A verdict, with the match that the pose is to be corrected by; None: by none.

    is_restart: the match replaces the prediction instead of being joined with it.
    """

    verdict: Verdict
    match: ScanMatch | None
    is_restart: bool = False


_STATUS_OF_MATCH = {
    MatchStatus.MATCHED: Status.TRACKING,
    MatchStatus.DEGENERATE: Status.UNSURE,
    MatchStatus.NOT_ATTEMPTED: Status.UNSURE,
    MatchStatus.LOST: Status.LOST,
    MatchStatus.NOT_CONVERGED: Status.LOST,
}


def verdict_of(match: ScanMatch) -> Verdict:
    """The verdict where a method stands alone, with no search of the map to ask."""
    status = _STATUS_OF_MATCH[match.status]
    reasons = () if status is Status.TRACKING else (match.said,)
    return Verdict(status, reasons)

"""Matches that now and then err more than they say, wheels that may slip: which is it this time?

A Kalman filter squares what surprises it. Here each of several explanations of an innovation makes a
correction of its own, and they are joined by how likely each is: a Gaussian sum with one Gaussian
left of it (Sorenson and Alspach, 1971; Bar-Shalom, Li and Kirubarajan, 2001, Section 1.4.16).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray
from slam.kernels.gaussian_sum import gaussian_sum

_NONE = np.array([100.0, 100.0, 2.0 * np.pi]) ** -2.0
"""Information of a match that tells nothing: to a filter of first order wider means no more."""
_TRACK_M = 0.3
"""Chosen: a wheel that slips by a length turns the robot by so much of it."""


@dataclass(frozen=True)
class Tails:
    """How often a match's covariance is what times the one it tells.

    factors: of its covariance; odds: how often, one in all. On average about what it tells.
    """

    factors: tuple[float, ...]
    odds: tuple[float, ...]


SMOOTH = Tails((0.85, 2.5, 15.0), (0.965, 0.033, 0.002))
EDGES = Tails((0.75, 4.0, 20.0), (0.92, 0.075, 0.005))
WHOLE = Tails((0.8, 4.0, 20.0), (0.94, 0.055, 0.005))
"""As fitted to the matches of `limit` in 200 drives (room_fig4, URG-04LX), what beams tell that pass
no edge, what those tell that do, and both together; the largest is rounded up."""

SLIPS_M = np.array([0.002, 0.01, 0.05])
"""Chosen: so far wheels may have slipped, as standard deviations; farther is a case for a guard."""
_SLIP_ODDS = 3e-5
"""Chosen: of each scan anew, all lengths together; once in some hundred metres."""
_MOST_ODDS = 0.5


def slip_covariance(slip_m: float) -> FloatArray:
    """(3, 3) of a pose, where wheels may have slipped by so much."""
    return np.diag(np.square([slip_m, slip_m, slip_m / _TRACK_M]))


_NO_SLIP, _SURE = np.zeros((1, 3, 3)), np.ones(1)
_SLIPS = np.array([np.zeros((3, 3)), *(slip_covariance(slip_m) for slip_m in SLIPS_M)])


class SlipOdds:
    """How likely wheels have slipped: seldom, but likelier where the last scan had it so."""

    def __init__(self) -> None:
        self._seen: FloatArray = np.zeros(len(SLIPS_M))

    @property
    def odds(self) -> FloatArray:
        """Of each of `SLIPS_M` now."""
        odds = _SLIP_ODDS / len(SLIPS_M) + self._seen
        return np.asarray(odds * min(1.0, _MOST_ODDS / float(odds.sum())))

    def take(self, seen: FloatArray) -> None:
        """Notes what a scan made of them."""
        self._seen = seen

    def clear(self) -> None:
        """Forgets what was seen: the pose is another."""
        self._seen = np.zeros(len(SLIPS_M))


def corrected(
    P: FloatArray,
    pull: FloatArray,
    information: FloatArray,
    tails: Tails,
    slip_odds: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean (N,) and covariance (N, N) of an error of covariance P, corrected by a match of its first
    three; and how likely each slip was.

    pull: (3,) information times innovation, information (3, 3): of the match. slip_odds: of each
    of `SLIPS_M`; None: none can have been.
    """
    sigmas, odds = _NO_SLIP, _SURE
    if slip_odds is not None:
        sigmas, odds = _SLIPS, np.append(1.0 - slip_odds.sum(), slip_odds)
    mean, covariance, of_slips = np.empty(len(P)), np.empty(P.shape), np.empty(len(odds))
    gaussian_sum(
        P, pull, information, _NONE, sigmas, odds, np.array(tails.factors), np.array(tails.odds), mean,
        covariance, of_slips,
    )  # fmt: skip
    return mean, covariance, of_slips[1:]

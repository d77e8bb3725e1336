"""Matches that now and then err more than they say, wheels that may slip: which is it this time?

A Kalman filter squares what surprises it. Here each of several explanations of an innovation makes a
correction of its own, and they are joined by how likely each is: a Gaussian sum with one Gaussian
left of it (Sorenson and Alspach, 1971; Bar-Shalom, Li and Kirubarajan, 2001, Section 1.4.16).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray

_NEARLY_NOTHING = 1e-18
"""Square metres, or radians: keeps a variance of nothing above it."""
_LEAST = 1e-300
"""Of odds, and of information, so that it has a logarithm."""
WIDEST = np.array([100.0, 100.0, 2.0 * np.pi])
"""Chosen: standard deviations [m], [m], [rad] beyond which a pose is not known at all; to a filter
of first order wider ones mean nothing, and 1e5 m beside a millimetre is lost in rounding."""
_NONE = WIDEST**-2.0
"""Information of a match that tells nothing."""
_TRACK_M = 0.3
"""Chosen: a wheel that slips by a length turns the robot by so much of it."""


@dataclass(frozen=True)
class Tails:
    """How often a match's covariance is what times the one it tells.

    factors: of its covariance; odds: how often, one in all. On average about what it tells.
    """

    factors: tuple[float, ...]
    odds: tuple[float, ...]


SMOOTH = Tails((0.99, 2.5, 15.0), (0.994, 0.005, 0.001))
EDGES = Tails((0.78, 4.5, 25.0), (0.945, 0.05, 0.005))
WHOLE = Tails((0.83, 3.5, 20.0), (0.95, 0.045, 0.005))
"""As fitted to 25 000 matches of `limit`, of drives in four places with two lasers, some among people:
what beams tell that pass no edge, what those tell that do, and both together. What beams without an
edge tell was as sure as it says, in all of them; that it now and then is not is a precaution."""

SLIPS_M = np.array([0.002, 0.01, 0.05])
"""Chosen: so far wheels may have slipped, as standard deviations; farther is a case for a guard."""
_SCAN_M = 0.003
"""Chosen: a scan is as likely to follow a slip as so long a way, even where the robot stands."""
_MOST_ODDS = 0.5


def slip_covariance(slip_m: float) -> FloatArray:
    """(3, 3) of a pose, where wheels may have slipped by so much."""
    return np.diag(np.square([slip_m, slip_m, slip_m / _TRACK_M]))


_NO_SLIP, _SURE = np.zeros((1, 3, 3)), np.ones(1)
_SLIPS = np.array([np.zeros((3, 3)), *(slip_covariance(slip_m) for slip_m in SLIPS_M)])


class SlipOdds:
    """How likely wheels have slipped: seldom, but likelier where the last scan had it so."""

    def __init__(self, slips_per_m: float) -> None:
        """slips_per_m: how often, all lengths together."""
        self._per_m = slips_per_m
        self.clear()

    @property
    def odds(self) -> FloatArray:
        """Of each of `SLIPS_M` now."""
        odds = self._per_m * (_SCAN_M + self._way_m) / len(SLIPS_M) + self._seen
        return np.asarray(odds * min(1.0, _MOST_ODDS / max(float(odds.sum()), _LEAST)))

    def move(self, twist: FloatArray) -> None:
        """Notes a way of the wheels (x, y, theta)."""
        self._way_m += float(np.hypot(twist[0], twist[1])) + _TRACK_M * abs(float(twist[2]))

    def take(self, seen: FloatArray) -> None:
        """Notes what a scan made of them."""
        self._seen, self._way_m = seen, 0.0

    def clear(self) -> None:
        """Forgets what was seen: the pose is another."""
        self.take(np.zeros(len(SLIPS_M)))


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
    mean, covariance, of_widths = _gaussian_sum(P, pull, information, (sigmas, odds), tails)
    return mean, covariance, of_widths[1:]


def _gaussian_sum(
    P: FloatArray,
    pull: FloatArray,
    information: FloatArray,
    widenings: tuple[FloatArray, FloatArray],
    tails: Tails,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """As `corrected`; widenings: (W, 3, 3) that may have been added to P, and the odds of each; they
    come back as (W,), given the match."""
    wide = P[:3, :3] + widenings[0]
    # where prediction and match are both diagonal, (W, 3), the prediction's variance is one
    root = np.linalg.cholesky(wide + _NEARLY_NOTHING * np.eye(3))
    told, axes = np.linalg.eigh(root.mT @ (information + np.diag(_NONE)) @ root)
    none = np.einsum("k,wkj->wj", _NONE, (root @ axes) ** 2)
    drawn = np.einsum("wkj,k->wj", root @ axes, pull)
    beside = np.repeat(P[np.newaxis, :, :3], len(wide), axis=0)
    beside[:, :3] = wide
    levers = beside @ np.linalg.solve(root.mT, axes)
    is_told = told > 2.0 * none
    off = np.where(is_told, drawn / np.where(is_told, told, 1.0), 0.0)
    factors = np.array(tails.factors)[:, np.newaxis]
    # (W, F, 3); how wide a match is along what it does not tell says nothing
    told, off, is_told = (array[:, np.newaxis] for array in (told, off, is_told))
    shares = np.where(is_told, told / (told + factors), 0.0)
    positive = np.maximum(told, _LEAST)
    spread = np.log1p(np.where(is_told, factors, 1.0) / positive)
    likely = -0.5 * np.sum(np.where(told > 0.0, spread + off**2 * shares, 0.0), axis=2)
    likely -= np.log(np.einsum("wkk->wk", root)).sum(axis=1)[:, np.newaxis]
    likely += np.log(np.maximum(np.outer(widenings[1], tails.odds), _LEAST))
    weights = np.exp(likely - likely.max())
    weights /= weights.sum()
    means = np.einsum("wnk,wfk->wfn", levers, shares * off)
    mean = np.einsum("wf,wfn->n", weights, means)
    astray = means - mean
    covariance = P + np.einsum("wf,wfn,wfm->nm", weights, astray, astray)
    of_widths = weights.sum(axis=1)
    covariance[:3, :3] += np.einsum("w,wnm->nm", of_widths, widenings[0])
    known = np.einsum("wf,wfk->wk", weights, shares)
    covariance -= np.einsum("wnk,wk,wmk->nm", levers, known, levers)
    return mean, covariance, of_widths

"""Whether one sample of trials is worse than another in any of many quantities, at one error rate.

Permutation tests: if nothing changed, which of two runs a trial is of tells nothing. Where runs share
their seeds, trials are compared one with one, and the labels of each pair may be swapped (of an event
that is McNemar's exact test, of ranks Wilcoxon's); else all labels may be shuffled (Fisher's exact
test; Mann and Whitney's). All quantities of a trial are swapped together, so that the correction for
asking of many is that of Westfall and Young (Resampling-Based Multiple Testing, 1993, algorithm 2.8):
Holm's steps, with the joint distribution in the place of Bonferroni's bound.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

from slam.arrays import FloatArray

DRAWS = 2**14
"""Chosen: a p of 0.01 comes out with a standard error of 0.0008; of up to 14 pairs each way to swap
them is asked equally often, so that each p is exact."""
_AT_ONCE = 500


@dataclass(frozen=True, eq=False)
class Scores:
    """Of one experiment: a score (T, K) for each trial and question, 0 where it says nothing.

    new_count: None: rows are pairs, the score is that of new against old, and changes its sign if they
    are swapped. Else the last new_count rows are of the new run, the others of the old one.
    """

    scores: FloatArray
    new_count: int | None

    @property
    def least_p(self) -> float:
        """What p is where every trial speaks for the same: no test finds less."""
        rows = len(self.scores)
        if self.new_count is None:
            return 0.5**rows
        old, new = rows - self.new_count, self.new_count
        return math.exp(math.lgamma(old + 1) + math.lgamma(new + 1) - math.lgamma(rows + 1))

    def drawn(self, draws: int, rng: np.random.Generator) -> FloatArray:
        """(draws, K) statistics, the first one as seen, the others with labels drawn."""
        sums = np.empty((draws, self.scores.shape[1]))
        for first in range(0, draws, _AT_ONCE):
            at = np.arange(first, min(first + _AT_ONCE, draws))
            sums[at] = self._drawn_labels(at, rng) @ self.scores
        rng.shuffle(sums)
        sums[0] = self._as_seen @ self.scores
        return sums

    @property
    def _as_seen(self) -> FloatArray:
        """(T,) what the scores are multiplied by: of pairs 1, else 1 where it is of the new run."""
        rows = len(self.scores)
        if self.new_count is None:
            return np.ones(rows)
        return (np.arange(rows) >= rows - self.new_count).astype(np.float64)

    def _drawn_labels(self, numbers: np.ndarray, rng: np.random.Generator) -> FloatArray:
        """(N, T) the same for draws of these numbers; of few pairs, each way in its turn."""
        rows = len(self.scores)
        if self.new_count is not None:
            return rng.permuted(np.tile(self._as_seen, (len(numbers), 1)), axis=1)
        if 2**rows <= DRAWS:
            is_swapped = numbers[:, None] >> np.arange(rows) & 1
        else:
            is_swapped = rng.integers(2, size=(len(numbers), rows), dtype=np.uint8)
        return np.where(is_swapped, -1.0, 1.0)


def adjusted_p(groups: list[Scores], draws: int = DRAWS) -> tuple[FloatArray, FloatArray]:
    """p of each question, alone and corrected for all that were asked, (K,) each, groups in a row.

    One-sided: of scores as large as seen or larger. The same each time.
    """
    if not groups:
        return np.zeros(0), np.zeros(0)
    rng = np.random.default_rng(0)
    sums = np.concatenate([group.drawn(draws, rng) for group in groups], axis=1)
    # sums of the same numbers in another order are equal
    size = np.abs(sums).max(axis=0, initial=0.0)
    sums = np.round(sums / np.where(size > 0.0, size, 1.0), 9)
    p = np.stack([_shares_as_large(column) for column in sums.T], axis=1)
    seen = p[0]
    adjusted = np.empty_like(seen)
    least, above = np.ones(draws), 0.0
    order = np.argsort(seen)
    stepped = np.empty((draws, len(order)))
    for at in range(len(order) - 1, -1, -1):  # from the largest on: the least of those not smaller
        least = np.minimum(least, p[:, order[at]])
        stepped[:, at] = least
    for at, column in enumerate(order):
        above = max(above, float(np.mean(stepped[:, at] <= seen[column])))
        adjusted[column] = above
    return seen, adjusted


def _shares_as_large(sums: FloatArray) -> FloatArray:
    """(N,) of each of N numbers the share of those that are not smaller."""
    return 1.0 - np.searchsorted(np.sort(sums), sums, side="left") / len(sums)


def paired_rank_scores(differences: FloatArray) -> FloatArray:
    """Wilcoxon's signed ranks of differences (T,), nan: none; ties share their rank."""
    scores = np.zeros(len(differences))
    told = np.isfinite(differences)
    if told.any():
        some = differences[told]
        scores[told] = np.sign(some) * rankdata(np.abs(some))
    return scores


def rank_scores(values: FloatArray) -> FloatArray:
    """Ranks of values (T,) of both runs together, about their mean; nan: none."""
    scores = np.zeros(len(values))
    told = np.isfinite(values)
    if told.any():
        ranks = np.asarray(rankdata(values[told]))
        scores[told] = ranks - ranks.mean()
    return scores


def centred(values: FloatArray) -> FloatArray:
    """Values (T,) about their mean; 0 where there is none (nan)."""
    told = np.isfinite(values)
    middle = values[told].mean() if told.any() else 0.0
    return np.where(told, values - middle, 0.0)

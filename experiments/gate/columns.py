"""Two runs compared in one quantity of one method: the questions asked, as scores of the trials."""

from dataclasses import dataclass, replace

import numpy as np

from experiments.gate.baseline import RunValues
from experiments.gate.permutation import centred, paired_rank_scores, rank_scores
from experiments.gate.quantities import HONEST_NEES, QUANTITIES, Quantity
from slam.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Columns:
    """Of one quantity of one method, in both runs: what is asked, as scores of the trials (T, K),
    of being worse, and of being better."""

    method: str
    quantity: Quantity
    old: FloatArray
    new: FloatArray
    worse: FloatArray
    better: FloatArray


def usual(one: Columns) -> Columns:
    """Without what is asked of means."""
    return replace(one, worse=one.worse[:, :1], better=one.better[:, :1])


def compared_columns(
    old: RunValues, new: RunValues, method: str, name: str, margin: float, paired: int | None
) -> Columns:
    """Of the first trials, so many as there are pairs; None: of no pairs, all trials of both."""
    quantity = QUANTITIES[name]
    before, now = _array(old, method, name), _array(new, method, name)
    if paired is not None:
        before, now = before[:paired], now[:paired]
    scores = _event_scores if quantity.is_event else _size_scores
    worse, better = scores(quantity, before, now, margin, paired is not None)
    return Columns(method, quantity, before, now, worse, better)


def _array(run: RunValues, method: str, name: str) -> FloatArray:
    told = run.values[method].get(name)
    if told is None:
        return np.full(run.trials, np.nan)
    return np.array([np.nan if one is None else one for one in told])


def _event_scores(
    quantity: Quantity, old: FloatArray, new: FloatArray, margin: float, is_paired: bool
) -> tuple[FloatArray, FloatArray]:
    """One question: does it happen more often? margin: none, of what may not happen."""
    scores = _averaged(old, new, is_paired)[:, None]
    return scores, -scores


def _size_scores(
    quantity: Quantity, old: FloatArray, new: FloatArray, margin: float, is_paired: bool
) -> tuple[FloatArray, FloatArray]:
    """Is it usually larger by more than the margin? And, of errors, is it so on average, which a few
    large ones make? Of a NEES: is it above what it was and what it should be, or below both?

    Measured on planted regressions, 50 pairs each, at p = 0.001: the mean finds a fifth more noise
    in 3 of 4 and ICP that stops early in 4 of 4, ranks 2 and 0, t tests no more than either; not
    paired, means, ranks and Welch's test all find the latter in 3 of 4, and none the former.
    """
    old, new = np.maximum(old, quantity.floor), np.maximum(new, quantity.floor)
    within = np.log1p(margin)
    if quantity.worse == "away":
        return _honesty_scores(np.log(old), np.log(new), 2.0 * within, is_paired)
    sign = -1.0 if quantity.worse == "less" else 1.0
    worse = [_ranked(sign * np.log(old) + within, sign * np.log(new), is_paired)]
    better = [_ranked(within - sign * np.log(old), -sign * np.log(new), is_paired)]
    if quantity.worse == "more":
        old, new = np.minimum(old, quantity.cap), np.minimum(new, quantity.cap)
        worse.append(_averaged((1.0 + margin) * old, new, is_paired))
        better.append(_averaged(-old, -(1.0 + margin) * new, is_paired))
    return np.stack(worse, axis=1), np.stack(better, axis=1)


def _honesty_scores(
    old: FloatArray, new: FloatArray, within: float, is_paired: bool
) -> tuple[FloatArray, FloatArray]:
    """Logarithms of NEES; towards HONEST_NEES it may move without being worse.

    within: twice the margin's, since errors enter squared.
    """
    told = old[np.isfinite(old)]
    middle = float(np.median(told)) if told.size else np.log(HONEST_NEES)
    up = max(within, np.log(HONEST_NEES) - middle + within)
    down = max(within, middle - np.log(HONEST_NEES) + within)
    worse = [_ranked(old + up, new, is_paired), _ranked(-old + down, -new, is_paired)]
    toward = 1.0 if middle < np.log(HONEST_NEES) else -1.0
    better = _ranked(toward * old + within, toward * new, is_paired)
    return np.stack(worse, axis=1), better[:, None]


def _ranked(old: FloatArray, new: FloatArray, is_paired: bool) -> FloatArray:
    """Scores of the question whether new ones are usually larger."""
    return paired_rank_scores(new - old) if is_paired else rank_scores(np.concatenate([old, new]))


def _averaged(old: FloatArray, new: FloatArray, is_paired: bool) -> FloatArray:
    """Scores of the question whether new ones are larger on average."""
    return np.nan_to_num(new - old) if is_paired else centred(np.concatenate([old, new]))

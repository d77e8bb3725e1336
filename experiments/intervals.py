"""How sure the figures of a run are: 95 % intervals by the bootstrap over its trials."""

from typing import Any

import numpy as np

from slam.arrays import FloatArray

LEAST_TRIALS = 10
"""Chosen: of fewer, resampling says little but what those few happened to be."""
_RESAMPLES = 2000
_MOST_GROUPS = 2000
"""Chosen: of more trials, every two thousandth are drawn together, which changes no interval."""

Interval = tuple[float, float] | None


def error_intervals(errors: FloatArray, trials: np.ndarray) -> dict[str, Any]:
    """95 % intervals of mean, standard deviation and RMSE, keyed as the figures are.

    errors: (N, 3) [m, m, rad]; trials: (N,) whose they are: what is of one drive hangs together, and
    is drawn together. Each is None where fewer than ten trials have any. Percentiles of 2000
    resamples (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 13), the same
    each time. The largest error has no such interval: resampling never finds a larger one.
    """
    axes = ("x_cm", "y_cm", "theta_rad")
    drawn = _resampled(errors, trials)
    if drawn is None:
        nothing: dict[str, Any] = {axis: {"mean": None, "std": None} for axis in axes}
        return nothing | {"rmse_mm": None, "rmse_mrad": None}
    counts, sums, squares = drawn
    means = sums / counts
    spread = np.sqrt(np.maximum(squares - counts * means**2, 0.0) / np.maximum(counts - 1.0, 1.0))
    found: dict[str, Any] = {
        axis: {"mean": _middle95(scale * means[:, k]), "std": _middle95(scale * spread[:, k])}
        for k, (axis, scale) in enumerate(zip(axes, (100.0, 100.0, 1.0), strict=True))
    }
    rms = np.sqrt(squares / counts)
    return found | {
        "rmse_mm": _middle95(1000 * np.hypot(rms[:, 0], rms[:, 1])),
        "rmse_mrad": _middle95(1000 * rms[:, 2]),
    }


def median_interval(values: FloatArray) -> Interval:
    """95 % interval of the median of values (N,), one of each trial; None of fewer than ten."""
    if len(values) < LEAST_TRIALS:
        return None
    rng, medians = np.random.default_rng(0), []
    for _ in range(_RESAMPLES):  # one at a time: of a hundred thousand trials too it fits in memory
        medians.append(np.median(values[rng.integers(len(values), size=len(values))]))
    return _middle95(np.array(medians))


def _resampled(
    errors: FloatArray, trials: np.ndarray
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Of each resample how many errors it has (R, 1), their sums and sums of squares (R, 3)."""
    _, groups = np.unique(trials, return_inverse=True)
    if len(errors) == 0 or groups.max() + 1 < LEAST_TRIALS:
        return None
    groups = groups % _MOST_GROUPS
    count = int(groups.max()) + 1
    columns = np.column_stack([np.ones(len(errors)), errors, errors**2])
    totals = np.stack([np.bincount(groups, column, count) for column in columns.T], axis=1)
    rng = np.random.default_rng(0)
    often = rng.multinomial(count, np.full(count, 1.0 / count), size=_RESAMPLES)
    drawn = often.astype(np.float64) @ totals
    return drawn[:, :1], drawn[:, 1:4], drawn[:, 4:]


def _middle95(values: FloatArray) -> tuple[float, float]:
    low, high = np.quantile(values, (0.025, 0.975))
    return float(low), float(high)

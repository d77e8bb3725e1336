"""What a run's trials say: the paper's figures of Tables 1 and 2, and success rates."""

import math
from typing import Any

import numpy as np

from experiments.intervals import error_intervals
from experiments.paper import HEADING_MARGIN_RAD, POSITION_MARGIN_M

_Z95 = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""
NEES_TAIL = 16.27
"""What one NEES in a thousand exceeds if it is chi-square of three."""


def samples_of(records: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What is counted: each sample of the trials that drove, the records of others as they are.

    Each with the index of its trial; of one that raised, its record.
    """
    return [
        {"index": record["index"]} | sample
        for record in records
        for sample in record.get("samples", [record])
    ]


def summarised(records: list[dict[str, Any]], methods: tuple[str, ...]) -> dict[str, Any]:
    """Per method, the figures of `summary.json`; trials that raised count as failures of all.

    The errors and the bound are over the successes alone, next to the rate over all trials. The
    NEES is over every pose that was believed and came with a covariance, right or wrong.
    """
    return {name: _method_summary(records, name) for name in methods}


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """95 % confidence interval of a success rate (Wilson, 1927)."""
    if trials == 0:
        return 0.0, 1.0
    rate, z2n = successes / trials, _Z95**2 / trials
    middle = (rate + z2n / 2) / (1 + z2n)
    half = _Z95 * math.sqrt(rate * (1 - rate) / trials + z2n / (4 * trials)) / (1 + z2n)
    return max(0.0, middle - half), min(1.0, middle + half)


def _method_summary(records: list[dict[str, Any]], name: str) -> dict[str, Any]:
    outcomes = [record["methods"][name] for record in records if record["status"] == "ok"]
    found = [outcome for outcome in outcomes if outcome["success"]]
    believed = [outcome for outcome in outcomes if outcome["status"] == "matched"]
    trials = len(records)
    errors = np.array(
        [[o["x_error_m"], o["y_error_m"], o["theta_error_rad"]] for o in found]
    ).reshape(-1, 3)
    is_within = (np.hypot(errors[:, 0], errors[:, 1]) <= POSITION_MARGIN_M) & (
        np.abs(errors[:, 2]) <= HEADING_MARGIN_RAD
    )
    return {
        "success_rate": len(found) / trials if trials else None,
        "success_ci95": wilson_interval(len(found), trials),
        "failures": trials - len(found),
        "within_paper_margins": int(is_within.sum()),
        "raised": trials - len(outcomes),
        "matched": len(believed),
        "confident_wrong": sum(not outcome["success"] for outcome in believed),
        "x_cm": axis_figures(100 * errors[:, 0]),
        "y_cm": axis_figures(100 * errors[:, 1]),
        "theta_rad": axis_figures(errors[:, 2]),
        "rmse_mm": rms(1000 * np.hypot(errors[:, 0], errors[:, 1])),
        "rmse_mrad": rms(1000 * errors[:, 2]),
        "ci95": error_intervals(errors, _trials_of(records, name)),
        **_against_bound(records, name),
        **_consistency(records, name),
        **_over_all_scans(records, name),
        "warned": sum(bool(outcome["warnings"]) for outcome in outcomes),
    }


def _trials_of(records: list[dict[str, Any]], name: str) -> np.ndarray:
    """The trial of each success, in their order; a drive has many of one."""
    is_found = (one["status"] == "ok" and one["methods"][name]["success"] for one in records)
    return np.array([r["index"] for r, found in zip(records, is_found, strict=True) if found])


def _against_bound(records: list[dict[str, Any]], name: str) -> dict[str, float | None]:
    """The Cramer-Rao bound over the successes [mm], and the errors there in units of it."""
    rows = [
        (
            method["x_error_m"],
            method["y_error_m"],
            method["theta_error_rad"],
            *record["crlb"].values(),
        )
        for record in records
        if record["status"] == "ok"
        and (method := record["methods"][name])["success"]
        and record["crlb"]["position_m"] is not None
    ]
    if not rows:
        return {"crlb_mm": None, "crlb_mrad": None, "crlb_ratio": None, "crlb_ratio_theta": None}
    x, y, theta, position_m, heading_rad = (rms(column) or 0.0 for column in np.array(rows).T)
    return {
        "crlb_mm": 1000 * position_m,
        "crlb_mrad": 1000 * heading_rad,
        "crlb_ratio": math.hypot(x, y) / position_m,
        "crlb_ratio_theta": theta / heading_rad,
    }


def _consistency(records: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """Mean NEES of the poses believed, and the band in which 95 % of such means lie if it is 3.

    The band is that of as many as are independent: the poses of one drive hang together. Beside
    them the median, 2.37 if it is chi-square, and the share beyond NEES_TAIL, 0.001.
    """
    told = [
        (record["index"], method["nees"])
        for record in records
        if record["status"] == "ok"
        and (method := record["methods"][name])["status"] == "matched"
        and method["nees"] is not None
    ]
    if not told:
        return {"nees": None, "nees_band95": None, "nees_median": None, "nees_beyond": None}
    drives, values = (np.array(column) for column in zip(*told, strict=True))
    return {
        "nees": float(values.mean()),
        "nees_band95": nees_band(independent_count(values, drives)),
        "nees_median": float(np.median(values)),
        "nees_beyond": float(np.mean(values > NEES_TAIL)),
    }


def _over_all_scans(records: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """Mean NEES over every scan of all drives, from the first on, and the share beyond NEES_TAIL.

    No band: the errors of scans that follow each other hang together. Nothing where no one drove.
    """
    told = [record["scans_nees"][name] for record in records if "scans_nees" in record]
    values = np.array([nees for one in told for nees in one if nees is not None])
    if not told:
        return {}
    if not values.size:
        return {"nees_all_scans": None, "nees_all_scans_beyond": None}
    return {
        "nees_all_scans": float(values.mean()),
        "nees_all_scans_beyond": float(np.mean(values > NEES_TAIL)),
    }


def independent_count(values: np.ndarray, groups: np.ndarray) -> float:
    """As many independent values (N,) would have a mean as uncertain as these, of groups (N,).

    The design effect of cluster sampling (Kish, Survey Sampling, 1965): the variance between the
    means of groups over that of the values. No more than N; and N where no group has two values.
    """
    _, members, sizes = np.unique(groups, return_inverse=True, return_counts=True)
    if len(sizes) in (1, len(values)):
        return float(len(values))
    means = np.bincount(members, values) / sizes
    between = float(sizes @ np.square(means - values.mean())) / len(sizes)
    return len(values) / max(between / max(float(values.var()), 1e-12), 1.0)


def nees_band(count: float, dimensions: int = 3) -> tuple[float, float]:
    """Two-sided 95 % band of the mean of so many independent NEES (chi-square)."""
    freedom = count * dimensions
    # Wilson and Hilferty (1931): a cube root of chi-square is nearly normal, to 1e-4 from 30 on
    spread = math.sqrt(2.0 / (9.0 * freedom))
    low, high = ((1.0 - 2.0 / (9.0 * freedom) + z * spread) ** 3 for z in (-_Z95, _Z95))
    return dimensions * low, dimensions * high


def axis_figures(errors: np.ndarray) -> dict[str, float | None]:
    """Mean, signed value of largest magnitude, standard deviation and root mean square."""
    if not errors.size:
        return {"mean": None, "max": None, "std": None, "rmse": None}
    return {
        "mean": float(errors.mean()),
        "max": float(errors[np.abs(errors).argmax()]),
        "std": float(errors.std(ddof=1)) if errors.size > 1 else None,
        "rmse": rms(errors),
    }


def rms(values: np.ndarray) -> float | None:
    """Root mean square; None of nothing."""
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def verdict_counts(records: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """Of one method over all scans of all drives: how many there were, how often it said that it
    was lost, of which it never was, and the share of scans at which it was not sure."""
    verdicts = [
        verdict
        for record in records
        if record["status"] == "ok"
        for verdict in record["series"]["methods"][name]["verdict"]
    ]
    unsure = sum(verdict == "unsure" for verdict in verdicts)
    return {
        "scans": len(verdicts),
        "false_alarms": sum(verdict == "lost" for verdict in verdicts),
        "unsure_rate": unsure / len(verdicts) if verdicts else None,
    }

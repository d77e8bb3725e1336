"""What a run of mapping trials says: how many maps were made, and how good they are."""

from typing import Any

import numpy as np

from experiments.intervals import error_intervals, median_interval
from experiments.statistics import axis_figures, rms, wilson_interval


def mapping_summary(records: list[dict[str, Any]], methods: tuple[str, ...]) -> dict[str, Any]:
    """Per method, the figures of `summary.json`; trials that raised count as failures of all.

    Map and trajectory are judged over all trials that ran; the end of the drive, seen from its true
    start, over the successes. reported_failures: maps that the method itself called failed;
    confident_wrong: those that failed and were not.
    """
    return {name: _of_method(records, name) for name in methods}


def worst_trials(records: dict[int, dict[str, Any]], name: str, count: int = 3) -> list[int]:
    """The numbers of the trials that one method mapped worst: those that failed, then by what
    precision and recall lack, and the trajectory's error in metres."""

    def badness(index: int) -> tuple[bool, float]:
        one = records[index]["methods"][name]
        return not one["success"], one["ate_m"] + 2.0 - one["map_precision"] - one["map_recall"]

    return sorted(records, key=badness, reverse=True)[:count]


def _of_method(records: list[dict[str, Any]], name: str) -> dict[str, Any]:
    outcomes = [record["methods"][name] for record in records if record["status"] == "ok"]
    found = [outcome for outcome in outcomes if outcome["success"]]
    said = [outcome for outcome in outcomes if outcome["status"] == "failed"]
    errors = np.array(
        [[o["x_error_m"], o["y_error_m"], o["theta_error_rad"]] for o in found]
    ).reshape(-1, 3)
    trials = len(records)
    return {
        "success_rate": len(found) / trials if trials else None,
        "success_ci95": wilson_interval(len(found), trials),
        "failures": trials - len(found),
        "raised": trials - len(outcomes),
        "reported_failures": len(said),
        "confident_wrong": len(outcomes) - len(found) - len(said),
        "ate_mm": _spread(outcomes, "ate_m", 1000.0),
        "ate_max_mm": _spread(outcomes, "ate_max_m", 1000.0),
        "map_rmse_mm": _median(outcomes, "map_rmse_m", 1000.0),
        "map_precision": _median(outcomes, "map_precision"),
        "map_recall": _median(outcomes, "map_recall"),
        "map_precision_min": min((o["map_precision"] for o in outcomes), default=None),
        "map_recall_min": min((o["map_recall"] for o in outcomes), default=None),
        "x_cm": axis_figures(100 * errors[:, 0]),
        "y_cm": axis_figures(100 * errors[:, 1]),
        "theta_rad": axis_figures(errors[:, 2]),
        "rmse_mm": rms(1000 * np.hypot(errors[:, 0], errors[:, 1])),
        "rmse_mrad": rms(1000 * errors[:, 2]),
        "ci95": {
            **error_intervals(errors, np.arange(len(errors))),
            "ate_mm": {"median": median_interval(1000 * np.array(_values(outcomes, "ate_m")))},
            "map_rmse_mm": median_interval(1000 * np.array(_values(outcomes, "map_rmse_m"))),
        },
    }


def _values(outcomes: list[dict[str, Any]], key: str) -> list[float]:
    return [outcome[key] for outcome in outcomes if outcome[key] is not None]


def _median(outcomes: list[dict[str, Any]], key: str, scale: float = 1.0) -> float | None:
    values = _values(outcomes, key)
    return scale * float(np.median(values)) if values else None


def _spread(outcomes: list[dict[str, Any]], key: str, scale: float) -> dict[str, float | None]:
    values = _values(outcomes, key)
    return {
        "median": _median(outcomes, key, scale),
        "max": scale * max(values) if values else None,
    }

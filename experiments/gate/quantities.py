"""What the gate tests: of each trial, one number per method and quantity.

The trial is the unit, also where a drive has many scans: what is of one drive hangs together.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from experiments.paper import VICINITY_M, VICINITY_RAD
from slam.se2 import SE2

Outcome = dict[str, Any]
"""What the record of a trial says of one method."""
Worse = Literal["more", "less", "away"]
HONEST_NEES = 2.366
"""Median of chi-square of three: what a NEES is where the covariance claimed is true."""
_POSITION_FLOOR_M = 1e-5
_HEADING_FLOOR_RAD = 1e-5
"""Chosen: a hundredth of what one scan can tell. Machines whose libraries round differently agree
to far less where nothing is decided otherwise, so what differs by no more is called equal."""


@dataclass(frozen=True)
class Quantity:
    """One thing that is tested.

    worse: if there is more of it, less, or if it is farther away from HONEST_NEES. is_event: 1 where
    it happened in a trial, else 0; of others scale and unit are those it is shown in. floor: differences
    below it are none. cap: beyond, its mean grows no more; that is a failure, which is another
    quantity.
    """

    name: str
    title: str
    unit: str = ""
    scale: float = 1.0
    worse: Worse = "more"
    is_event: bool = False
    floor: float = 0.0
    cap: float = math.inf


def _event(name: str, title: str) -> Quantity:
    return Quantity(name, title, is_event=True)


def _position(name: str, title: str, cap: float = math.inf) -> Quantity:
    return Quantity(name, title, "mm", 1000.0, floor=_POSITION_FLOOR_M, cap=cap)


QUANTITIES = {
    one.name: one
    for one in (
        _event("failed", "failed"),
        _event("wrong", "believed, but wrong"),
        _event("missed", "kidnap not seen at once"),
        _event("false_alarm", "called itself lost, and was not"),
        _event("called_failed", "map called failed"),
        _position("position_error_m", "position error", VICINITY_M),
        Quantity(
            "heading_error_rad", "heading error", "mrad", 1000.0,
            floor=_HEADING_FLOOR_RAD, cap=VICINITY_RAD,
        ),
        Quantity("nees", "NEES", worse="away", floor=0.01),
        Quantity("pairs", "beams or points paired", worse="less", floor=0.5),
        Quantity("looks", "scans to be sure again", floor=0.5),
        Quantity("unsure_share", "scans not sure of", "%", 100.0, floor=1e-3),
        Quantity("drift", "way drifted", "mm/m", 1000.0, floor=1e-5),
        Quantity("turn_drift", "heading drifted", "mrad/m", 1000.0, floor=1e-5),
        _position("ate_m", "ATE"),
        _position("map_rmse_m", "map off true surfaces"),
        Quantity("map_excess", "map where nothing is", "%", 100.0, floor=1e-4),
        Quantity("map_missing", "surfaces not on the map", "%", 100.0, floor=1e-4),
    )
}  # fmt: skip

Values = dict[str, list[float | None]]
"""By quantity, its value in each trial; None where the trial has none."""


def trial_values(
    experiment: str, records: list[dict[str, Any]], methods: tuple[str, ...]
) -> dict[str, Values]:
    """By method, all quantities of an experiment; records: of a finished run, in order.

    A trial that raised has failed, and has nothing else. What no trial has is left out.
    """
    of_record = _OF_EXPERIMENT[experiment]
    told = {name: [_told(of_record, record, name) for record in records] for name in methods}
    return {
        name: {
            quantity: [row.get(quantity) for row in rows]
            for quantity in QUANTITIES
            if any(row.get(quantity) is not None for row in rows)
        }
        for name, rows in told.items()
    }


def _told(
    of_record: Callable[[dict[str, Any], str], dict[str, float | None]],
    record: dict[str, Any],
    method: str,
) -> dict[str, float | None]:
    if record["status"] != "ok":
        return {"failed": 1.0}
    return {
        name: value if value is None or math.isfinite(value) else None
        for name, value in of_record(record, method).items()
    }


def _of_pose(record: dict[str, Any], method: str) -> dict[str, float | None]:
    outcome: Outcome = record["methods"][method]
    is_wrong = outcome["status"] == "matched" and not outcome["success"]
    return {
        "failed": float(not outcome["success"]),
        "wrong": float(is_wrong),
        "position_error_m": math.hypot(outcome["x_error_m"], outcome["y_error_m"]),
        "heading_error_rad": abs(outcome["theta_error_rad"]),
        "nees": outcome["nees"],
        "pairs": outcome["pair_count"] or None,
    }


def _of_kidnap(record: dict[str, Any], method: str) -> dict[str, float | None]:
    outcome: Outcome = record["methods"][method]
    values = _of_pose(record, method)
    if not outcome.get("looks"):  # it cannot say that it is lost
        return values
    return values | {
        "wrong": float(outcome["verdict"] == "tracking" and not outcome["success"]),
        "missed": float(not outcome["detected"]),
        "false_alarm": float(outcome["false_alarm"]),
        "looks": float(len(outcome["looks"])),
    }


def _of_drive(record: dict[str, Any], method: str) -> dict[str, float | None]:
    """Over all scans of a drive; what each costs in pairs, and claims, every two seconds."""
    series = record["series"]["methods"][method]
    samples = [one["methods"][method] for one in record["samples"] if one["status"] == "ok"]
    told = [one["nees"] for one in samples if one["nees"] is not None]
    pairs = [one["pair_count"] for one in samples if one["pair_count"]]
    verdicts = series["verdict"]
    drift = _drift(record, method)
    return {
        "failed": float(not record["methods"][method]["success"]),
        "wrong": float(any(one["status"] == "matched" and not one["success"] for one in samples)),
        "position_error_m": _rms(series["position_error_m"]),
        "heading_error_rad": _rms(series["heading_error_rad"]),
        "nees": float(np.median(told)) if told else None,
        "pairs": float(np.mean(pairs)) if pairs else None,
        "false_alarm": float("lost" in verdicts),
        "unsure_share": sum(one == "unsure" for one in verdicts) / max(len(verdicts), 1),
        "drift": drift[0],
        "turn_drift": drift[1],
    }


def _drift(record: dict[str, Any], method: str) -> tuple[float | None, float | None]:
    """How far the motion from the first sample to the last is off, position and heading, by the way.

    Wherever the robot believed to be at first: of `odometry` it is what its wheels are off.
    """
    samples = [one for one in record["samples"] if one["status"] == "ok"]
    if len(samples) < 2:
        return None, None
    true = [np.array(one["true_poses"][-1]) for one in samples]
    way_m = float(sum(np.hypot(*(b - a)[:2]) for a, b in itertools.pairwise(true)))
    if way_m < 0.1:  # it turned on the spot
        return None, None
    ends = [samples[0]["methods"][method], samples[-1]["methods"][method]]
    first, last = (SE2(one["x_m"], one["y_m"], one["theta_rad"]) for one in ends)
    moved = SE2.from_array(true[0]).inverse() @ SE2.from_array(true[-1])
    off = moved.inverse() @ (first.inverse() @ last)
    return math.hypot(off.x, off.y) / way_m, abs(off.theta) / way_m


def _of_map(record: dict[str, Any], method: str) -> dict[str, float | None]:
    outcome: Outcome = record["methods"][method]
    return {
        "failed": float(not outcome["success"]),
        "wrong": float(outcome["status"] == "matched" and not outcome["success"]),
        "called_failed": float(outcome["status"] == "failed"),
        "ate_m": outcome["ate_m"],
        "map_rmse_m": outcome["map_rmse_m"],
        "map_excess": 1.0 - outcome["map_precision"],
        "map_missing": 1.0 - outcome["map_recall"],
        "position_error_m": math.hypot(outcome["x_error_m"], outcome["y_error_m"]),
        "heading_error_rad": abs(outcome["theta_error_rad"]),
    }


def _rms(values: list[float]) -> float | None:
    return float(np.sqrt(np.mean(np.square(values)))) if values else None


_OF_EXPERIMENT: dict[str, Callable[[dict[str, Any], str], dict[str, float | None]]] = {
    "localization": _of_pose,
    "kidnap": _of_kidnap,
    "tracking": _of_drive,
    "mapping": _of_map,
}

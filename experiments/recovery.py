"""How soon and how honestly robots carried away find themselves: figures of `summary.json`."""

from typing import Any

import numpy as np

from slam.verdict import Status


def recovery_figures(
    records: list[dict[str, Any]], timings: list[dict[str, Any]], name: str
) -> dict[str, Any]:
    """Of one method over the kidnaps that ran; null where it cannot say that it is lost, but for
    confident_wrong, left out: what its matches say of it, `statistics` counts.

    detected_rate: of the kidnaps, how many were seen by the first scan after them. false_alarms:
    trials in which the robot called itself lost before. confident_wrong: trials that ended with a
    pose believed that is not right. unsure_rate: trials that ended without one that is believed.
    scans_to_recover: of those that ended right, the first included. query_cpu_ms: of the first scan
    after the kidnap.
    """
    times_ms = [1000 * timing["methods"][name] for timing in timings if "methods" in timing]
    figures: dict[str, Any] = {
        "query_cpu_ms": {
            "median": float(np.median(times_ms)) if times_ms else None,
            "p99": float(np.quantile(times_ms, 0.99)) if times_ms else None,
        },
        "scans_to_recover": {"median": None, "max": None},
    }
    figures |= dict.fromkeys(("detected_rate", "false_alarms", "unsure_rate"))
    outcomes = [record["methods"][name] for record in records if record["status"] == "ok"]
    outcomes = [outcome for outcome in outcomes if outcome.get("looks")]
    if not outcomes:
        return figures
    sure = [o for o in outcomes if o["verdict"] == Status.TRACKING.value]
    scans = [len(outcome["looks"]) for outcome in outcomes if outcome["success"]]
    return figures | {
        "detected_rate": sum(o["detected"] for o in outcomes) / len(outcomes),
        "false_alarms": sum(o["false_alarm"] for o in outcomes),
        "confident_wrong": sum(not o["success"] for o in sure),
        "unsure_rate": 1.0 - len(sure) / len(outcomes),
        "scans_to_recover": {
            "median": float(np.median(scans)) if scans else None,
            "max": max(scans, default=None),
        },
    }

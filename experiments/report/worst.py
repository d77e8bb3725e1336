"""The worst trials of a run, method by method: what happened, and what repeats each."""

import math
from dataclasses import dataclass
from typing import Any

from experiments.map_statistics import worst_trials as worst_maps
from experiments.report.run_folder import RunFolder
from experiments.statistics import samples_of

_EACH = 3


@dataclass(frozen=True)
class WorstTrial:
    """One trial. methods: those of which it is among the worst; words: what became of it."""

    index: int
    methods: list[str]
    words: list[str]


def worst_of(run: RunFolder) -> list[WorstTrial]:
    """Trials that raised an error, and the three worst of each method, by number, each once.

    Worst are places that were wrong and believed, then other failures, then by the error.
    """
    found: dict[int, WorstTrial] = {}

    def add(index: int, method: str, words: str) -> None:
        one = found.setdefault(index, WorstTrial(index, [], []))
        one.methods.append(method)
        one.words.append(words)

    for record in [one for one in run.records if one["status"] != "ok"][:_EACH]:
        add(record["index"], "all", f"raised {record.get('error', 'an error')}")
    ran = {record["index"]: record for record in run.records if record["status"] == "ok"}
    for method in run.config.methods:
        for index in _worst_indices(run, ran, method):
            add(index, method, _words(run.experiment, ran[index], method))
    return [found[index] for index in sorted(found)]


def _worst_indices(run: RunFolder, ran: dict[int, dict[str, Any]], method: str) -> list[int]:
    if run.experiment == "mapping":
        return worst_maps(ran, method, _EACH)
    return sorted(ran, key=lambda index: _badness(ran[index], method), reverse=True)[:_EACH]


def _badness(record: dict[str, Any], method: str) -> tuple[bool, bool, float]:
    """Of its worst sample."""
    return max(
        (not one["success"] and _is_believed(one), not one["success"], _off_m(one))
        for one in (sample["methods"][method] for sample in samples_of([record]) or [record])
    )


def _is_believed(outcome: dict[str, Any]) -> bool:
    return bool(outcome["status"] == "matched" and outcome.get("verdict", "tracking") == "tracking")


def _off_m(outcome: dict[str, Any]) -> float:
    return math.hypot(outcome["x_error_m"], outcome["y_error_m"])


def _words(experiment: str, record: dict[str, Any], method: str) -> str:
    if experiment == "mapping":
        one = record["methods"][method]
        said = (
            "made"
            if one["success"]
            else "called failed"
            if one["status"] == "failed"
            else "not made"
        )
        return (
            f"{method}: {said}, ATE {1000 * one['ate_m']:.1f} mm, precision"
            f" {one['map_precision']:.4f}, recall {one['map_recall']:.4f}"
        )
    samples = [sample["methods"][method] for sample in samples_of([record]) or [record]]
    one = max(
        samples, key=lambda o: (not o["success"] and _is_believed(o), not o["success"], _off_m(o))
    )
    said = (
        "found" if one["success"] else "wrong, and believed" if _is_believed(one) else "not found"
    )
    if experiment == "tracking":
        said += f" (worst of {len(samples)} samples)"
    reasons = f": {'; '.join(map(str, one['reasons']))}" if one.get("reasons") else ""
    return (
        f"{method}: {said}, off by {1000 * _off_m(one):.1f} mm and"
        f" {1000 * abs(one['theta_error_rad']):.1f} mrad, says"
        f" “{one.get('verdict', one['status'])}”{reasons}"
    )

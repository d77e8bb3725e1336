"""What a run writes beside its trials: `config.json`, which says what was run, and `summary.json`."""

import json
import platform
import sys
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.map_statistics import mapping_summary
from experiments.paper import PAPER_VALUES
from experiments.provenance import commit, versions
from experiments.recovery import recovery_figures
from experiments.shards import WHOLE, Shard
from experiments.statistics import samples_of, summarised, verdict_counts
from experiments.trial_log import TrialLog, write_atomically
from experiments.trials import inputs

if TYPE_CHECKING:
    from experiments.runs import Run

_SAID = {"place": "the place", "robot": "the robot", "code": "the code"}
_OF_NO_FIGURE = ("steps", "reasons", "lost_scores")
"""What methods' outcomes hold that no figure of the summary is made of: most of their bytes."""


def write_config(run: "Run", config_hash: str, trials: int) -> None:
    """Writes `config.json`: what the outcome depends on, and where and how it was run."""
    known = inputs(run.experiment, run.config, run.seed)
    digests = {name: known[name] for name in _SAID}
    digests["shape"] = run.config.known_place.place.shape_digest
    content = {
        "experiment": run.experiment,
        "config": asdict(run.config),
        "config_hash": config_hash,
        "seed": run.seed,
        "trials": trials,
        "shard": None if run.shard == WHOLE else str(run.shard),
        "versions": versions(),
        "digests": digests,
        "machine": f"{platform.system()} {platform.machine()}",
        "commit": commit(),
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
    }
    write_atomically(run.folder / "config.json", json.dumps(content, indent=2) + "\n")


def shard_of(folder: Path) -> Shard | None:
    """The shard that a folder holds; None of one that holds no run."""
    content = _config_of(folder)
    shard = content.get("shard")
    if not content:
        return None
    return Shard.parsed(shard) if isinstance(shard, str) else WHOLE


def difference(run: "Run") -> str:
    """In what the run that a folder holds differs from this one, in brackets; "" if it tells not."""
    held = _config_of(run.folder)
    known = inputs(run.experiment, run.config, run.seed)
    own = {"experiment": run.experiment, "seed": run.seed}
    own |= json.loads(json.dumps(asdict(run.config))) | versions()
    there = {name: held.get(name) for name in ("experiment", "seed")}
    there |= _part(held, "config") | _part(held, "versions")
    told = [
        f"{name} is {there[name]} there, {own[name]} here"
        for name in own
        if there.get(name) is not None and there[name] != own[name]
    ]
    digests = _part(held, "digests")
    told += [
        f"{words} has changed since"
        for name, words in _SAID.items()
        if digests.get(name) is not None and digests[name] != known[name]
    ]
    return f" ({'; '.join(told)})" if told else ""


def _part(content: dict[str, Any], name: str) -> dict[str, Any]:
    part = content.get(name)
    return part if isinstance(part, dict) else {}


def _config_of(folder: Path) -> dict[str, Any]:
    """The content of `config.json`; nothing where there is none, or it is none."""
    try:
        content = json.loads((folder / "config.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def write_summary(run: "Run", log: TrialLog, asked: Iterable[int], wall_s: float) -> dict[str, Any]:
    """Writes `summary.json`, of the trials asked for that are there; its content."""
    indices = [index for index in sorted(asked) if index in log.trials]
    records = [_slim(record) for record in log.trials.records(indices)]
    counted = samples_of(records)
    samples = [sample for sample in counted if sample["status"] == "ok"]
    timed = [index for index in indices if index in log.timings]
    timings = list(log.timings.records(timed))
    summary = {
        "experiment": run.experiment,
        "trials": len(records),
        "samples": len(samples),
        "seed": run.seed,
        "wall_s": round(wall_s, 3),
        "cpu_s": round(sum(timing["cpu_s"] for timing in timings), 3),
        "sim_s": round(sum(record.get("sim_s", 0.0) for record in records), 3),
        "people_in_view": _mean(
            [record["people_in_view"] for record in samples if "people_in_view" in record]
        ),
        "methods": _of_methods(run, counted),
        "paper_values": PAPER_VALUES.get(run.experiment),
    }
    if run.experiment == "tracking":
        for name, figures in summary["methods"].items():
            figures |= verdict_counts(records, name)
    if run.experiment == "kidnap":
        for name, figures in summary["methods"].items():
            figures |= recovery_figures(records, timings, name)
    write_atomically(run.folder / "summary.json", json.dumps(summary, indent=2) + "\n")
    return summary


def _slim(record: dict[str, Any]) -> dict[str, Any]:
    """Without what no figure is made of, so that a hundred thousand fit in memory."""
    record.pop("traceback", None)
    for one in [record, *record.get("samples", [])]:
        for outcome in one.get("methods", {}).values():
            for name in _OF_NO_FIGURE:
                outcome.pop(name, None)
            for look in outcome.get("looks", []):
                look.clear()
    return record


def _of_methods(run: "Run", records: list[dict[str, Any]]) -> dict[str, Any]:
    if run.experiment == "mapping":
        return mapping_summary(records, run.config.methods)
    return summarised(records, run.config.methods)


def _mean(values: list[int]) -> float | None:
    return sum(values) / len(values) if values else None

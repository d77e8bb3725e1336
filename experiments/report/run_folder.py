"""The folder of a finished run, read and checked: what a report is made of."""

import csv
import json
from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

from experiments.runs import EXPERIMENTS
from experiments.shards import WHOLE, Shard
from experiments.statistics import samples_of
from experiments.trial_log import csv_rows
from experiments.trials import TrialConfig, config_hash

_ANEW = "the same `kitasap run` again writes it anew"
_DEPTH = 2
"""Chosen: a folder of folders of runs is looked through, a whole disk is not."""
_T = TypeVar("_T")


@dataclass(frozen=True)
class RunHead:
    """What the files of a run say of it, but for its trials. wall_s: 0 while it is not finished."""

    folder: Path
    experiment: str
    config: TrialConfig
    config_hash: str
    seed: int
    trials: int
    shard: Shard
    wall_s: float

    @classmethod
    def read(cls, folder: Path) -> "RunHead":
        """Raises ValueError, in one line, where a file is damaged or of something else."""
        path = folder / "config.json"
        content = _json(path)
        raw = _field(content, "config", dict, path)
        experiment = _field(content, "experiment", str, path)
        if experiment not in EXPERIMENTS:
            raise ValueError(f"{path}: no experiment called '{experiment}'")
        shard, wall_s = content.get("shard"), 0.0
        if (folder / "summary.json").exists():
            summary = _json(folder / "summary.json")
            wall_s = float(_field(summary, "wall_s", float, folder / "summary.json"))
        return cls(
            folder, experiment, _config(raw, path),
            _field(content, "config_hash", str, path), _field(content, "seed", int, path),
            _field(content, "trials", int, path),
            WHOLE if shard is None else Shard.parsed(str(shard)), wall_s,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class RunFolder:
    """A run as its files tell it. trials: how many were asked for; summary: the content of
    `summary.json`, None while the run is not finished; records: of the trials asked for, in order."""

    folder: Path
    experiment: str
    config: TrialConfig
    config_hash: str
    seed: int
    trials: int
    shard: Shard
    versions: dict[str, str]
    digests: dict[str, str]
    commit: str | None
    command: list[str]
    summary: dict[str, Any] | None
    records: list[dict[str, Any]]

    @classmethod
    def read(cls, folder: Path) -> "RunFolder":
        """Raises ValueError, in one line, where a file is damaged or of something else."""
        head, path, summary = RunHead.read(folder), folder / "config.json", None
        content = _json(path)
        if (folder / "summary.json").exists():
            summary = _json(folder / "summary.json")
        run = cls(
            folder, head.experiment, head.config, head.config_hash, head.seed, head.trials,
            head.shard, _field(content, "versions", dict, path),
            _field({"digests": {}} | content, "digests", dict, path),
            None if content.get("commit") is None else _field(content, "commit", str, path),
            [str(word) for word in _field(content, "command", list, path)],
            summary,
            _records(folder / "trials.jsonl", head.experiment, head.trials, head.config.methods),
        )  # fmt: skip
        if summary is not None:
            run._check_summary(summary)
            run._check_csv()
        return run

    @cached_property
    def digest(self) -> str:
        """Names the results: equal trials, equal digest."""
        return sha256((self.folder / "trials.jsonl").read_bytes()).hexdigest()[:16]

    @cached_property
    def place_problem(self) -> str | None:
        """Why the place cannot be drawn, in words; it may have been a file that is gone."""
        try:
            _ = self.config.known_place.place
        except (ValueError, OSError) as error:
            return str(error)
        return None

    @cached_property
    def is_of_this_code(self) -> bool:
        """Whether the code that runs now would give the same trials, to the bit."""
        if self.place_problem is not None:
            return False
        return config_hash(self.experiment, self.config, self.seed) == self.config_hash

    def _check_summary(self, summary: dict[str, Any]) -> None:
        """Raises ValueError where it tells of other trials than those in the log."""
        path = self.folder / "summary.json"
        methods = _field(summary, "methods", dict, path)
        counted = samples_of(self.records)
        told = {
            name: sum(
                not (one["status"] == "ok" and one["methods"][name]["success"]) for one in counted
            )
            for name in self.config.methods
        }
        said = {name: _field(one, "failures", int, path) for name, one in methods.items()}
        if said != told or summary.get("trials") != len(self.records):
            raise ValueError(f"{path} tells of other trials than trials.jsonl holds: {_ANEW}")

    def _check_csv(self) -> None:
        """Raises ValueError where `trials.csv`, of which figures are drawn, tells of other trials.

        Of the columns that both have: another version may have had others.
        """
        path = self.folder / "trials.csv"
        told = [row for record in self.records for row in csv_rows(record)]
        with path.open(newline="", encoding="utf-8", errors="replace") as file:
            said = list(csv.DictReader(file))
        shown = [
            {key: "" if row.get(key) is None else str(row.get(key)) for key in own}
            for row, own in zip(told, said, strict=False)
        ]
        if len(told) != len(said) or shown != said:
            raise ValueError(f"{path} tells of other trials than trials.jsonl holds: {_ANEW}")


def found_runs(paths: Iterable[Path]) -> list[RunFolder]:
    """The runs in folders, or in folders in them, each once, in the order of the paper.

    Raises ValueError for a folder that is none, in which there is no run, or one that is damaged.
    """
    folders: dict[Path, Path] = {}
    for path in paths:
        if not path.is_dir():
            raise ValueError(f"{path} is no folder: name one that `kitasap run` wrote")
        below = ["*/" * depth + "config.json" for depth in range(_DEPTH + 1)]
        mine = [one.parent for pattern in below for one in sorted(path.glob(pattern))]
        mine = [folder for folder in mine if (folder / "trials.jsonl").exists()]
        if not mine:
            raise ValueError(
                f"{path} holds no run: looked for config.json and trials.jsonl, as `kitasap run`"
                " writes them, in it and in the folders below"
            )
        for folder in mine:
            folders.setdefault(folder.resolve(), folder)
    runs = [RunFolder.read(folder) for folder in folders.values()]
    # the paper's own poses before others
    return sorted(
        runs, key=lambda run: (EXPERIMENTS.index(run.experiment), run.config.poses != "paper")
    )


def _config(raw: dict[str, Any], path: Path) -> TrialConfig:
    """As it was resolved. Raises ValueError where its keys are not those of this version."""
    known = {one.name for one in fields(TrialConfig)}
    if set(raw) != known:
        odd = ", ".join(sorted(set(raw) ^ known))
        raise ValueError(f"{path} is of another version, or of no run: it differs in {odd}")
    if not (isinstance(raw["methods"], list) and raw["methods"]):
        raise ValueError(f"{path} names no methods")
    odd_types = [
        name
        for name, own in vars(TrialConfig()).items()
        if name != "methods"
        and not isinstance(raw[name], (int, float) if isinstance(own, float) else type(own))
    ]
    if odd_types:
        raise ValueError(f"{path} has {odd_types[0]} of another kind: {raw[odd_types[0]]!r}")
    return TrialConfig(**raw | {"methods": tuple(map(str, raw["methods"]))})


def _records(
    path: Path, experiment: str, trials: int, methods: tuple[str, ...]
) -> list[dict[str, Any]]:
    """The trials asked for, in their order. A last line that a crash cut off is no damage."""
    text = path.read_bytes()
    records: dict[int, dict[str, Any]] = {}
    for number, line in enumerate(text[: text.rfind(b"\n") + 1].splitlines(), start=1):
        try:
            record = json.loads(line)
            index, is_ok = int(record["index"]), record["status"] == "ok"
            if record["experiment"] != experiment:
                raise ValueError(f"of {record['experiment']}")
            for sample in samples_of([record]) if is_ok else ():
                for name in methods:
                    _ = bool(sample["methods"][name]["success"])
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise ValueError(
                f"{path} line {number} is not a trial of this run: {error!r}"
            ) from error
        if index < trials:
            records[index] = record
    return [records[index] for index in sorted(records)]


def _json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} is not JSON: {error}") from error
    if not isinstance(content, dict):
        raise ValueError(f"{path} is not of a run: it holds a {type(content).__name__}")
    return content


def _field(content: Any, name: str, kind: type[_T], path: Path) -> _T:
    value = content.get(name) if isinstance(content, dict) else None
    if not isinstance(value, kind):
        raise ValueError(
            f"{path} is not of a run: '{name}' is {'missing' if value is None else 'wrong'}"
        )
    return value

"""Baselines: what a run's trials measured and what it was made from, in a small file of plain JSON."""

import hashlib
import json
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, NoReturn

from experiments.gate.quantities import QUANTITIES, Values, trial_values
from experiments.report.run_folder import RunFolder
from experiments.runs import EXPERIMENTS
from experiments.shards import WHOLE
from experiments.trial_log import write_atomically
from experiments.trials import TrialConfig

FORMAT = 1
"""Of the file; another one is refused."""
_LARGEST_FILE = 200_000_000
_MOST = 1e9
"""No quantity is as large; a number that is, is none of ours."""


@dataclass(frozen=True, eq=False)
class RunValues:
    """A finished run as the gate sees it.

    config: of the trials, as `config.json` has it. inputs: what else it was made from: config_hash
    (of configuration, seed, code and libraries), shape (digest of what stands in the place; none in
    baselines of before), versions, commit, command. results: names what
    the trials recorded, whatever code they are of; equal ones have equal names. values: by method and quantity.
    """

    experiment: str
    config: dict[str, Any]
    seed: int
    trials: int
    inputs: dict[str, Any]
    results: str
    values: dict[str, Values]

    @classmethod
    def of(cls, run: RunFolder) -> "RunValues":
        """Raises ValueError for a run that is not finished."""
        if run.shard != WHOLE:
            raise ValueError(
                f"{run.folder} is shard {run.shard} of a run: `kitasap merge` makes one of all shards"
            )
        if run.summary is None or len(run.records) < run.trials:
            raise ValueError(
                f"{run.folder} is not finished, {len(run.records)} of {run.trials} trials:"
                " the same `kitasap run` again does the rest"
            )
        inputs = {
            "config_hash": run.config_hash,
            "shape": run.digests.get("shape"),
            "versions": run.versions,
            "commit": run.commit,
            "command": _without_out(run.command),
        }
        values = trial_values(run.experiment, run.records, run.config.methods)
        return cls(
            run.experiment, _plain(asdict(run.config)), run.seed, run.trials, inputs,
            _digest([one | {"config": None} for one in run.records]),
            {name: _rounded(told) for name, told in values.items()},
        )  # fmt: skip

    @property
    def methods(self) -> tuple[str, ...]:
        """In the order in which they were named."""
        return tuple(self.config["methods"])

    def of_methods(self, names: Iterable[str]) -> "RunValues":
        """The same with some methods alone. Raises ValueError where one is not there."""
        wanted = list(names)
        for name in wanted:
            if name not in self.values:
                raise ValueError(
                    f"{self.experiment} has no method '{name}'; it has {', '.join(self.values)}"
                )
        return replace(
            self,
            config=self.config | {"methods": wanted},
            values={name: self.values[name] for name in wanted},
        )


def write_baseline(path: Path, runs: list[RunValues]) -> None:
    """Writes a baseline; a list of numbers to a line, so that a diff can be read."""
    told = [vars(run) for run in runs]
    content = {"kitasap_baseline": FORMAT, "digest": _digest(told), "runs": told}
    text = json.dumps(content, indent=1, allow_nan=False)
    text = re.sub(r"\[[^\[\]{}]*\]", lambda found: " ".join(found[0].split()), text)
    write_atomically(path, text + "\n")


def read_baseline(path: Path) -> list[RunValues]:
    """Raises ValueError in one line for a file that is damaged, of another version or none of ours."""
    if not path.exists():
        raise ValueError(
            f"there is no baseline {path}: `kitasap baseline DIR --out {path}` makes it"
        )
    if not path.is_file() or path.stat().st_size > _LARGEST_FILE:
        raise ValueError(f"{path} is no baseline: one is a small file of JSON")
    try:
        content = json.loads(path.read_text(encoding="utf-8"), parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        said = " ".join(str(error).split())[:200]
        raise ValueError(f"{path} is damaged, or no baseline: {said}") from error
    if not isinstance(content, dict) or "kitasap_baseline" not in content:
        raise ValueError(f"{path} is no baseline: `kitasap baseline DIR` makes one")
    version = content["kitasap_baseline"]
    if version is True or version != FORMAT:
        raise ValueError(
            f"{path} is a baseline of version {repr(version)[:80]}, and {FORMAT} is read here:"
            " make it anew from a run"
        )
    raw = content.get("runs")
    if not isinstance(raw, list) or not raw:
        raise ValueError(f"{path} is damaged: it holds no runs")
    runs = [_run(one, f"{path}, run {number}") for number, one in enumerate(raw, start=1)]
    if content.get("digest") != _digest(raw):
        raise ValueError(
            f"{path} is damaged, or was changed by hand: its digest is not that of its runs;"
            " make it anew from a run"
        )
    return runs


def _without_out(command: Sequence[str]) -> list[str]:
    """A command line without the folder that its results went to: of one machine, and of no effect."""
    kept = list(command)
    if "--out" in kept:
        at = kept.index("--out")
        del kept[at : at + 2]
    return [word for word in kept if not word.startswith("--out=")]


def _run(raw: Any, where: str) -> RunValues:
    kinds: dict[str, type] = {
        "experiment": str, "config": dict, "seed": int, "trials": int, "inputs": dict,
        "results": str, "values": dict,
    }  # fmt: skip
    if not isinstance(raw, dict):
        raise ValueError(f"{where} is damaged: it is a {type(raw).__name__}")
    for name, kind in kinds.items():
        if not isinstance(raw.get(name), kind) or isinstance(raw[name], bool):
            raise ValueError(f"{where} is damaged: '{name}' is missing, or of another kind")
    if not isinstance(raw["inputs"].get("versions"), dict):
        raise ValueError(f"{where} is damaged: 'versions' is missing, or of another kind")
    if raw["experiment"] not in EXPERIMENTS:
        raise ValueError(
            f"{where} is of an experiment {raw['experiment'][:80]!r} that is not known here"
        )
    known = {one.name: one for one in fields(TrialConfig)}
    if odd := sorted(set(raw["config"]) - set(known)):
        raise ValueError(
            f"{where} has settings that are not known here: {repr(', '.join(odd))[:200]}"
        )
    # one that came later had its default then
    defaults = {name: one.default for name, one in known.items() if one.default is not MISSING}
    config = _plain(defaults | raw["config"])
    methods = config["methods"]
    are_names = isinstance(methods, list) and all(isinstance(one, str) for one in methods)
    if not are_names or sorted(methods) != sorted(raw["values"]):
        raise ValueError(f"{where} is damaged: its values are not those of its methods")
    for method, values in raw["values"].items():
        if not isinstance(values, dict) or "failed" not in values:
            raise ValueError(f"{where} is damaged: {method[:80]!r} has no trials")
        for name, told in values.items():
            _check_values(name, told, raw["trials"], f"{where}, {method[:80]!r}")
    own = {name: raw[name] for name in kinds}
    return RunValues(**own | {"config": config})


def _check_values(name: str, told: Any, trials: int, where: str) -> None:
    if name not in QUANTITIES:
        raise ValueError(f"{where} has a quantity {name[:80]!r} that is not known here")
    if not isinstance(told, list) or len(told) != trials:
        raise ValueError(f"{where} is damaged: {name} is not told of {trials} trials")
    for one in told:
        if one is None:
            continue
        if isinstance(one, bool) or not isinstance(one, int | float) or not 0 <= one < _MOST:
            raise ValueError(f"{where} is damaged: {repr(one)[:80]} is no {name}")


def _digest(runs: list[Any]) -> str:
    """Of all that the file tells."""
    text = json.dumps(runs, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _plain(content: dict[str, Any]) -> dict[str, Any]:
    """As JSON gives it back."""
    return {name: list(one) if isinstance(one, tuple) else one for name, one in content.items()}


def _rounded(values: Values) -> Values:
    """Seven digits: less than machines differ by."""
    return {
        name: [None if one is None else _seven_digits(one) for one in told]
        for name, told in values.items()
    }


def _seven_digits(value: float) -> float:
    short = float(f"{value:.7g}")
    return int(short) if short.is_integer() and math.fabs(short) < 1e6 else short


def _no_number(word: str) -> NoReturn:
    raise ValueError(f"it holds {word}, which is no number")

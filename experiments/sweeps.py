"""Sweeps: a run for each combination of what is varied, and a table over all of them."""

import csv
import io
import itertools
import json
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from experiments.sequential import rate_interval
from experiments.trial_log import write_atomically
from experiments.trials import TrialConfig
from kitasap_sim.laser import laser
from kitasap_sim.laser_changes import changeable

_FIELDS = {"turn-rate": "turn_rate_radps", "duration": "duration_s"}
"""Of the configuration, where an option of the command is called otherwise."""
_LASER = "laser."
_FIGURES = ("rmse_mm", "rmse_mrad")
TABLE_FIELDS = (
    *("method", "trials", "success_rate", "success_low", "success_high"),
    *("rmse_mm", "rmse_mm_low", "rmse_mm_high", "rmse_mrad", "rmse_mrad_low", "rmse_mrad_high"),
    *("confident_wrong", "raised", "folder"),
)
"""Columns of `sweep.csv`, behind those that are varied."""


@dataclass(frozen=True)
class Varied:
    """One thing that is varied: its name as typed, its values as typed."""

    name: str
    values: tuple[str, ...]

    @classmethod
    def parsed(cls, text: str) -> "Varied":
        """Of "people=0,3,6". Raises ValueError, naming what there is, for anything else."""
        name, equals, listed = text.partition("=")
        values = tuple(listed.split(","))
        if not equals or "" in values:
            raise ValueError(f"--vary takes NAME=VALUE,VALUE,..., not '{text}'")
        if len(set(values)) != len(values):
            raise ValueError(f"--vary {name} has a value twice")
        if name not in _names():
            raise ValueError(f"nothing called '{name}' can be varied; there are: {_listed()}")
        return cls(name, values)

    @property
    def numbers(self) -> list[float] | None:
        """The values, where all are numbers."""
        try:
            return [float(value) for value in self.values]
        except ValueError:
            return None

    def changed(self, config: TrialConfig, value: str) -> TrialConfig:
        """The configuration with a value. Raises ValueError where it is of another kind."""
        if self.name.startswith(_LASER):
            changed = f"{config.laser}:{self.name.removeprefix(_LASER)}={value}"
            laser(changed)  # whatever is wrong with it is said of this name
            return replace(config, laser=changed)
        field = _FIELDS.get(self.name, self.name)
        kind = type(getattr(config, field))
        try:
            return replace(config, **{field: kind(value)})
        except ValueError:
            raise ValueError(f"--vary {self.name} takes numbers, not '{value}'") from None


@dataclass(frozen=True)
class Cell:
    """One combination: the values, by what is varied, and the configuration with them."""

    values: dict[str, str]
    config: TrialConfig

    @property
    def folder_name(self) -> str:
        """Of its run; of a place's path its name alone."""
        return ",".join(f"{name}={Path(value).stem if '/' in value else value}"
                        for name, value in self.values.items())  # fmt: skip


def cells(config: TrialConfig, varied: list[Varied]) -> list[Cell]:
    """All combinations, the last varied fastest.

    Raises ValueError where something is varied twice, or two would lie in one folder.
    """
    names = [one.name for one in varied]
    if len(set(names)) != len(names):
        raise ValueError(f"--vary names something twice: {', '.join(names)}")
    # a laser first, then what is changed of it
    order = sorted(varied, key=lambda one: one.name.startswith(_LASER))
    made = []
    for values in itertools.product(*(one.values for one in varied)):
        by_name, own = dict(zip(names, values, strict=True)), config
        for one in order:
            own = one.changed(own, by_name[one.name])
        made.append(Cell(by_name, own))
    folders = [cell.folder_name for cell in made]
    if len(set(folders)) != len(folders):
        raise ValueError("two places of --vary place have the same file name: rename one")
    return made


def row(cell: Cell, summary: dict[str, Any], *, is_sequential: bool) -> dict[str, Any]:
    """What a cell's run says, by method. is_sequential: it was ended by what it said, and its
    interval has to hold for that."""
    methods = {}
    for name, told in summary["methods"].items():
        low, high = told["success_ci95"]
        if is_sequential:
            won = summary["trials"] - told["failures"]
            low, high = rate_interval(won, summary["trials"])
        of_errors = {figure: told[figure] for figure in _FIGURES}
        for figure in _FIGURES:
            interval = told["ci95"][figure] or (None, None)
            of_errors |= {f"{figure}_low": interval[0], f"{figure}_high": interval[1]}
        methods[name] = {
            "trials": summary["trials"],
            "success_rate": told["success_rate"],
            "success_low": low,
            "success_high": high,
            **of_errors,
            "confident_wrong": told["confident_wrong"],
            "raised": told["raised"],
            "scans_to_recover": told.get("scans_to_recover"),
        }
    return {"values": cell.values, "folder": cell.folder_name, "methods": methods}


def write_sweep(folder: Path, told: dict[str, Any], rows: list[dict[str, Any]]) -> None:
    """Writes `sweep.json` and `sweep.csv`. told: what the sweep is, for the first."""
    write_atomically(folder / "sweep.json", json.dumps(told | {"cells": rows}, indent=2) + "\n")
    text = io.StringIO()
    writer = csv.DictWriter(
        text, [*told["varied"], *TABLE_FIELDS], lineterminator="\n", extrasaction="ignore"
    )
    writer.writeheader()
    writer.writerows(flat_rows(rows))
    write_atomically(folder / "sweep.csv", text.getvalue())


def flat_rows(rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """A line for each cell and method."""
    return [
        one["values"] | {"method": name, "folder": one["folder"]} | figures
        for one in rows
        for name, figures in one["methods"].items()
    ]


def _names() -> set[str]:
    own = {one.name for one in fields(TrialConfig)} - set(_FIELDS.values()) - {"methods"}
    return own | set(_FIELDS) | {_LASER + field for field in _laser_fields()}


def _laser_fields() -> tuple[str, ...]:
    return changeable(laser("urg_04lx"))


def _listed() -> str:
    own = sorted(name for name in _names() if not name.startswith(_LASER))
    return ", ".join(own) + ", laser. and one of " + ", ".join(_laser_fields())

"""The kidnaps of a finished run, read from its files for the figures that are drawn of them."""

import enum
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.figures.canvas import plain
from slam.se2 import wrap_angle

_DISOWNED = ("lost", "not converged", "degenerate")
"""Statuses of a match that its method does not stand for."""


class Ending(enum.Enum):
    """How a kidnap ended for one method."""

    FOUND = "found"
    SAID = "lost and said so"
    BELIEVED = "wrong but believed"


@dataclass(frozen=True)
class Kidnaps:
    """The trials of a run that were asked for. records: of those that did not raise."""

    config: dict[str, Any]
    records: list[dict[str, Any]]
    raised: int

    @classmethod
    def read(cls, folder: Path) -> "Kidnaps":
        """From `config.json` and `trials.jsonl` of a folder."""
        config = json.loads((folder / "config.json").read_text())
        with (folder / "trials.jsonl").open() as file:
            records = [json.loads(line) for line in file]
        # finished in the order in which the processes came; the figures are to be equal
        asked = sorted(
            (record for record in records if record["index"] < config["trials"]),
            key=lambda record: int(record["index"]),
        )
        done = [record for record in asked if record["status"] == "ok"]
        return cls(config["config"], done, len(asked) - len(done))

    @property
    def methods(self) -> list[str]:
        """In the order of the configuration."""
        return list(self.config["methods"])

    @property
    def place(self) -> str:
        """The name of the place, without its path, as it stands in a title."""
        return plain(Path(self.config["place"]).stem)

    def of(self, method: str) -> list[dict[str, Any]]:
        """What one method made of each trial."""
        return [record["methods"][method] for record in self.records]


def ending(outcome: dict[str, Any]) -> Ending:
    """How a kidnap ended, by a method's part of its record."""
    if outcome["success"]:
        return Ending.FOUND
    # logs from before there were verdicts have the match's status alone
    is_believed = outcome["status"] not in _DISOWNED and outcome.get("verdict") in (
        "tracking",
        None,
    )
    return Ending.BELIEVED if is_believed else Ending.SAID


def set_down(record: dict[str, Any]) -> np.ndarray:
    """(3,) where the hand set the robot down [m, rad]; heading nan where no record tells it.

    The last of `true_poses` is after all looks: same spot, but the robot has turned there.
    """
    x, y, _ = record["true_poses"][-1]
    for outcome in record["methods"].values():
        looks = outcome.get("looks", [])
        if len(looks) <= 1:
            return np.array([x, y, wrap_angle(true_heading(outcome))])
    for outcome in record["methods"].values():
        first = outcome["looks"][0]
        if first["is_near"] and first["places"]:
            return np.array([x, y, first["places"][0][2]])
    return np.array([x, y, math.nan])


def true_heading(outcome: dict[str, Any]) -> float:
    """Which way the robot faced when the method had its last look [rad]."""
    return float(outcome["theta_rad"] - outcome["theta_error_rad"])

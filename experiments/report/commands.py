"""The command lines that a report names: each makes again what it stands beside."""

import shlex
from dataclasses import fields
from pathlib import Path

from experiments.runs import experiment_module
from experiments.trials import TrialConfig

_OPTIONS = {
    "poses": "--poses",
    "place": "--place",
    "laser": "--laser",
    "odometry": "--odometry",
    "methods": "--method",
    "people": "--people",
    "mismatch": "--mismatch",
    "map": "--map",
    "turn_rate_radps": "--turn-rate",
    "duration_s": "--duration",
}
"""Of `kitasap run` and `kitasap trial`, by what they set."""


def trial_command(experiment: str, config: TrialConfig, seed: int, index: int) -> str | None:
    """What repeats one trial of a run; None where no options say what its configuration is."""
    options = config_options(experiment, config)
    if options is None:
        return None
    seeded = ["--seed", str(seed), "--index", str(index)]
    return shlex.join(["kitasap", "trial", experiment, *seeded, *options])


def run_command(
    experiment: str, config: TrialConfig, seed: int, trials: int, out: Path
) -> str | None:
    """What makes, or goes on with, a run; out: the folder that the run's own lies in."""
    options = config_options(experiment, config)
    if options is None:
        return None
    counted = ["--trials", str(trials), "--seed", str(seed)]
    return shlex.join(["kitasap", "run", experiment, *counted, *options, "--out", str(out)])


def config_options(experiment: str, config: TrialConfig) -> list[str] | None:
    """The options that differ from the experiment's own; None where there is none for one that does:
    the run was made from Python."""
    own, options = experiment_module(experiment).DEFAULTS, []
    for name in (one.name for one in fields(TrialConfig)):
        value = getattr(config, name)
        if value == getattr(own, name):
            continue
        if name not in _OPTIONS:
            return None
        options += [_OPTIONS[name], ",".join(value) if name == "methods" else str(value)]
    return options

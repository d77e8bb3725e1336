"""`kitasap bench gate`: whether the gate finds what is worse, and leaves alone what is not.

Planted regressions are run with the baseline's seeds, as a merge is, and with others. Honest reruns
differ in nothing but their seeds; each is held against the one before, as the gate would, and
paired with it too, trial by trial, which they are not: that tests the tests of pairs.
"""

import itertools
from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import asdict, replace
from typing import Any

from rich import box
from rich.table import Table

from experiments.bench.planted import NOTHING, PLANTS
from experiments.gate.baseline import RunValues
from experiments.gate.check import ALPHA, MARGIN, Check, checked
from experiments.gate.quantities import trial_values
from experiments.progress import CountProgress
from experiments.runs import recorded_trial
from experiments.statistics import wilson_interval
from experiments.tables import wide_console
from experiments.trials import TrialConfig

STANDING = TrialConfig(poses="random", methods=("paper", "limit"))
DRIVING = TrialConfig(poses="random", methods=("odometry",), duration_s=4.5)
WHERE = {
    "laser noise +20 %": ("localization", STANDING),
    "wheel radius +1 %": ("tracking", DRIVING),
    "one beam in ten dropped": ("localization", STANDING),
    "ICP stopped after 5 iterations": ("localization", STANDING),
}
"""Where each plant is looked for: wheels tell nothing of a robot that stands, and of one that drives
they are judged without the laser."""
SIZES = (10, 30, 100)
ALPHAS = (0.01, 0.05, 0.2)
_APART = 500_000
"""Between the seeds of planted regressions and of honest reruns."""
Plant = Callable[[], AbstractContextManager[None]]


def print_benchmark(
    experiment: str | None, repeats: int, reruns: int, trials: int, seed: int
) -> None:
    """Prints both tables. experiment: in which alone to look; repeats: of each plant; reruns: honest
    ones, of so many trials each. Raises ValueError where nothing is planted in an experiment."""
    plants = [name for name, (where, _) in WHERE.items() if experiment in (None, where)]
    if not plants:
        known = ", ".join(sorted({where for where, _ in WHERE.values()}))
        raise ValueError(f"nothing is planted in '{experiment}': name one of {known}, or none")
    console = wide_console()
    console.print(_power_table(plants, repeats, seed))
    console.print(_honest_table(dict(WHERE[name] for name in plants), reruns, trials, seed))


def measured(
    experiment: str, config: TrialConfig, seed: int, trials: int, plant: Plant = NOTHING
) -> RunValues:
    """A run of an experiment, nothing of it on disk."""
    with plant():
        records = [
            {"index": index} | recorded_trial(experiment, config, seed, index)[1]
            for index in range(trials)
        ]
    values: Any = trial_values(experiment, records, config.methods)
    settings = asdict(config) | {"methods": list(config.methods)}
    return RunValues(experiment, settings, seed, trials, {}, repr(values), values)


def first(run: RunValues, trials: int) -> RunValues:
    """The run as it was after so many trials."""
    values = {
        method: {name: told[:trials] for name, told in values.items()}
        for method, values in run.values.items()
    }
    return replace(run, trials=trials, values=values)


def _power_table(plants: list[str], repeats: int, seed: int) -> Table:
    """Planted runs against the baseline of their own seed, and of the next one."""
    most = max(SIZES)
    baselines: dict[str, list[RunValues]] = {}
    planted: dict[str, list[RunValues]] = {}
    wanted = [(name, number) for name in plants for number in range(repeats)]
    with CountProgress("planted", len(wanted)) as progress:
        for done, (name, number) in enumerate(wanted, start=1):
            experiment, config = WHERE[name]
            known = baselines.setdefault(experiment, [])
            if len(known) == number:
                known.append(measured(experiment, config, seed + number, most))
            run = measured(experiment, config, seed + number, most, PLANTS[name])
            planted.setdefault(name, []).append(run)
            progress.update(done, name)
    table = Table(
        title=f"Planted regressions found, of {repeats} each: alpha {ALPHA}, margin {MARGIN:.0%}",
        box=box.SIMPLE_HEAD,
    )
    for column in ("planted", "looked for in"):
        table.add_column(column)
    for seeds in ("paired", "other seeds"):
        for size in SIZES:
            table.add_column(f"{size} trials\n{seeds}", justify="right")
    table.add_column(f"seen best in\n({most}, paired)")
    for name in plants:
        experiment, config = WHERE[name]
        cells, best = [], ""
        for shift in (1, 0):
            for size in SIZES:
                checks = [
                    checked([(first(baselines[experiment][(number + shift) % repeats], size), new)])
                    for number, new in enumerate(first(run, size) for run in planted[name])
                ]
                cells.append(str(sum(bool(check.worse) for check in checks)))
                best = _seen_best(checks)
        table.add_row(
            name, f"{experiment}: {','.join(config.methods)}",
            *cells[len(SIZES) :], *cells[: len(SIZES)], best,
        )  # fmt: skip
    return table


def _seen_best(checks: list[Check]) -> str:
    """What is called worse most often."""
    seen = Counter(f"{one.quantity.title}, {one.method}" for check in checks for one in check.worse)
    return ", ".join(name for name, _ in seen.most_common(1)) or "-"


def _honest_table(configs: dict[str, TrialConfig], reruns: int, trials: int, seed: int) -> Table:
    table = Table(
        title=f"False alarms: {reruns} honest reruns of {trials} trials, each against the one before",
        box=box.SIMPLE_HEAD,
    )
    for column in ("experiment", "compared", "margin"):
        table.add_column(column)
    for alpha in ALPHAS:
        table.add_column(f"alpha {alpha}\n({alpha * reruns:g} stated)", justify="right")
    for experiment, config in configs.items():
        runs = []
        with CountProgress(f"reruns, {experiment}", reruns + 1) as progress:
            for number in range(reruns + 1):
                runs.append(measured(experiment, config, seed + _APART + number, trials))
                progress.update(number + 1)
        for how, is_paired in (("as runs of other seeds", False), ("as if they were pairs", True)):
            for margin in (MARGIN, 0.0):
                cells = _alarms(runs, margin, is_paired=is_paired)
                where = f"{experiment}: {','.join(config.methods)}"
                table.add_row(where, how, f"{margin:.0%}", *cells)
    return table


def _alarms(runs: list[RunValues], margin: float, *, is_paired: bool) -> list[str]:
    """For each alpha how many checks end with status 1, and the 95 % interval of how often they do."""
    least = []
    for old, new in itertools.pairwise(runs):
        known = replace(old, seed=new.seed) if is_paired else old
        least.append(min(one.p for one in checked([(known, new)], margin=margin).findings))
    counts = [sum(p <= alpha for p in least) for alpha in ALPHAS]
    intervals = [wilson_interval(count, len(least)) for count in counts]
    return [
        f"{count} ({low:.1%} to {high:.1%})"
        for count, (low, high) in zip(counts, intervals, strict=True)
    ]

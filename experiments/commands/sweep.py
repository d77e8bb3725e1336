"""The command `kitasap sweep`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from experiments.commands.options import (
    RESULTS,
    Again,
    Duration,
    EngineAddress,
    EngineName,
    Jobs,
    KnownMap,
    Laser,
    Methods,
    Mismatch,
    Odometry,
    Poses,
    Seed,
    TrialLimit,
    TrialPeople,
    TrialPlace,
    Trials,
    TurnRate,
)
from experiments.commands.simulated import check_used, config_of

if TYPE_CHECKING:
    from experiments.runs import Run
    from experiments.sweeps import Cell

_FIXED = "95 % intervals: of success Wilson, of RMSE bootstrap"
_SEQUENTIAL = (
    "95 % intervals: of success a confidence sequence, which holds at whatever number of trials it is"
    " ended; of RMSE bootstrap"
)


def sweep(
    experiment: Annotated[str, typer.Argument(help="localization, kidnap, tracking, mapping.")],
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="NAME=VALUE,...",
            help="What is varied: any option below of a trial (not methods, seed or how many),"
            " or laser.beams, laser.view_deg,"
            " laser.range_noise (a factor), laser.dropout_rate ...; again for another.",
        ),
    ],
    trials: Trials = 200,
    until_ci: Annotated[
        float | None,
        typer.Option(
            help="A combination ends when each method's success is known to so much to either side;"
            " --trials is the most then. Looked at while it runs, an interval has to be wider to"
            " hold: it is a confidence sequence."
        ),
    ] = None,
    seed: Seed = 0,
    jobs: Jobs = None,
    engine: EngineName = "local",
    address: EngineAddress = None,
    trial_timeout: TrialLimit = None,
    retry_failed: Again = False,
    out: Annotated[
        Path, typer.Option(help="Folder of the results, a run for each combination.")
    ] = (RESULTS / "sweep"),
    poses: Poses = "paper",
    place: TrialPlace = None,
    laser: Laser = "urg_04lx",
    odometry: Odometry = "as_built",
    method: Methods = None,
    people: TrialPeople = None,
    mismatch: Mismatch = "none",
    known_map: KnownMap = "true",
    turn_rate: TurnRate = None,
    duration: Duration = None,
) -> None:
    """Runs an experiment for all combinations of what is varied: a table, and a plot with bands."""
    from experiments.engine_names import engine_named
    from experiments.outputs import checked_beside_runs, checked_folder
    from experiments.runs import Run
    from experiments.sequential import RatesKnown
    from experiments.sweeps import Varied, cells

    typed = poses, place, laser, odometry, method, people, mismatch, known_map, turn_rate, duration
    config = config_of(experiment, *typed)
    varied = [Varied.parsed(text) for text in vary]
    made = cells(config, varied)
    done_by = engine_named(engine, jobs, trial_timeout, address)
    enough = None if until_ci is None else RatesKnown(until_ci, config.methods)
    if enough is not None and experiment == "tracking":
        raise ValueError("--until-ci counts independent trials: the samples of a drive are none")
    checked_beside_runs(out)
    _check_each_used(experiment, made, {one.name for one in varied}, turn_rate, duration)
    runs = [
        Run(experiment, cell.config, seed, trials, out / cell.folder_name,
            again=retry_failed, enough=enough)
        for cell in made
    ]  # fmt: skip
    for each in runs:
        each.check()
        checked_folder(each.folder)
    told = {
        "experiment": experiment,
        "seed": seed,
        "trials": trials,
        "until_ci": until_ci,
        "interval": _FIXED if enough is None else _SEQUENTIAL,
        "varied": {one.name: list(one.values) for one in varied},
    }
    raise typer.Exit(1 if _executed(made, runs, done_by, out, told) else 0)


def _check_each_used(
    experiment: str,
    made: list["Cell"],
    names: set[str],
    turn_rate: float | None,
    duration: float | None,
) -> None:
    """Raises ValueError where something is given or varied that the experiment does not look at."""
    for cell in made:
        check_used(
            [experiment],
            cell.config.poses,
            cell.config.map,
            cell.config.turn_rate_radps if "turn-rate" in names else turn_rate,
            cell.config.duration_s if "duration" in names else duration,
        )


def _executed(
    made: list["Cell"], runs: list["Run"], engine: Any, out: Path, told: dict[str, Any]
) -> bool:
    """Executes the runs, and writes table and figure; whether any trial raised."""
    from experiments.commands.execution import executed_alone, is_hurt, print_where
    from experiments.figures.sweep import sweep_figure
    from experiments.sweeps import row, write_sweep
    from experiments.tables import sweep_table, wide_console
    from experiments.trials import forget_places

    rows, has_raised = [], False
    for number, (cell, run) in enumerate(zip(made, runs, strict=True), start=1):
        summary = executed_alone(run, engine, f"{number}/{len(runs)} {cell.folder_name}")
        has_raised |= is_hurt(summary)
        rows.append(row(cell, summary, is_sequential=run.enough is not None))
        forget_places()
    write_sweep(out, told, rows)
    wide_console().print(sweep_table(told, rows))
    sweep_figure(out)
    print_where("runs, sweep.csv, sweep.json and sweep.png", out)
    return has_raised

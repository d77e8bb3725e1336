"""The commands on the simulated robot: experiments, one trial, a picture, calibration."""

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from experiments.commands.options import (
    PAPER_TRIALS,
    RESULTS,
    Duration,
    Jobs,
    Laser,
    Methods,
    Mismatch,
    Odometry,
    Out,
    People,
    PlaceName,
    Poses,
    Seed,
    Trials,
    TurnRate,
)

if TYPE_CHECKING:
    from experiments.runs import Run
    from experiments.trials import TrialConfig


def run(
    experiments: Annotated[list[str], typer.Argument(help="localization, kidnap, tracking.")],
    trials: Trials = PAPER_TRIALS,
    seed: Seed = 0,
    jobs: Jobs = None,
    out: Out = RESULTS,
    poses: Poses = "paper",
    place: PlaceName = "room_fig4",
    laser: Laser = "urg_04lx",
    odometry: Odometry = "as_built",
    method: Methods = None,
    people: People = 0,
    mismatch: Mismatch = "none",
    turn_rate: TurnRate = 0.5,
    duration: Duration = 30.0,
) -> None:
    """Runs the paper's experiments; the same command again goes on where it stopped."""
    from experiments.runs import Run, experiment_module

    config = _config(poses, place, laser, odometry, method, people, mismatch, turn_rate, duration)
    for name in experiments:
        experiment_module(name).checked(config)
    has_raised = False
    for name in experiments:
        summary = _executed(Run(name, config, seed, trials, out / name), jobs)
        has_raised |= any(result["raised"] for result in summary["methods"].values())
    raise typer.Exit(1 if has_raised else 0)


def trial(
    experiment: Annotated[str, typer.Argument(help="localization, kidnap or tracking.")],
    index: Annotated[int, typer.Option(min=0, help="Number of the trial within its run.")] = 0,
    seed: Seed = 0,
    out: Out = RESULTS,
    poses: Poses = "paper",
    place: PlaceName = "room_fig4",
    laser: Laser = "urg_04lx",
    odometry: Odometry = "as_built",
    method: Methods = None,
    people: People = 0,
    mismatch: Mismatch = "none",
    turn_rate: TurnRate = 0.5,
    duration: Duration = 30.0,
) -> None:
    """Repeats one trial of a run, bit for bit: prints its line of trials.jsonl, draws it."""
    from experiments.figures import trial_picture
    from experiments.runs import experiment_module
    from experiments.trials import config_hash, generator

    module = experiment_module(experiment)
    config = module.checked(
        _config(poses, place, laser, odometry, method, people, mismatch, turn_rate, duration)
    )
    key = {"experiment": experiment, "config": config_hash(experiment, config, seed)}
    result = module.run_trial(config, generator(experiment, seed, index))
    print(json.dumps(key | {"index": index} | result.record()))
    folder = out / experiment
    folder.mkdir(parents=True, exist_ok=True)
    print(f"picture: {trial_picture(folder, config, result, index)}", file=sys.stderr)


def picture(
    place: Annotated[str, typer.Argument(help="A place by name, or an MJCF file.")] = "room_fig4",
    out: Annotated[Path, typer.Option(help="The PNG file to write.")] = Path("picture.png"),
    laser: Laser = "urg_04lx",
) -> None:
    """Draws the robot in a place, with the beams of its laser."""
    import numpy as np

    from experiments.figures import image_file
    from kitasap_sim.rendering import render
    from kitasap_sim.simulation import Simulation

    simulation = Simulation(place, laser, rng=np.random.default_rng(0))
    pixels = render(simulation, beams_m=simulation.next_frame().ranges_m)
    print(image_file(out, pixels))


def calibrate(
    place: PlaceName = "room_fig4",
    laser: Laser = "urg_04lx",
    odometry: Odometry = "as_built",
    mismatch: Mismatch = "mount",
    seed: Seed = 0,
    duration: Annotated[float, typer.Option(help="Of the drive [s].")] = 60.0,
) -> None:
    """Drives, and finds the laser's mounting and the wheels' radii and track from the drive."""
    from experiments.calibration import CalibrationConfig, run_calibration

    result = run_calibration(CalibrationConfig(place, laser, odometry, mismatch, duration), seed)
    print(result.table())
    raise typer.Exit(0 if result.found.is_observable else 1)


def _config(
    poses: str,
    place: str,
    laser: str,
    odometry: str,
    method: str | None,
    people: int,
    mismatch: str,
    turn_rate: float,
    duration: float,
) -> "TrialConfig":
    from experiments.methods import DEFAULT_METHODS
    from experiments.trials import TrialConfig

    return TrialConfig(
        # any word may be typed for poses: TrialConfig.checked() refuses the wrong ones
        poses=poses,  # type: ignore[arg-type]
        place=place,
        laser=laser,
        odometry=odometry,
        methods=DEFAULT_METHODS if method is None else tuple(method.split(",")),
        people=people,
        mismatch=mismatch,
        turn_rate_radps=turn_rate,
        duration_s=duration,
    )


def _executed(run: "Run", jobs: int | None) -> dict:
    """Executes a run under a progress line; prints its table and where its files are."""
    from rich.console import Console

    from experiments.figures import run_figures, trial_picture
    from experiments.progress import TrialProgress
    from experiments.runs import experiment_module
    from experiments.tables import summary_table
    from experiments.trials import generator

    console = Console(width=None if sys.stdout.isatty() else 140)
    drawable: list[int] = []
    with TrialProgress(run.experiment, run.trials, run.config.methods) as progress:

        def on_trial(index: int, record: dict) -> None:
            progress.update(index, record)
            if record["status"] == "ok":
                drawable.append(index)

        summary = run.execute(jobs or os.cpu_count() or 1, on_trial)
    console.print(summary_table(summary, run.config.poses))
    if drawable:
        index = min(drawable)
        result = experiment_module(run.experiment).run_trial(
            run.config, generator(run.experiment, run.seed, index)
        )
        trial_picture(run.folder, run.config, result, index)
    run_figures(run.folder)
    console.print(f"results and figures: {run.folder}")
    return summary

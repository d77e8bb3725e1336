"""The command `kitasap`. Heavy imports wait within the commands: `--help` answers at once."""

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from experiments.runs import Run
    from experiments.trials import TrialConfig

# Typer brings its own copy of Click, or uses the one installed, by its version; either way this is
# the base class of what it raises for wrong usage.
_WrongUsage: type[Exception] = next(
    c for c in typer.BadParameter.__mro__ if c.__name__ == "ClickException"
)

app = typer.Typer(
    name="kitasap",
    help="Kitasap2 drives, is lifted, and finds itself: the testbed and its experiments.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
bench_app = typer.Typer()
app.add_typer(bench_app, name="bench")

Poses = Annotated[
    str,
    typer.Option(
        help="paper: one pair of poses; random: drawn in the free space; anywhere: kidnapped to anywhere."
    ),
]
PlaceName = Annotated[str, typer.Option(help="A place by name, or the path of an MJCF file.")]
Laser = Annotated[str, typer.Option(help="The laser range sensor carried.")]
Odometry = Annotated[str, typer.Option(help="ideal, as_built or rough_floor.")]
Methods = Annotated[
    str | None, typer.Option("--method", help="Methods, by commas; default: paper,open3d,limit.")
]
People = Annotated[int, typer.Option(min=0, help="People who walk about.")]
Mismatch = Annotated[
    str, typer.Option(help="What is not as assumed: none, noisy, quiet, offset, mount or chair.")
]
TurnRate = Annotated[float, typer.Option(help="Of tracking [rad/s].")]
Duration = Annotated[float, typer.Option(help="Of each drive of tracking [s].")]
Seed = Annotated[int, typer.Option(min=0, help="Master seed of all random numbers.")]
Out = Annotated[Path, typer.Option(help="Folder of the results, one subfolder per experiment.")]
Jobs = Annotated[int | None, typer.Option(min=1, help="Processes; default: one per core.")]
Trials = Annotated[int, typer.Option(min=1, help="How many.")]

RESULTS = Path("results")
_INTERRUPTED = 130


@app.command()
def run(
    experiments: Annotated[list[str], typer.Argument(help="localization, kidnap, tracking.")],
    trials: Trials = 100,
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


@app.command()
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


@app.command()
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


@bench_app.callback(invoke_without_command=True)
def bench(context: typer.Context) -> None:
    """Measures the testbed itself."""
    if context.invoked_subcommand is None:
        print(context.get_help())


@bench_app.command("sim")
def bench_sim(place: PlaceName = "room_fig4", laser: Laser = "urg_04lx") -> None:
    """The simulation's speed as a ratio to bare MuJoCo, and how true its robot drives."""
    from experiments.bench.simulation import print_benchmark

    print_benchmark(place, laser)


@bench_app.command("registration")
def bench_registration(
    trials: Trials = 100,
    seed: Seed = 0,
    place: PlaceName = "room_fig4",
    laser: Laser = "urg_04lx",
    out: Annotated[Path | None, typer.Option(help="Write the table as JSON to this file.")] = None,
) -> None:
    """Processor time and error of one scan registered on a known map, beside other libraries."""
    from experiments.bench.registration_run import print_benchmark

    print_benchmark(place, laser, trials, seed, out)


@bench_app.command("mismatch")
def bench_mismatch(
    trials: Annotated[int, typer.Option(min=1, help="At rest, for each mismatch.")] = 100,
    drives: Annotated[int, typer.Option(min=1, help="Moving, for each mismatch.")] = 6,
    seed: Seed = 0,
    place: PlaceName = "room_fig4",
    laser: Laser = "urg_04lx",
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = RESULTS / "mismatch",
) -> None:
    """What is left of accuracy and honesty where sensor or map are not as assumed."""
    from experiments.bench.mismatch import print_benchmark

    print_benchmark(place, laser, trials, drives, seed, out)


@bench_app.command("relocalization")
def bench_relocalization(
    trials: Trials = 100, seed: Seed = 0, laser: Laser = "urg_04lx", people: People = 3
) -> None:
    """Processor time of one query of the whole map, place by place."""
    from experiments.bench.relocalization import print_benchmark

    print_benchmark(laser, people, trials, seed)


@app.command()
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


@app.command("real-log")
def real_log(
    log: Annotated[Path, typer.Argument(help="A CARMEN log, gz or plain.")],
    reference: Annotated[Path, typer.Option(help="Reference poses of its scans, TUM format.")],
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = RESULTS / "real-log",
    method: Annotated[str, typer.Option(help="open3d, fast or limit.")] = "open3d",
    protocol: Annotated[
        str,
        typer.Option(
            help="tracked: odd scans followed on the map of the even ones; each: asked one by one, no"
            " prior; jumps: second half, teleported, on the map of the first."
        ),
    ] = "tracked",
    jumps: Annotated[int, typer.Option(min=1, help="How often the robot is teleported.")] = 10,
    seed: Seed = 0,
) -> None:
    """Maps a recorded log from reference poses of some of its scans, localises the others."""
    from experiments import real_logs
    from experiments.figures import real_log_picture

    if protocol != "tracked":
        _relocalized_log(log, reference, out, method, protocol, jumps, seed)

    result = real_logs.run(log, reference, real_logs.RealLogConfig(method=method))
    real_logs.write_results(result, out)
    real_log_picture(out, result)
    summary = result.summary()
    print(real_logs.table(summary))
    print(f"results and figures: {out}")
    raise typer.Exit(0 if summary["tracked"] == summary["scans"] else 1)


@app.command()
def localize(
    known_map: Annotated[Path, typer.Argument(metavar="MAP", help="A ROS map, its .yaml file.")],
    log: Annotated[Path, typer.Argument(help="A CARMEN log, gz or plain.")],
    start: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="Pose at the first scan: x y [m] and heading [rad]; else unknown."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = RESULTS / "localize",
    method: Annotated[str, typer.Option(help="open3d, fast or limit.")] = "limit",
) -> None:
    """Follows a recorded log on a known map: trajectory, a verdict for each scan, a figure."""
    import math

    from experiments import localize as localizing
    from experiments.figures import localized_log_picture
    from experiments.progress import ScanProgress
    from slam.se2 import SE2

    if start is not None and not all(map(math.isfinite, start)):
        raise ValueError(f"--start takes three finite numbers, not {start}")
    T_start = None if start is None else SE2(*start)
    config = localizing.LocalizeConfig(method=method)
    if out.exists() and not out.is_dir():  # refused now rather than after the log
        raise ValueError(f"--out takes a folder, and {out} is a file")
    with ScanProgress(log.name) as progress:
        result = localizing.run(known_map, log, T_start, config, progress.update)
    localizing.write_results(result, out)
    localized_log_picture(out, result)
    print(localizing.table(result.summary()))
    print(f"results and figures: {out}")


def _relocalized_log(
    log: Path, reference: Path, out: Path, method: str, protocol: str, jumps: int, seed: int
) -> None:
    """`real-log` where the start is unknown; exits with 1 if a wrong place was believed."""
    from experiments import real_relocalization
    from experiments.progress import ScanProgress
    from experiments.real_logs import RealLogConfig

    config = RealLogConfig(method=method)
    with ScanProgress(log.name) as progress:
        result = real_relocalization.run(
            log, reference, protocol, config, jumps, seed, progress.update
        )
    real_relocalization.write_results(result, out)
    summary = result.summary()
    print(real_relocalization.table(summary))
    print(f"results: {out}")
    raise typer.Exit(1 if summary["sure_elsewhere"] else 0)


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


def main(arguments: list[str] | None = None) -> int:
    """The exit status: 0 done, 1 fell short, 2 wrong usage or unreadable input, in one line.

    KITASAP_TRACEBACK in the environment lets the exception behind that line through.
    """
    # one thread each: the trials are spread over processes, and sums keep their order
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    try:
        status = app(arguments, prog_name="kitasap", standalone_mode=False)
    except _WrongUsage as error:
        # looked up by name above, so the type checker cannot know the method
        return _refused(error.format_message())  # type: ignore[attr-defined]
    except (ValueError, OSError, RuntimeError, ImportError) as error:
        if os.environ.get("KITASAP_TRACEBACK"):
            raise
        return _refused(_reason(error))
    except (KeyboardInterrupt, typer.Abort):
        status = _INTERRUPTED
    if status == _INTERRUPTED:  # Typer returns most interrupts as a status, and says nothing
        print("\nkitasap: interrupted; the same command goes on from here", file=sys.stderr)
    return status if isinstance(status, int) else 0


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return str(error) or type(error).__name__


def _refused(reason: str) -> int:
    print("kitasap:", " ".join(reason.split()), file=sys.stderr)
    return 2


def run_script(experiment: str) -> None:
    """What `python -m experiments.<experiment>` does: `kitasap run` of that experiment."""
    sys.exit(main(["run", experiment, *sys.argv[1:]]))


def entry() -> None:
    """The console script."""
    sys.exit(main())


if __name__ == "__main__":
    entry()

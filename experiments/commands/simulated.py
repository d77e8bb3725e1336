"""The commands on the simulated robot: experiments, one trial, a picture, calibration."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from experiments.commands.options import (
    PAPER_TRIALS,
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
    Out,
    PlaceName,
    Poses,
    Rerun,
    Seed,
    ShardPart,
    TrialLimit,
    TrialPeople,
    TrialPlace,
    Trials,
    TurnRate,
)
from experiments.outputs import checked_bag, checked_file, checked_folder, naming

if TYPE_CHECKING:
    from experiments.film import TrialFilm
    from experiments.trial_bag import TrialRecorder
    from experiments.trials import TrialConfig

_USED_BY = {
    "--poses anywhere": ("kidnap",),
    # mapping has no map beforehand
    "--map made": ("localization", "kidnap", "tracking"),
    "--turn-rate": ("tracking",),
    "--duration": ("tracking",),
}
"""Which experiments look at an option that others do not."""


def run(
    experiments: Annotated[
        list[str], typer.Argument(help="localization, kidnap, tracking, mapping.")
    ],
    trials: Trials = PAPER_TRIALS,
    seed: Seed = 0,
    jobs: Jobs = None,
    shard: ShardPart = None,
    engine: EngineName = "local",
    address: EngineAddress = None,
    trial_timeout: TrialLimit = None,
    retry_failed: Again = False,
    out: Out = RESULTS,
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
    figures: Annotated[
        bool, typer.Option(help="Draw figures in the end; the trials are the same without.")
    ] = True,
) -> None:
    """Runs the paper's experiments; the same command again goes on where it stopped."""
    from experiments.commands.execution import has_raised
    from experiments.engine_names import engine_named
    from experiments.runs import Run
    from experiments.shards import WHOLE, Shard

    typed = poses, place, laser, odometry, method, people, mismatch, known_map, turn_rate, duration
    part = WHOLE if shard is None else Shard.parsed(shard)
    done_by = engine_named(engine, jobs, trial_timeout, address)
    runs = [
        Run(name, config_of(name, *typed), seed, trials, out / name, part, retry_failed)
        for name in experiments
    ]
    for each in runs:
        each.check()
        checked_folder(each.folder)
    check_used(experiments, poses, known_map, turn_rate, duration)
    raise typer.Exit(1 if has_raised(runs, done_by, figures=figures) else 0)


def trial(
    experiment: Annotated[str, typer.Argument(help="localization, kidnap, tracking or mapping.")],
    index: Annotated[int, typer.Option(min=0, help="Number of the trial within its run.")] = 0,
    seed: Seed = 0,
    out: Out = RESULTS,
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
    mcap: Annotated[
        bool, typer.Option("--mcap", help="Write it as a ROS 2 bag, too; /pose_est: last method.")
    ] = False,
    video: Annotated[
        bool, typer.Option("--video", help="Film it, too: trial_<index>.mp4; of the last method.")
    ] = False,
    video_file: Annotated[
        Path | None, typer.Option(help="The same into a file: an .mp4, or a .gif under 3 MB.")
    ] = None,
    rerun: Rerun = None,
) -> None:
    """Repeats one trial of a run, bit for bit: prints its line of trials.jsonl, draws it."""
    from experiments.figures import trial_picture
    from experiments.observer import Observers
    from experiments.progress import ScanProgress
    from experiments.rerun_stream import shown
    from experiments.rerun_views import RerunTrial
    from experiments.runs import experiment_module, trial_result
    from experiments.trials import config_hash

    typed = poses, place, laser, odometry, method, people, mismatch, known_map, turn_rate, duration
    config = experiment_module(experiment).checked(config_of(experiment, *typed))
    check_used([experiment], poses, known_map, turn_rate, duration)
    folder = checked_folder(out / experiment)
    bag = checked_bag(folder / f"trial_{index}") if mcap else None
    recorder = None if bag is None else _recorder(config)
    if video or video_file is not None:
        video_file = _checked_film(video_file or folder / f"trial_{index}.mp4")
    film = None if video_file is None else _film(config)
    key = {"experiment": experiment, "config": config_hash(experiment, config, seed)}
    with shown(rerun, f"{experiment} {index} of seed {seed}") as stream:
        live = None if stream is None else RerunTrial(stream, config)
        watching = [one for one in (recorder, film, live) if one is not None]
        result = trial_result(experiment, config, seed, index, Observers(*watching))
        if live is not None:
            live.finish(result)
    print(json.dumps(key | {"index": index} | result.record()))
    folder.mkdir(parents=True, exist_ok=True)
    if bag is not None and recorder is not None:
        recorder.write(bag, config, result)
        print(f"bag: {bag}", file=sys.stderr)
    if video_file is not None and film is not None:
        with ScanProgress("film") as progress:
            title = f"{experiment} {index} in {Path(config.place).stem}, {config.methods[-1]}"
            film.write(video_file, config, result, title, progress.update)
        print(f"video: {video_file}", file=sys.stderr)
    print(f"picture: {trial_picture(folder, config, result, index)}", file=sys.stderr)


def _recorder(config: "TrialConfig") -> "TrialRecorder":
    """Of the method that was named last: the libraries of bags are loaded only here."""
    from experiments.trial_bag import TrialRecorder

    return TrialRecorder(config.methods[-1])


def _checked_film(path: Path) -> Path:
    """The file of a film, if one can be drawn and written there, and nothing is there yet."""
    from experiments.video import checked_video
    from kitasap_sim.rendering import check_rendering

    checked_file(checked_video(path, "--video-file"))
    if path.exists():
        raise ValueError(f"{path} is there already, and is not written over: move it away")
    check_rendering()
    return path


def _film(config: "TrialConfig") -> "TrialFilm":
    """Of the method that was named last."""
    from experiments.film import TrialFilm

    return TrialFilm(config.methods[-1])


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

    if checked_file(out).suffix.lower() != ".png":
        raise ValueError(f"--out takes a PNG file, and {out} is named otherwise")
    simulation = Simulation(place, laser, rng=np.random.default_rng(0))
    pixels = render(simulation, beams_m=simulation.next_frame().ranges_m)
    with naming(out):
        image_file(out, pixels)
    print(out)


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
    from experiments.progress import DriveProgress

    config = CalibrationConfig(place, laser, odometry, mismatch, duration)
    with DriveProgress("calibrate", after="finding mounting and wheels") as progress:
        result = run_calibration(config, seed, progress.update)
    print(result.table())
    raise typer.Exit(0 if result.found.is_observable else 1)


def config_of(
    experiment: str,
    poses: str,
    place: str | None,
    laser: str,
    odometry: str,
    method: str | None,
    people: int | None,
    mismatch: str,
    known_map: str,
    turn_rate: float | None,
    duration: float | None,
) -> "TrialConfig":
    """What was typed; None: as the experiment has it."""
    from dataclasses import replace

    from experiments.runs import experiment_module

    own = experiment_module(experiment).DEFAULTS
    result: TrialConfig = replace(
        own,
        # any word may be typed: checked() refuses the wrong ones
        poses=poses,
        place=own.place if place is None else place,
        laser=laser,
        odometry=odometry,
        methods=own.methods if method is None else tuple(method.split(",")),
        people=own.people if people is None else people,
        mismatch=mismatch,
        map=known_map,
        turn_rate_radps=own.turn_rate_radps if turn_rate is None else turn_rate,
        duration_s=own.duration_s if duration is None else duration,
    )
    return result


def check_used(
    experiments: list[str],
    poses: str,
    known_map: str,
    turn_rate: float | None,
    duration: float | None,
) -> None:
    """Raises ValueError for an option that was typed and that none of the experiments uses."""
    typed = {
        "--poses anywhere": poses == "anywhere",
        "--map made": known_map == "made",
        "--turn-rate": turn_rate is not None,
        "--duration": duration is not None,
    }
    for option, users in _USED_BY.items():
        if typed[option] and not set(users) & set(experiments):
            raise ValueError(
                f"{option} changes nothing of {' and '.join(experiments)}: it is of"
                f" {', '.join(users)}"
            )

"""The commands on the driving tasks: `kitasap drive` and `kitasap train`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from experiments.commands.options import RESULTS, Seed
from experiments.outputs import checked_file, checked_folder

if TYPE_CHECKING:
    import numpy as np


def drive(
    task: Annotated[str, typer.Argument(help="GoTo, Explore, Relocalize or Track.")],
    policy: Annotated[str, typer.Option(help="baseline, trained or random.")] = "baseline",
    episodes: Annotated[int, typer.Option(min=1, help="How many.")] = 100,
    seed: Seed = 0,
    place: Annotated[
        str | None,
        typer.Option(
            help="A place by name, a path, or random or twofold, a new room each time; default:"
            " the task's."
        ),
    ] = None,
    difficulty: Annotated[float | None, typer.Option(help="Of random rooms, 0 to 1.")] = None,
    people: Annotated[int | None, typer.Option(min=0, help="People who walk about.")] = None,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = RESULTS / "drive",
    video: Annotated[Path | None, typer.Option(help="A .gif or .mp4 of the first episode.")] = None,
) -> None:
    """Drives episodes of a task under a policy: how often it succeeds, collides, and how fast."""
    from experiments import drive as driving
    from experiments.progress import CountProgress
    from experiments.tables import wide_console
    from experiments.video import checked_video, write_video

    config = driving.DriveConfig(task, policy, episodes, seed, place, difficulty, people)
    checked_folder(out)
    if video is not None:
        checked_file(checked_video(video))
    frames: list[np.ndarray] = []
    won = 0
    with CountProgress(f"{task}, {policy}", episodes) as progress:

        def on_episode(done: int, record: dict[str, Any]) -> None:
            nonlocal won
            driving.write_episode(out, record)
            won += record["success"]
            progress.update(done, f"succeeded: {won}")

        records = driving.run(config, on_episode, None if video is None else frames.append)
    summary = driving.summarised(config, records)
    driving.write_summary(out, summary)
    wide_console().print(driving.table(summary))
    if video is not None:
        write_video(video, frames)
        print(f"video: {video}")
    print(f"results: {out}")


def train(
    task: Annotated[str, typer.Argument(help="GoTo: what there is a network for.")],
    steps: Annotated[
        int, typer.Option(min=1000, help="Decisions to learn from, four steps of 50 ms each.")
    ] = 106_496,
    seed: Seed = 2,
    out: Annotated[Path, typer.Option(help="Folder of network and curve.")] = RESULTS / "train",
) -> None:
    """Trains a policy for a driving task by PPO (extra rl): network and learning curve."""
    from experiments.train import train as learn

    learn(task, steps, seed, out)

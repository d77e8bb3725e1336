"""`kitasap bench`: the testbed itself, measured."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import RESULTS, Laser, Log, People, PlaceName, Seed, Trials
from experiments.outputs import checked_beside_runs, checked_file

app = typer.Typer()

JsonOut = Annotated[Path | None, typer.Option(help="Write the table as JSON to this file.")]


@app.callback(invoke_without_command=True)
def bench(context: typer.Context) -> None:
    """Measures the testbed itself."""
    if context.invoked_subcommand is None:
        print(context.get_help())


@app.command("all")
def overview(
    log: Annotated[
        Path | None, typer.Argument(help="A recorded log, for mapping; else that is left out.")
    ] = None,
    trials: Annotated[int, typer.Option(min=2, help="Of registration and relocalisation.")] = 30,
    seed: Seed = 0,
    out: Annotated[Path | None, typer.Option(help="Write the table in Markdown to it.")] = None,
) -> None:
    """Simulation, registration, relocalisation, mapping and tasks, with peers, in one table."""
    from experiments.bench.overview import print_benchmark

    if out is not None:
        checked_file(out)
    print_benchmark(log, trials, seed, out)


@app.command("sim")
def simulation(place: PlaceName = "room_fig4", laser: Laser = "urg_04lx") -> None:
    """The simulation's speed as a ratio to bare MuJoCo, and how true its robot drives."""
    from experiments.bench.simulation import print_benchmark

    print_benchmark(place, laser)


@app.command()
def registration(
    trials: Trials = 100,
    seed: Seed = 0,
    place: PlaceName = "room_fig4",
    laser: Laser = "urg_04lx",
    out: JsonOut = None,
) -> None:
    """Processor time and error of one scan registered on a known map, beside other libraries."""
    from experiments.bench.registration_run import print_benchmark

    if out is not None:
        checked_file(out)
    print_benchmark(place, laser, trials, seed, out)


@app.command()
def mismatch(
    trials: Annotated[int, typer.Option(min=1, help="At rest, for each mismatch.")] = 100,
    drives: Annotated[int, typer.Option(min=1, help="Moving, for each mismatch.")] = 6,
    seed: Seed = 0,
    place: PlaceName = "room_fig4",
    laser: Laser = "urg_04lx",
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = RESULTS / "mismatch",
) -> None:
    """What is left of accuracy and honesty where sensor or map are not as assumed."""
    from experiments.bench.mismatch import print_benchmark

    print_benchmark(place, laser, trials, drives, seed, checked_beside_runs(out))


@app.command()
def relocalization(
    trials: Trials = 100, seed: Seed = 0, laser: Laser = "urg_04lx", people: People = 3
) -> None:
    """Processor time of one query of the whole map, place by place."""
    from experiments.bench.relocalization import print_benchmark

    print_benchmark(laser, people, trials, seed)


@app.command()
def mapping(
    log: Log,
    out: JsonOut = None,
) -> None:
    """Processor time and memory of mapping a recorded log: front end, loops, finishing."""
    from experiments.bench.mapping import print_benchmark

    if out is not None:
        checked_file(out)
    print_benchmark(log, out)


Reference = Annotated[Path, typer.Option(help="Its true poses, a TUM file.")]


@app.command()
def damage(
    log: Log,
    reference: Reference,
    repeats: Annotated[int, typer.Option(min=1, help="Of each damage, each drawn anew.")] = 2,
    seed: Seed = 0,
) -> int:
    """Scans lost, odometry that jumps, a frozen laser: a right map, or one called failed?"""
    from experiments.bench.damage import print_benchmark

    return 0 if print_benchmark(log, reference, repeats, seed) else 1


@app.command()
def sensors(
    log: Log,
    reference: Reference,
    repeats: Annotated[int, typer.Option(min=1, help="Of each, noise drawn anew.")] = 1,
    seed: Seed = 0,
) -> int:
    """A log by other lasers and wheels, or driven backwards: a right map, or one called failed?"""
    from experiments.bench.sensors import print_benchmark

    return 0 if print_benchmark(log, reference, repeats, seed) else 1


@app.command()
def combined(
    log: Log,
    reference: Reference,
    pairs: Annotated[int, typer.Option(min=1, help="Of a sensor and a damage, drawn.")] = 20,
    seed: Seed = 0,
) -> int:
    """A log by other sensors, and damaged as well: a right map, or one called failed?"""
    from experiments.bench.combined import print_benchmark

    return 0 if print_benchmark(log, reference, pairs, seed) else 1


@app.command()
def buildings(
    odometry: Annotated[
        str, typer.Option(help="Of the logs: usual, bad (5 to 15 cm off after a metre), or none.")
    ] = "usual",
    repeats: Annotated[int, typer.Option(min=1, help="Of each of nine kinds, drawn anew.")] = 2,
    seed: Seed = 0,
    trouble: Annotated[
        str, typer.Option(help="On the way: none, spins (of the wheels), or walkers along it.")
    ] = "none",
) -> int:
    """Logs of simulated buildings, up to 200 m large: a right map, or one called failed?"""
    from experiments.bench.buildings import print_benchmark

    return 0 if print_benchmark(odometry, repeats, seed, trouble) else 1


@app.command()
def rounds(
    rounds: Annotated[int, typer.Option(min=1, help="Of the same corridors.")] = 32,
    seed: Seed = 0,
) -> int:
    """One way driven over and over: what mapping takes for a scan, and memory, from round to round."""
    from experiments.bench.rounds import print_benchmark

    return 0 if print_benchmark(rounds, seed) else 1


@app.command()
def continued(
    log: Log,
    reference: Reference,
    relations: Annotated[
        Path | None, typer.Option(help="Relations to judge by; else built of the reference.")
    ] = None,
    out: JsonOut = None,
) -> int:
    """A log's second half on the map that the first one left, beside the log in one go."""
    from experiments.bench.continued import print_benchmark

    if out is not None:
        checked_file(out)
    return 0 if print_benchmark(log, reference, relations, out) else 1


@app.command()
def wheels(
    log: Log,
    repeats: Annotated[int, typer.Option(min=2, help="Maps by either wheels.")] = 6,
    seed: Seed = 0,
) -> None:
    """Whether wheels calibrated from the drive make a log of encoder ticks a sharper map."""
    from experiments.bench.wheels import print_benchmark

    print_benchmark(log, repeats, seed)


@app.command()
def env(
    place: Annotated[
        str, typer.Option(help="A place's name or MJCF file, or 'random'.")
    ] = "random",
    difficulty: Annotated[float, typer.Option(min=0.0, max=1.0, help="Of a random room.")] = 0.5,
    seed: Seed = 0,
) -> None:
    """What the driving tasks cost beside the bare physics, and many of them at once."""
    from experiments.bench.env import print_benchmark

    print_benchmark(place, difficulty, seed)


@app.command()
def runner(
    trials: Annotated[int, typer.Option(min=20, help="Kidnaps to anywhere.")] = 200,
    empty: Annotated[int, typer.Option(min=100, help="Trials that do nothing.")] = 2000,
    seed: Seed = 0,
    out: Annotated[
        Path | None, typer.Option(help="Keep the runs in this folder; the same command goes on.")
    ] = None,
) -> None:
    """What the runner adds to a trial, how well two processes share the work, and memory."""
    from experiments.bench.runner import print_benchmark

    print_benchmark(trials, empty, seed, None if out is None else checked_beside_runs(out))


@app.command()
def gate(
    experiment: Annotated[
        str | None, typer.Option(help="Look in localization or tracking alone.")
    ] = None,
    repeats: Annotated[int, typer.Option(min=2, help="Of each planted regression.")] = 20,
    reruns: Annotated[int, typer.Option(min=1, help="Honest ones.")] = 200,
    trials: Annotated[int, typer.Option(min=7, help="Of each honest rerun.")] = 10,
    seed: Seed = 0,
) -> None:
    """Regressions planted and found by `kitasap check`, and its false alarms."""
    from experiments.bench.gate import print_benchmark

    print_benchmark(experiment, repeats, reruns, trials, seed)


@app.command()
def fuzz(
    target: Annotated[str, typer.Argument(help="A reader or an update, or 'all'.")] = "all",
    minutes: Annotated[float, typer.Option(min=0.02, help="For each, at most.")] = 20.0,
    inputs: Annotated[int, typer.Option(min=1, help="For each, at most.")] = 1_000_000,
    seed: Seed = 0,
    out: Annotated[Path, typer.Option(help="Folder of the inputs found.")] = RESULTS / "fuzz",
) -> int:
    """Mutated files for every reader, arbitrary scans for every update: none may crash or hang."""
    from experiments.bench.fuzz import print_benchmark

    return 0 if print_benchmark(target, minutes, inputs, seed, checked_beside_runs(out)) else 1


@app.command()
def soak(
    hours: Annotated[float, typer.Option(min=0.01, help="Simulated.")] = 1.0,
    place: PlaceName = "room_fig4",
    laser: Laser = "urg_04lx",
    people: People = 2,
    method: Annotated[str, typer.Option(help="limit, fast or open3d.")] = "limit",
    seed: Seed = 0,
) -> int:
    """Drives on and on with kidnaps, people and failing sensors: is memory flat, is it honest?"""
    from experiments.bench.soak import print_benchmark
    from experiments.trials import TrialConfig

    config = TrialConfig(place=place, laser=laser, people=people, methods=(method,)).checked()
    if method not in ("limit", "fast", "open3d"):
        raise ValueError(f"{method} does not know when it is lost; limit, fast and open3d do")
    return 0 if print_benchmark(config, hours, seed) else 1

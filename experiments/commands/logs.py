"""The commands on recorded logs: `kitasap slam`, `kitasap localize` and `kitasap real-log`."""

import math
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from experiments.commands.options import (
    RESULTS,
    Log,
    LogMethod,
    LogOut,
    Mount,
    OdomTopic,
    Rerun,
    ScanTopic,
    Seed,
)
from experiments.outputs import files_before, results_of_one, results_together
from experiments.protocols import DEFAULT_METHOD, REAL_LOG_FILES

if TYPE_CHECKING:
    from experiments.progress import ScanProgress, SlamProgress
    from slam.mapping import MapperStep
    from slam.readers.log import LogChoice
    from slam.se2 import SE2

_TURN_RAD = 6.3
"""A whole turn, as it is typed."""
_MOUNT_M = 10.0
"""From a robot's base to its laser: the largest vehicle's."""


def real_log(
    log: Log,
    reference: Annotated[Path, typer.Option(help="Reference poses of its scans, TUM format.")],
    out: LogOut = RESULTS / "real-log",
    method: LogMethod = DEFAULT_METHOD["real-log"],
    protocol: Annotated[
        str,
        typer.Option(
            help="tracked: odd scans followed on the map of the even ones;"
            " each: asked one by one, no prior;"
            " jumps: second half, teleported, on the map of the first."
        ),
    ] = "tracked",
    jumps: Annotated[
        int | None,
        typer.Option(min=1, help="Of jumps, how often the robot is teleported; default: 10."),
    ] = None,
    seed: Seed = 0,
) -> None:
    """Maps a recorded log from reference poses of some of its scans, localises the others.

    Ends with status 1 where a scan was not tracked, or, with a protocol whose start is unknown, a wrong
    place was believed.
    """
    if jumps is not None and protocol != "jumps":
        raise ValueError(f"--jumps changes nothing of {protocol}: it is of --protocol jumps")
    with results_of_one(out, *REAL_LOG_FILES):
        if protocol == "tracked":
            is_done = _tracked(log, reference, out, method)
        else:
            is_done = _relocalized(log, reference, out, method, protocol, jumps or 10, seed)
    raise typer.Exit(0 if is_done else 1)


def _tracked(log: Path, reference: Path, out: Path, method: str) -> bool:
    """`real-log` from a start that is known: whether every scan was tracked."""
    from experiments import real_logs
    from experiments.figures import real_log_picture
    from experiments.progress import ScanProgress

    config = real_logs.RealLogConfig(method=method)
    with ScanProgress(log.name) as progress:
        result = real_logs.run(log, reference, config, progress.update)
    with results_together(out, outdated=files_before(out, REAL_LOG_FILES)) as unfinished:
        real_logs.write_results(result, unfinished)
        real_log_picture(unfinished, result)
    summary = result.summary()
    print(real_logs.table(summary))
    print(f"results and figures: {out}")
    return bool(summary["tracked"] == summary["scans"])


def _relocalized(
    log: Path, reference: Path, out: Path, method: str, protocol: str, jumps: int, seed: int
) -> bool:
    """`real-log` where the start is unknown: whether no wrong place was believed."""
    from experiments import real_relocalization
    from experiments.progress import ScanProgress
    from experiments.real_logs import RealLogConfig

    config = RealLogConfig(method=method)
    with ScanProgress(log.name) as progress:
        result = real_relocalization.run(
            log, reference, protocol, config, jumps, seed, progress.update
        )
    with results_together(out, outdated=files_before(out, REAL_LOG_FILES)) as unfinished:
        real_relocalization.write_results(result, unfinished)
    summary = result.summary()
    print(real_relocalization.table(summary))
    print(f"results: {out}")
    return bool(summary["sure_elsewhere"] == 0)


def localize(
    known_map: Annotated[
        Path, typer.Argument(metavar="MAP", help="A ROS map (.yaml) or map.kitasap.")
    ],
    log: Log,
    start: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y THETA",
            help="Pose at the first scan: x y [m] and heading [rad]; else unknown.",
        ),
    ] = None,
    out: LogOut = RESULTS / "localize",
    method: LogMethod = DEFAULT_METHOD["localize"],
    scan_topic: ScanTopic = None,
    odom_topic: OdomTopic = None,
    mount: Mount = None,
    range_sigma: Annotated[
        float | None,
        typer.Option(
            min=0.001, max=1.0, help="Noise of a range, its standard deviation [m]; default: 0.02."
        ),
    ] = None,
    rerun: Rerun = None,
) -> None:
    """Follows a recorded log on a known map: trajectory, a verdict for each scan, a figure.

    Ends with status 1 where no scan could be followed: the log may be of another place.
    """
    from experiments import localize as localizing
    from experiments.figures import localized_log_picture
    from experiments.known_maps import LogConfig
    from experiments.observer import NO_ONE
    from experiments.progress import ScanProgress
    from experiments.rerun_stream import shown
    from experiments.rerun_views import RerunLog

    T_start, choice = _pose(start), log_choice(scan_topic, odom_topic, mount)
    config = LogConfig(method)
    if range_sigma is not None:
        config = replace(config, range_sigma_m=range_sigma)
    with results_of_one(out, "localize"):
        with (
            shown(rerun, log.name) as stream,
            ScanProgress(log.name) as progress,
            _told_of_compiling(progress),
        ):
            observer = NO_ONE if stream is None else RerunLog(stream)
            result = localizing.run(
                known_map, log, T_start, config, progress.update, choice, observer
            )
        with results_together(out) as unfinished:
            localizing.write_results(result, unfinished)
            localized_log_picture(unfinished, result)
    summary = result.summary()
    _print_notes(result.notes)
    print(localizing.table(summary))
    print(f"results and figures: {out}")
    raise typer.Exit(0 if summary["tracking"] else 1)


def _pose(typed: tuple[float, float, float] | None, option: str = "--start") -> "SE2 | None":
    from slam.se2 import SE2

    if typed is not None and not all(map(math.isfinite, typed)):
        raise ValueError(f"{option} takes three finite numbers, not {typed}")
    if typed is not None and abs(typed[2]) > _TURN_RAD:
        raise ValueError(
            f"{option} takes radians, and {typed[2]:g} is more than a turn: is it degrees?"
        )
    return None if typed is None else SE2(*typed)


def log_choice(
    scan_topic: str | None, odom_topic: str | None, mount: tuple[float, float, float] | None
) -> "LogChoice":
    """What was typed of a log."""
    from slam.readers.log import LogChoice

    pose = _pose(mount, "--mount")
    if pose is not None and math.hypot(pose.x, pose.y) > _MOUNT_M:
        raise ValueError(
            f"--mount takes metres, and {pose.x:g} {pose.y:g} is more than {_MOUNT_M:g} m from the"
            " base that poses are of: is it millimetres?"
        )
    return LogChoice(scan_topic, odom_topic, pose)


def _told_of_compiling(progress: "SlamProgress | ScanProgress") -> AbstractContextManager[None]:
    """Why nothing happens yet is said on a new machine, where kernels are compiled."""
    from slam.compiling import told_of_compiling

    said = "compiling, some 30 s; once per checkout"
    return told_of_compiling(lambda: progress.tell(said))


def _print_notes(notes: tuple[str, ...]) -> None:
    for note in notes:
        print(note)


def slam(
    log: Log,
    out: LogOut = RESULTS / "slam",
    reference: Annotated[
        Path | None, typer.Option(help="Reference poses, TUM format: metrics in summary.json.")
    ] = None,
    relations: Annotated[
        Path | None, typer.Option(help="Official relations (Kuemmerle et al. 2009).")
    ] = None,
    known_map: Annotated[
        Path | None,
        typer.Option(
            "--map", help="A map.kitasap that the log continues, starting anywhere on it."
        ),
    ] = None,
    start: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y THETA",
            help="Pose at the first scan on --map: x y [m], heading [rad]; else searched.",
        ),
    ] = None,
    scan_topic: ScanTopic = None,
    odom_topic: OdomTopic = None,
    mount: Mount = None,
    rerun: Rerun = None,
) -> None:
    """Maps a recorded log: trajectory of every record, ROS map, pose graph, picture, verdict."""
    from experiments import evaluation, slam_files, slam_log, slam_result
    from experiments.figures import slam_map_picture
    from experiments.observer import NO_ONE
    from experiments.progress import SlamProgress
    from experiments.rerun_stream import shown
    from experiments.rerun_views import RerunLog, show_map

    if start is not None and known_map is None:
        raise ValueError("--start is a pose on the map that is continued: give --map as well")
    T_start, choice = _pose(start), log_choice(scan_topic, odom_topic, mount)
    if known_map is not None and known_map.resolve() == (out / "map.kitasap").resolve():
        raise ValueError(f"--out {out} holds the map that is continued: give another folder")
    with results_of_one(out, "slam"), slam_files.OnlinePoses(out) as online:
        with (
            shown(rerun, log.name) as stream,
            SlamProgress(log.name) as progress,
            _told_of_compiling(progress),
        ):
            observer = NO_ONE if stream is None else RerunLog(stream)

            def on_scan(index: int, scans: int, step: "MapperStep") -> None:
                online.add(index, step)
                progress.update(index, scans, step)

            result = slam_log.run(
                log, reference, relations, on_scan, known_map, T_start, choice, observer
            )
            if stream is not None:
                show_map(stream, result, reference)
        outdated = (*slam_files.SOMETIMES, *online.outdated)
        with results_together(out, outdated=outdated) as unfinished:
            online.keep(result.used_pass, unfinished)
            unwritten = slam_files.write_results(result, unfinished)
            slam_map_picture(unfinished, result)
    summary = result.summary()
    _print_notes(result.notes)
    print(slam_result.table(summary))
    if result.evaluation is not None:
        print(evaluation.table(result.evaluation.summary(), log.name))
    if unwritten:
        print(unwritten)
    print(f"results and figures: {out}")
    raise typer.Exit(0 if result.slam_map.verdict.is_good and not unwritten else 1)

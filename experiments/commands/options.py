"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

Poses = Annotated[
    str,
    typer.Option(
        help="paper: one pair of poses; random: drawn in the free space;"
        " anywhere: kidnapped to anywhere."
    ),
]
_PLACES = "room_fig4, place_fig6, round_room or symmetric_room, or the path of an MJCF file"
PlaceName = Annotated[str, typer.Option(help=f"{_PLACES}.")]
TrialPlace = Annotated[
    str | None,
    typer.Option(
        "--place",
        help=f"{_PLACES}; default: room_fig4, of mapping place_fig6.",
    ),
]
Laser = Annotated[
    str,
    typer.Option(
        help="The laser range sensor carried: urg_04lx, utm_30lx, ust_10lx, lms200, lms1xx, tim571,"
        " rplidar_a1, rplidar_a2 or ld06; or one with changes, as urg_04lx:beams=181:range_noise=2."
    ),
]
Odometry = Annotated[str, typer.Option(help="ideal, as_built or rough_floor.")]
Methods = Annotated[
    str | None,
    typer.Option(
        "--method",
        help="Methods, by commas; default: paper,open3d,limit; of mapping paper,limit.",
    ),
]
People = Annotated[int, typer.Option(min=0, help="People who walk about.")]
TrialPeople = Annotated[
    int | None,
    typer.Option(
        "--people",
        min=0,
        help="People who walk about; default: 0; of mapping 3, in every second trial.",
    ),
]
Mismatch = Annotated[
    str, typer.Option(help="What is not as assumed: none, noisy, quiet, offset, mount or chair.")
]
KnownMap = Annotated[
    str,
    typer.Option(
        "--map", help="true: the map is exact; made: the robot made it itself on a drive before."
    ),
]
TurnRate = Annotated[float | None, typer.Option(help="Of tracking [rad/s]; default: 0.5.")]
Duration = Annotated[float | None, typer.Option(help="Of each drive of tracking [s]; default: 30.")]
Seed = Annotated[int, typer.Option(min=0, help="Master seed of all random numbers.")]
Out = Annotated[Path, typer.Option(help="Folder of the results, one subfolder per experiment.")]
Jobs = Annotated[int | None, typer.Option(min=1, help="Processes; default: one per core.")]
Trials = Annotated[int, typer.Option(min=1, help="How many.")]
ShardPart = Annotated[
    str | None,
    typer.Option(
        metavar="I/N",
        help="Every N-th trial alone, from the I-th on; `kitasap merge` puts the parts together.",
    ),
]
EngineName = Annotated[
    str, typer.Option(help="Where trials are done: local (processes here), serial, or ray.")
]
EngineAddress = Annotated[
    str | None,
    typer.Option("--address", help="Of the Ray cluster; default: one is started on this machine."),
]
TrialLimit = Annotated[
    float | None,
    typer.Option(help="A trial that takes longer is stopped, and has failed [s]; default: none."),
]
Again = Annotated[
    bool, typer.Option("--retry-failed", help="Trials that raised or were stopped are done again.")
]

Log = Annotated[Path, typer.Argument(help="A recorded log, gz or plain, or a ROS bag.")]
ScanTopic = Annotated[
    str | None, typer.Option(help="Of a ROS bag, its LaserScan topic; default: told by its type.")
]
OdomTopic = Annotated[
    str | None,
    typer.Option(
        help="Of a ROS bag, its Odometry topic, or /tf; default: told by its type, else /tf."
    ),
]
Mount = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        metavar="X Y THETA",
        help="Of the laser on the robot: x y [m] and heading [rad]; default: as the log has it.",
    ),
]
Rerun = Annotated[
    str | None,
    typer.Option(
        metavar="[FILE.rrd]",
        help="Stream scans, map, poses and verdicts to a Rerun viewer, or into a file (extra rerun).",
    ),
]
LogOut = Annotated[Path, typer.Option(help="Folder of the results.")]
LogMethod = Annotated[str, typer.Option(help="open3d, fast or limit.")]

RESULTS = Path("results")
PAPER_TRIALS = 100
"""Section 4.1: "We conducted each experiment 100 times"."""

_NO_VIEWER_FILE = "--rerun="
"""--rerun without a file, for Typer, which knows no option that may have a value."""


def check_words(arguments: list[str]) -> None:
    """Raises ValueError for an argument that is empty: as a path it would be the current folder."""
    for before, word in zip(["", *arguments], arguments, strict=False):
        if word == "--":
            return
        is_unset = word.startswith("--") and word.endswith("=") and word != _NO_VIEWER_FILE
        if not word or is_unset:
            of = word[:-1] or (before if before.startswith("--") else "an argument")
            raise ValueError(f"{of} is empty: is a variable of the shell not set?")


def viewer_told(arguments: list[str]) -> list[str]:
    """The arguments, with an empty value where --rerun has none: Typer knows no option that may."""
    told = list(arguments)
    for at, (word, following) in enumerate(zip(arguments, [*arguments[1:], ""], strict=False)):
        if word == "--":
            break
        if word == "--rerun" and not following.endswith(".rrd"):
            told[at] = _NO_VIEWER_FILE
    return told

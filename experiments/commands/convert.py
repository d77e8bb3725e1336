"""The command on files of other programs: `kitasap convert`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import Mount, OdomTopic, ScanTopic


def convert(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="IN", help="A log or ROS bag, .tum, .kitti, map.kitasap, map.yaml or .g2o."
        ),
    ],
    target: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="Of a log .clf, .clf.gz, .mcap, and of its odometry .tum, .kitti; of a trajectory"
            " .tum, .kitti; of a map .ply, .pcd, .pgm, .png, .yaml, .g2o, .tum, .kitti.",
        ),
    ],
    topic: Annotated[
        str | None, typer.Option(help="Of a ROS bag, the poses of this topic, as .tum or .kitti.")
    ] = None,
    scan_topic: ScanTopic = None,
    odom_topic: OdomTopic = None,
    mount: Mount = None,
) -> None:
    """Turns a log, a trajectory or a map into a file of another program, by the ends of the names."""
    from experiments import convert as converting
    from experiments.commands.logs import log_choice

    print(converting.convert(source, target, topic, log_choice(scan_topic, odom_topic, mount)))

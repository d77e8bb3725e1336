"""The command `kitasap view`."""

from typing import Annotated

import typer

from experiments.commands.options import Laser, Odometry, People, Seed


def view(
    place: Annotated[str, typer.Argument(help="A place by name, or an MJCF file.")] = "room_fig4",
    laser: Laser = "urg_04lx",
    odometry: Odometry = "as_built",
    people: People = 0,
    seed: Seed = 0,
    browser: Annotated[
        bool, typer.Option("--browser", help="In the browser, though there is a display.")
    ] = False,
    port: Annotated[
        int,
        typer.Option(min=0, max=65535, help="Of the browser's page; 0: the first free from 8080."),
    ] = 0,
) -> None:
    """Drives the robot by hand while it finds itself, in MuJoCo's own viewer.

    In a window; without a display, and on macOS, in the browser, at an address that this machine
    alone can open (from afar: ssh -L 8080:localhost:8080). Arrow keys drive: in the browser as long
    as they are held, in the window each press adds some speed, and Enter stops. K kidnaps. Drawn
    are beams, scan and pose estimated (flag), with the verdict. Ctrl-C ends it.
    """
    from experiments.view import ViewConfig
    from experiments.view import view as show

    show(ViewConfig(place, laser, odometry, people, seed), in_browser=browser, port=port)

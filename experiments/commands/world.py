"""The commands that make places: `kitasap world from-map`, `from-plan` and `from-houseexpo`."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from experiments.outputs import checked_file
from experiments.plan_example import EXAMPLE

if TYPE_CHECKING:
    from kitasap_sim.built_places import Block, Pillar
    from kitasap_sim.places import Place
    from slam.se2 import SE2

app = typer.Typer(
    help="Makes places for the simulated robot: of a ROS map, a floor plan or a HouseExpo house.",
    rich_markup_mode=None,
)

PlaceOut = Annotated[Path, typer.Option(help="The MJCF file to write, for --place.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Also if --out is there already.")]
Height = Annotated[float, typer.Option(help="Of the walls [m].")]
Start = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        help="Where the robot starts: x y [m] and heading [rad]; else where most room is."
    ),
]

_WALL_HEIGHT_M = 0.8
"""As of the places that come with the project: above every laser, and cameras look in."""
_LEAST_HEIGHT_M, _HIGHEST_M = 0.5, 10.0

_PLAN_HELP = """Makes a place of a floor plan, a YAML file; lengths in metres, angles in degrees:

\b
{example}
"""


def from_map(
    ros_map: Annotated[Path, typer.Argument(metavar="MAP", help="A ROS map: its YAML file.")],
    out: PlaceOut,
    height: Height = _WALL_HEIGHT_M,
    speck: Annotated[
        int | None,
        typer.Option(min=0, help="Islands of so many cells are taken away; default: 2."),
    ] = None,
    start: Start = None,
    overwrite: Overwrite = False,
) -> None:
    """Makes a place of a ROS map (map_server): all that is not known to be free is solid.

    Unknown cells are walls, the free space is what is connected with the start, in the map's frame.
    """
    _check(out, overwrite, height)
    from experiments.map_worlds import DEFAULT_SPECK_CELLS, map_world

    speck_cells = DEFAULT_SPECK_CELLS if speck is None else speck
    world = map_world(ros_map, height, speck_cells, _pose(start))
    _write(out, world.mjcf)
    rows, columns = world.solid.shape
    print(
        f"{columns} x {rows} cells of {world.resolution_m:g} m: {world.boxes} boxes,"
        f" {world.free_m2:.0f} m2 free"
    )
    print(
        f"taken away: {world.specks} specks of up to {speck_cells} cells;"
        f" filled: {world.pockets} parts that no way leads to"
    )
    x, y, heading = world.start.as_array()
    print(f"start: {x:.2f} {y:.2f} {heading:.2f}")
    print(f"place: {out}")


def from_plan(
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="A floor plan: a YAML file.")],
    out: PlaceOut,
    overwrite: Overwrite = False,
) -> None:
    """Makes a place of a floor plan: the help shows one."""
    _check(out, overwrite)
    from experiments.plan_files import read_plan

    floor_plan = read_plan(plan)
    _write_solids(out, plan, floor_plan.solids(), floor_plan.start, "an entry start in it")


def from_houseexpo(
    house: Annotated[Path, typer.Argument(metavar="HOUSE", help="A JSON file of HouseExpo.")],
    out: PlaceOut,
    height: Height = _WALL_HEIGHT_M,
    start: Start = None,
    overwrite: Overwrite = False,
) -> None:
    """Makes a place of a house of HouseExpo, of your own copy of the data set."""
    _check(out, overwrite, height)
    from experiments.house_files import read_house

    T_start = _pose(start)
    found = read_house(house)
    try:
        blocks = found.blocks(height)
    except ValueError as error:
        raise ValueError(f"{house}: {error}") from None
    at = None if T_start is None else (T_start.x, T_start.y, T_start.theta)
    _write_solids(out, house, blocks, at, "--start X Y HEADING")
    if found.rooms is not None:
        print(f"{house.stem}: {found.rooms} rooms")


app.command("from-map")(from_map)
app.command("from-plan", help=_PLAN_HELP.format(example=EXAMPLE))(from_plan)
app.command("from-houseexpo")(from_houseexpo)


def _write_solids(
    out: Path,
    source: Path,
    solids: "Sequence[Block | Pillar]",
    start: tuple[float, float, float] | None,
    told_by: str,
) -> None:
    """Writes the place that solids make, if the robot can stand in it. told_by: what tells a start."""
    import mujoco

    from kitasap_sim.built_places import place_mjcf
    from kitasap_sim.free_space import NoRoomError
    from kitasap_sim.places import Place
    from kitasap_sim.robot import KITASAP2

    made = f"Made of {source.name}."
    try:
        mjcf = place_mjcf(source.stem, made, solids, start)
        place = Place.of_mjcf(mujoco.MjSpec.from_string(mjcf), out.stem)
        if start is not None:
            _check_start(place, start)
        free_m2 = len(place.free_centres_m) * place.free_cell_m**2
        x, y, heading = place.start.tolist()
    except NoRoomError:
        raise ValueError(
            f"{source}: nowhere within its walls are {KITASAP2.radius_m} m of room around the"
            f" robot: are they closed? Or tell where it starts, by {told_by}"
        ) from None
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None
    _write(out, place_mjcf(source.stem, made, solids, (x, y, heading)))
    print(f"{len(solids)} solids, {free_m2:.1f} m2 for the robot's middle")
    print(f"start: {x:.2f} {y:.2f} {heading:.2f}")
    print(f"place: {out}")


def _check_start(place: "Place", start: tuple[float, float, float]) -> None:
    """Raises ValueError for a start that lies outside of all walls: there is nothing but room."""
    (left, low), (right, high) = place.solid_bounds_m
    if not (left < start[0] < right and low < start[1] < high):
        raise ValueError(
            f"its start ({start[0]:.2f}, {start[1]:.2f}) lies outside of all walls,"
            f" which are in x from {left:.2f} to {right:.2f}, in y from {low:.2f} to {high:.2f}"
        )


def _check(out: Path, overwrite: bool, height_m: float = _WALL_HEIGHT_M) -> None:
    """Raises ValueError or OSError for what can be refused before anything is read."""
    if checked_file(out).suffix.lower() != ".xml":
        raise ValueError(f"--out takes an MJCF file, and {out} does not end in .xml")
    if out.exists() and not overwrite:
        raise ValueError(f"--out {out} is there already: give another name, or --overwrite")
    if not _LEAST_HEIGHT_M <= height_m <= _HIGHEST_M:
        raise ValueError(
            f"--height takes {_LEAST_HEIGHT_M:g} m, above every laser, to {_HIGHEST_M:g} m,"
            f" not {height_m:g}"
        )


def _pose(start: tuple[float, float, float] | None) -> "SE2 | None":
    from slam.se2 import SE2

    if start is not None and not all(map(math.isfinite, start)):
        raise ValueError(f"--start takes three finite numbers, not {start}")
    return None if start is None else SE2(*start)


def _write(out: Path, mjcf: str) -> None:
    from experiments.trial_log import write_atomically

    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(out, mjcf)

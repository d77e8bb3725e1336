"""The files of places: those that come with the project, and one's own."""

from importlib.resources import files
from pathlib import Path

_FOLDER = files("models") / "places"
_ENDINGS = (".xml", ".urdf", ".mjz", ".zip")
"""What MuJoCo reads; of others it complains on a line of its own."""

_MADE_BY = {
    ".yaml": "from-map (or from-plan)",
    ".yml": "from-map (or from-plan)",
    ".json": "from-houseexpo",
}
"""What makes a place of a file that is none."""


def place_names() -> list[str]:
    """The names of the places that come with the project."""
    return sorted(Path(str(entry)).stem for entry in _FOLDER.iterdir() if entry.name[-4:] == ".xml")


def shipped_path(name: str) -> Path | None:
    """The file of a place that comes with the project, by its name; None for any other."""
    return Path(str(_FOLDER / f"{name}.xml")) if name in place_names() else None


def place_path(name: str) -> Path:
    """The file of a place by name, or by path. Raises ValueError, naming those there are, if there
    is none."""
    shipped = shipped_path(name)
    if shipped is not None:
        return shipped
    path = Path(name)
    if path.is_file():
        end = path.suffix.lower()
        if end in _MADE_BY:
            raise ValueError(
                f"place {name} is not a valid MJCF file: such end in .xml, and `kitasap world"
                f" {_MADE_BY[end]}` makes one of a {end}"
            )
        if end not in _ENDINGS:
            raise ValueError(f"place {name} is not a valid MJCF file: such end in .xml")
        return path
    raise ValueError(f"no place called '{name}', nor a file; there are: {', '.join(place_names())}")

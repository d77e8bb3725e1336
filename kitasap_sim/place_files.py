"""The files of places: those that come with the project, and one's own."""

from importlib.resources import files
from pathlib import Path

_FOLDER = files("models") / "places"
_ENDINGS = (".xml", ".urdf", ".mjz", ".zip")
"""What MuJoCo reads; of others it complains on a line of its own."""


def place_names() -> list[str]:
    """The names of the places that come with the project."""
    return sorted(Path(str(entry)).stem for entry in _FOLDER.iterdir() if entry.name[-4:] == ".xml")


def place_path(name: str) -> Path:
    """The file of a place by name, or by path. Raises ValueError, naming those there are, if there
    is none."""
    if name in place_names():
        return Path(str(_FOLDER / f"{name}.xml"))
    path = Path(name)
    if path.is_file():
        if path.suffix.lower() not in _ENDINGS:
            raise ValueError(f"place {name} is not a valid MJCF file: such end in .xml")
        return path
    raise ValueError(f"no place called '{name}', nor a file; there are: {', '.join(place_names())}")

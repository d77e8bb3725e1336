"""Files of places, read and compiled; what a stranger's asks is tried in a process of its own first.

An MJCF file of a few lines can ask for a billion bodies, terabytes of texture or a file without end.
MuJoCo then takes all memory there is, or falls, and Python with it.
"""

import json
import logging
import re
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import mujoco

from kitasap_sim.place_files import shipped_path

_MOST_ELEMENTS = 50_000
"""Chosen: ten times an office building. MuJoCo's time to read them grows with their square."""
_MOST_BYTES = 20_000_000
"""Chosen: MuJoCo takes 20 times as much memory; an office building has 300 kB."""
_MEMORY_MB, _CPU_S, _WALL_S = 300, 10, 60
"""Chosen: the place, the world made of it and its picture take as much each, and with Python itself
less than a gigabyte."""

_PLAIN = frozenset(
    {"mujoco", "compiler", "option", "flag", "visual", "global", "quality", "headlight", "map"}
    | {"scale", "rgba", "statistic", "default", "asset", "material", "worldbody", "body", "frame"}
    | {"geom", "site", "light", "camera", "inertial", "texture"}
)
"""Elements that make no more than themselves, if no file and no larger texture is asked for."""
_ELEMENT = re.compile(r"<\s*([A-Za-z_][\w.:-]*)")
_DOCTYPE = re.compile(r"<!\s*(?:DOCTYPE|ENTITY)", re.IGNORECASE)
_ASKS_FOR_MORE = re.compile(
    r"\bfile\w*\s*=|\bnan\b|\b(?:width|height|gridsize)\s*=\s*[\"'][^\"']{4}", re.IGNORECASE
)
"""Another file, a side of 1000 pixels and more, and what MuJoCo warns of on a line of its own."""
_MOST_TEXTURES = 20

_TRIED = """
import json, sys
try:
    import resource
    resource.setrlimit(resource.RLIMIT_CPU, (int(sys.argv[3]), int(sys.argv[3])))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
except ImportError:
    resource = None  # Windows has none
import mujoco
if resource:
    limit = int(sys.argv[2]) << 20
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
try:
    said = "is not a valid MJCF file"
    spec = mujoco.MjSpec.from_file(sys.argv[1])
    said = "does not compile"
    spec.compile()
    print(json.dumps({}))
except ValueError as error:
    print(json.dumps({"error": said + ": " + " ".join(str(error).split())}))
"""


def read_place(path: Path, name: str) -> mujoco.MjSpec:
    """The world that a file describes. Raises ValueError, in one line, if it cannot be used; OSError
    when it cannot be opened."""
    _log_warnings()
    if path != shipped_path(name):
        _check_file(path, name)
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise ValueError(f"place {name} is not a valid MJCF file: {_one_line(error)}") from None


def compiled_place(spec: mujoco.MjSpec, name: str) -> mujoco.MjModel:
    """The model of a world. Raises ValueError, in one line, if it does not compile."""
    try:
        model = spec.compile()
    except ValueError as error:
        raise ValueError(f"place {name} does not compile: {_one_line(error)}") from None
    _check_count(model.ngeom + model.nsite + model.nbody, name)
    return model


def _log_warnings() -> None:
    """MuJoCo's warnings go to Python's log: else they make a file wherever it runs."""
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(logging.getLogger(__name__).warning)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _check_file(path: Path, name: str) -> None:
    """Raises ValueError, in one line, for a file that MuJoCo cannot read within 300 MB and 10 s, or
    is not to read at all.

    What asks for nothing that its size does not show is not tried out. OSError when it cannot be
    opened.
    """
    state = path.stat()
    if state.st_size > _MOST_BYTES:
        raise ValueError(
            f"place {name} is longer than the {_MOST_BYTES / 1e6:g} MB that are read of a place"
        )
    if path.suffix.lower() == ".xml":
        text = path.read_text(encoding="utf-8", errors="replace")
        if _DOCTYPE.search(text):
            raise ValueError(f"place {name} has a DOCTYPE or an entity, which no MJCF file needs")
        elements = _ELEMENT.findall(text)
        _check_count(len(elements), name)
        is_plain = _PLAIN.issuperset(elements) and elements.count("texture") <= _MOST_TEXTURES
        if is_plain and _ASKS_FOR_MORE.search(text) is None:
            return
    reason = _tried(path.resolve(), state.st_mtime_ns)
    if reason:
        raise ValueError(f"place {name} {reason}")


def _check_count(count: int, name: str) -> None:
    if count > _MOST_ELEMENTS:
        raise ValueError(f"place {name} has {count} elements; {_MOST_ELEMENTS} are the most")


@cache
def _tried(path: Path, _changed_ns: int) -> str:
    """What MuJoCo says against a file, once for each of its states; nothing if it reads it."""
    too_much = f"takes MuJoCo more than {_MEMORY_MB} MB or {_CPU_S} s, or makes it fail"
    command = [sys.executable, "-c", _TRIED, str(path), str(_MEMORY_MB), str(_CPU_S)]
    # MuJoCo keeps a log where it runs
    with tempfile.TemporaryDirectory() as folder:
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, timeout=_WALL_S, check=False,
                encoding="utf-8", errors="replace", stdin=subprocess.DEVNULL,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return too_much
    lines = done.stdout.splitlines()
    if done.returncode != 0 or not lines:
        return too_much
    if "XML contains a 'NaN'" in done.stderr:
        return "has a nan in place of a number"
    return str(json.loads(lines[-1]).get("error", ""))

"""What is installed, what is missing, and the line that mends it: `kitasap doctor`.

Whatever might fail is tried in a process of its own: a library that is broken may end the process
that imports it. Nothing heavy is imported here.
"""

import os
import platform
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

from experiments.provenance import commit

OK, MISSING, BROKEN = "ok", "missing", "BROKEN"
_OPENGL_ASKED = "MUJOCO_GL"
"""The variable by which MuJoCo is told how to draw; it loads what that names when it is imported."""
_PROJECT = Path(__file__).parents[1]
_MODULES = {
    "pillow": "PIL",
    "pyyaml": "yaml",
    "rerun-sdk": "rerun",
    "open3d-cpu": "open3d",
    "stable-baselines3": "stable_baselines3",
    "scipy-stubs": "",
}
"""What is imported of a distribution that is called otherwise; of stubs, nothing."""
_LIMIT_S = 120.0
"""Chosen: the first import on a slow disk takes long; one that hangs is told, not waited for."""


@dataclass(frozen=True)
class Check:
    """One thing that was looked at. found: in words; mend: the line that puts it right; is_core:
    nothing works without it."""

    part: str
    name: str
    state: str
    found: str
    mend: str = ""
    is_core: bool = False

    @property
    def is_well(self) -> bool:
        """Whether the core works, as far as this goes."""
        return self.state == OK or not self.is_core


@dataclass(frozen=True)
class _Requirement:
    """A line of the dependencies, without its marker. extra: which it belongs to, or none."""

    name: str
    line: str
    extra: str | None


def examined() -> list[Check]:
    """Everything looked at, in the order in which it is told. Raises nothing."""
    looks: tuple[list[Callable[[], Check]], ...] = (
        [_python, *(partial(_library, one) for one in _requirements() if one.extra is None)],
        [*(partial(_tried, *one) for one in _TRIALS), _rendering, _compiled_code],
        [_machine, *(partial(_extra, name, lines) for name, lines in _extras().items())],
    )
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        running = [[pool.submit(look) for look in some] for some in looks]
        libraries, tried, rest = ([one.result() for one in some] for some in running)
    if not all(check.is_well for check in libraries):  # what stands on them may well be sound
        tried = [replace(check, mend="the lines above, first") for check in tried]
    return [*libraries, *tried, *rest]


def told(checks: list[Check]) -> str:
    """The checks as text for a terminal."""
    lines = []
    for part in dict.fromkeys(check.part for check in checks):
        lines.append(part)
        for check in (one for one in checks if one.part == part):
            lines.append(f"  {check.state:8}{check.name:18} {check.found}".rstrip())
            if check.mend and check.state != OK:
                lines.append(f"  {'':8}mend it with: {check.mend}")
    wrong = sum(not check.is_well for check in checks)
    lines.append(
        "the core works" if not wrong else f"the core does not work: {wrong} to mend, see above"
    )
    return "\n".join(lines)


def _python() -> Check:
    is_new = sys.version_info >= (3, 11)
    mine = _version("kitasap") or "from its folder, not installed"
    where = f"commit {known[:12]}, " if (known := commit()) else ""
    found = f"{mine}, {where}Python {platform.python_version()}, {platform.platform(terse=True)}"
    return Check(
        "core", "kitasap", OK if is_new else BROKEN, found, "install Python 3.11 or newer", True
    )


def _library(one: _Requirement) -> Check:
    """One that the core needs."""
    module = _MODULES.get(one.name, one.name.replace("-", "_"))
    mend = f"pip install '{one.line}'"
    found = _version(one.name)
    if found is None:
        return Check("core", one.name, MISSING, "", mend, True)
    if module == "open3d":  # by the way that finds its system libraries, below
        return Check("core", one.name, OK, found, mend, True)
    status, said = _in_process(f"import {module}") if module else (0, "")
    if status != 0:
        return Check(
            "core", one.name, BROKEN, f"{found}: {said}", f"{mend} --force-reinstall", True
        )
    if not _satisfies(found, one.line):
        return Check("core", one.name, BROKEN, f"{found} is not {one.line}", mend, True)
    return Check("core", one.name, OK, found, mend, True)


_TRIALS = (
    (
        "Open3D's ICP",
        "import numpy as np\n"
        "from slam.open3d_backend import best_pose_open3d\n"
        "points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]])\n"
        "assert abs(best_pose_open3d(points, points + 0.5).x - 0.5) < 1e-9\n"
        "import ctypes.util\n"
        "usb = ctypes.util.find_library('usb-1.0')\n"
        "print('it fits a pose; libusb-1.0:', usb or 'the copy in libusb-package')",
        "sudo apt-get install libgl1 libegl1 libx11-6 libgomp1 libusb-1.0-0",
    ),
    (
        "robot and laser",
        "import numpy as np\n"
        "from kitasap_sim.simulation import Simulation\n"
        "frame = Simulation('room_fig4', rng=np.random.default_rng(0)).next_frame()\n"
        "seen = int(np.isfinite(frame.ranges_m).sum())\n"
        "assert seen > 100\n"
        "print(f'a scan of {len(frame.ranges_m)} beams, {seen} return')",
        "pip install --force-reinstall mujoco",
    ),
)
"""What the core is for: name, code that tries it, and what mends it."""


def _tried(name: str, code: str, mend: str) -> Check:
    status, said = _in_process(code)
    # the message of a missing system library names its package
    named = re.search(r"(?:sudo )?apt-get install [^\s,;]+|pip install [^\s,;]+", said)
    return Check(
        "core", name, OK if status == 0 else BROKEN, said, named[0] if named else mend, True
    )


def _rendering() -> Check:
    code = "from kitasap_sim.rendering import check_rendering\nprint(check_rendering())"
    asked = os.environ.get(_OPENGL_ASKED)
    status, said = _in_process(code, as_asked=True)
    if status == 0:
        words = said + (f", as {_OPENGL_ASKED}={asked} asks" if asked else "")
        return Check("pictures", "OpenGL", OK, words)
    if asked and _in_process("import mujoco", as_asked=True)[0] != 0:
        words = f"MuJoCo cannot be loaded with {_OPENGL_ASKED}={asked}: {said}"
        return Check("pictures", "OpenGL", BROKEN, words, f"unset {_OPENGL_ASKED}", True)
    mend = "sudo apt-get install libegl1 libgl1"
    if asked:
        mend = f"unset {_OPENGL_ASKED}"
    elif os.environ.get("DISPLAY"):
        mend = f"{_OPENGL_ASKED}=egl kitasap ..., where the display cannot be drawn on"
    return Check("pictures", "OpenGL", MISSING, said.partition("RenderingError: ")[2] or said, mend)


def _compiled_code() -> Check:
    code = (
        "from slam.kernels.facings import facings_into\n"
        "import os\n"
        "path = getattr(facings_into._cache, 'cache_path', None)\n"
        "print(path or '')"
    )
    status, said = _in_process(code)
    name, mend = "compiled code", "export NUMBA_CACHE_DIR=DIR, a folder that can be written"
    if status != 0:
        return Check("machine", name, BROKEN, said, mend)
    if not said:
        words = "cannot be kept: each process compiles anew, some 30 s"
        return Check("machine", name, MISSING, words, mend)
    return Check("machine", name, OK, f"kept in {said}")


def _machine() -> Check:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return Check("machine", "cores, memory", OK, f"{cores}, {_memory()}")


def _memory() -> str:
    """In words; what a container may have, where that is less than the machine's."""
    try:
        total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return "unknown"
    try:
        limit = Path("/sys/fs/cgroup/memory.max").read_text().strip()
        total = min(total, int(limit)) if limit.isdigit() else total
    except OSError:
        pass  # not in a container, or not on Linux: the machine's it is
    return f"{total / 2**30:.1f} GiB"


def _extra(name: str, lines: list[_Requirement]) -> Check:
    found, lacking = [], []
    for one in lines:
        if (known := _version(one.name)) is None:
            lacking.append(one.name)
        else:
            found.append(f"{one.name} {known}")
    mend = f"pip install 'kitasap[{name}]'"
    if _project() is not None:
        mend = f"pip install -e '{_PROJECT}[{name}]'"
    if lacking:
        return Check("extras, all optional", name, MISSING, f"lacks {', '.join(lacking)}", mend)
    return Check("extras, all optional", name, OK, ", ".join(found), mend)


def _version(distribution: str) -> str | None:
    """What is installed; None where it is not, or what is left of it says nothing."""
    try:
        return version(distribution)
    except (PackageNotFoundError, KeyError, TypeError, ValueError, OSError):
        return None


def _extras() -> dict[str, list[_Requirement]]:
    extras: dict[str, list[_Requirement]] = {}
    for one in _requirements():
        if one.extra is not None:
            extras.setdefault(one.extra, []).append(one)
    return extras


def _requirements() -> Iterator[_Requirement]:
    """Those that apply here: of the clone that runs, or else of what is installed."""
    project = _project()
    if project is None:
        lines = [_of_extra(line) for line in _installed()]
    else:
        lines = [(line, None) for line in project.get("dependencies", ())]
        for extra, more in project.get("optional-dependencies", {}).items():
            lines += [(line, extra) for line in more]
    for line, extra in lines:
        text, _, marker = line.partition(";")
        name = re.match(r"[A-Za-z0-9._-]+", text.strip())
        if name is not None and _applies(marker.strip()):
            yield _Requirement(name[0].lower(), text.strip(), extra)


def _project() -> dict[str, Any] | None:
    """What the `pyproject.toml` of the clone that runs says of it; None where none does."""
    try:
        text = (_PROJECT / "pyproject.toml").read_text(encoding="utf-8")
        project: dict[str, Any] = tomllib.loads(text)["project"]
    except (OSError, KeyError, ValueError):
        return None
    return project if project.get("name") == "kitasap" else None


def _installed() -> list[str]:
    try:
        return requires("kitasap") or []
    except PackageNotFoundError:
        return []


def _of_extra(line: str) -> tuple[str, str | None]:
    """A requirement as it is installed: without the extra that its marker names, and that."""
    extra = re.search(r"""\s*(?:and\s+)?extra\s*==\s*['"]([^'"]+)['"]""", line)
    if extra is None:
        return line, None
    return line.replace(extra[0], "").rstrip("; "), extra[1]


def _applies(marker: str) -> bool:
    if not marker:
        return True
    try:
        from packaging.markers import Marker

        return Marker(marker).evaluate()
    except (ImportError, ValueError):
        return True  # nothing here can tell: what is looked for in vain says so itself


def _satisfies(found: str, line: str) -> bool:
    try:
        from packaging.requirements import Requirement

        return Requirement(line).specifier.contains(found, prereleases=True)
    except (ImportError, ValueError):
        return True


def _in_process(code: str, as_asked: bool = False) -> tuple[int, str]:
    """How a process ended that ran some code, and the last line that it said. as_asked: with the
    OpenGL that the environment asks for, without which MuJoCo may not load; otherwise with any."""
    surroundings = {k: v for k, v in os.environ.items() if as_asked or k != _OPENGL_ASKED}
    path = os.pathsep.join(filter(None, (str(_PROJECT), os.environ.get("PYTHONPATH"))))
    try:
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, errors="replace",
            timeout=_LIMIT_S, check=False, env=surroundings | {"PYTHONPATH": path},
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return 1, f"did not end within {_LIMIT_S:.0f} s"
    except OSError as error:
        return 1, str(error)
    said = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines()
    if done.returncode < 0 and not said:
        return done.returncode, f"ended by signal {-done.returncode}"
    return done.returncode, said[-1] if said else ""

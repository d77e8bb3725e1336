"""Where results come from: versions, commit and command line, for `config.json`."""

import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_PACKAGES = ("kitasap", "mujoco", "numpy", "scipy", "open3d", "open3d-cpu", "numba")


def versions() -> dict[str, str]:
    """Versions of this project and of the libraries that its figures depend on."""
    found = {"python": ".".join(map(str, sys.version_info[:3]))}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue  # open3d or open3d-cpu, whichever this platform has
    return found


def commit() -> str | None:
    """The commit of the sources that run, "+" behind it if they differ; None outside git."""
    folder = Path(__file__).parent
    try:
        # installed below somebody else's repository, this file is none of its own
        _git(folder, "ls-files", "--error-unmatch", Path(__file__).name)
        head = _git(folder, "rev-parse", "HEAD")
        changed = _git(folder, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.CalledProcessError):
        return None
    return head + ("+" if changed else "")


def _git(folder: Path, *words: str) -> str:
    done = subprocess.run(["git", *words], cwd=folder, check=True, capture_output=True, text=True)
    return done.stdout.strip()

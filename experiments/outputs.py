"""Where results are written: refused before the work, not after it."""

import errno
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from experiments.trial_log import locked

_UNFINISHED = ".kitasap-unfinished"
"""Folder among results for those that are not all written yet."""
_SUFFIXES = {
    *(".json", ".jsonl", ".tum", ".kitasap", ".ply", ".g2o"),
    *(".yaml", ".pgm", ".png", ".svg"),
}
"""Of files of results."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def checked_folder(folder: Path) -> Path:
    """The folder, if files can be written into it, or it can be made.

    Raises ValueError for a file, OSError, naming the folder, where nothing can be written.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"--out takes a folder, and {folder} is a file")
    _check_writable(folder, folder)
    return folder


def checked_beside_runs(folder: Path) -> Path:
    """`checked_folder`, of what is no run of trials: it is not to be written over one.

    Raises ValueError for a folder that holds trials as well.
    """
    if (folder / "trials.jsonl").exists():
        raise ValueError(f"--out {folder} holds the trials of a run: give another folder")
    return checked_folder(folder)


@contextmanager
def results_of_one(folder: Path, *experiments: str) -> Iterator[None]:
    """Keeps other commands out of a folder while one works for it, and takes away what one that was
    killed had not finished. A folder made for it that stays empty is not left behind.

    experiments: as summary.json calls those whose results may be written over.
    Raises ValueError for a folder of trials, or of other results, for a file, or if another command is
    at work there; OSError, naming it, where nothing can be written, or a folder is in the place of a file.
    """
    _check_results(folder, experiments)
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    with locked(folder):
        try:
            # once more: another command may have ended there before this one had the lock
            _check_results(folder, experiments)
            _remove_unfinished(folder)
            with naming(folder):
                yield
        finally:  # still locked: else another command may be at work there by now
            for path in made:
                if not path.is_dir() or any(path.iterdir()):
                    break
                path.rmdir()


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Says where, if the disk is full, or takes no file as large: what is written says so without a
    name."""
    try:
        yield
    except OSError as error:
        if error.errno in _FULL and error.filename is None:
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def _check_results(folder: Path, experiments: tuple[str, ...]) -> None:
    checked_beside_runs(folder)
    # told now: once all is done, nothing could be written
    for path in folder.iterdir() if folder.is_dir() else ():
        if path.suffix in _SUFFIXES:
            check_is_no_folder(path)
    if (folder / "summary.json").exists():
        there = _experiment_of(folder)
        if there not in experiments:
            what = "a summary.json that is none of ours" if there is None else f"results of {there}"
            raise ValueError(f"--out {folder} holds {what}: give another folder")


@contextmanager
def results_together(folder: Path, *, outdated: tuple[str, ...] = ()) -> Iterator[Path]:
    """A folder to write results into; once all are written they take the place of those before, with
    summary.json gone first and back last: without it, a folder of results is not finished.

    outdated: files of results before that are removed where there is no new one.
    Raises OSError if it cannot, for a folder in the place of a file as well; what was there before is
    left as it was by anything raised within.
    """
    _remove_unfinished(folder)
    unfinished = folder / _UNFINISHED
    unfinished.mkdir(parents=True)
    try:
        yield unfinished
        written = sorted(
            unfinished.iterdir(), key=lambda path: (path.name == "summary.json", path.name)
        )
        gone = sorted({*outdated} - {path.name for path in written} - {"summary.json"})
        for name in (*(path.name for path in written), *gone):
            check_is_no_folder(folder / name)
        for name in ("summary.json", *gone):
            (folder / name).unlink(missing_ok=True)
        for path in written:
            path.replace(folder / path.name)
    finally:
        _remove_unfinished(folder)


def check_is_no_folder(path: Path) -> None:
    """Raises OSError for a folder in the place of a file of results."""
    if path.is_dir():
        said = "a folder where a file is to be written"
        raise IsADirectoryError(errno.EISDIR, said, str(path))


def _remove_unfinished(folder: Path) -> None:
    path = folder / _UNFINISHED
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def checked_file(path: Path) -> Path:
    """The file, if it can be written, or made together with its folder.

    Raises ValueError for a folder, OSError, naming the file, where nothing can be written.
    """
    if path.is_dir():
        raise ValueError(f"a file is to be written, and {path} is a folder")
    if path.exists() and not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    _check_writable(path.parent, path)
    return path


def checked_bag(path: Path) -> Path:
    """The path of a ROS bag, if it can be written and nothing is there yet.

    Raises ValueError where there is, ImportError without the library that writes bags.
    """
    if find_spec("rosbags") is None:
        raise ImportError("a ROS bag is written by rosbags: pip install 'kitasap[ros]'")
    if path.exists():
        raise ValueError(f"{path} is there already, and is not written over: move it away")
    _check_writable(path.parent, path)
    return path


def _check_writable(folder: Path, named: Path) -> None:
    """Raises OSError about what is named if nothing can be written into a folder."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    try:
        # what may be written where is known to the system alone: of /proc, its permissions lie
        with tempfile.TemporaryFile(dir=there):
            pass
    except NotADirectoryError as error:
        raise NotADirectoryError(error.errno, error.strerror, str(named)) from None
    except OSError as error:
        said = f"nothing can be written there ({error.strerror})"
        raise OSError(error.errno, said, str(named)) from None


def files_before(folder: Path, files_of: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Names of the files that the experiment whose results are in a folder wrote there.

    files_of: beside summary.json, which tells whose they are; of others there are none.
    """
    return files_of.get(_experiment_of(folder) or "", ())


def _experiment_of(folder: Path) -> str | None:
    """What the results in a folder are of; None where nothing is there, or nothing of ours."""
    try:
        text = (folder / "summary.json").read_text(encoding="utf-8")
        return str(json.loads(text)["experiment"])
    except (OSError, ValueError, KeyError, TypeError):
        return None

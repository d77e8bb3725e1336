"""What a terminal is shown while one waits, and that nothing of it is in a file."""

import contextlib
import io
from collections.abc import Callable
from pathlib import Path

import numba
import pytest

from experiments.cli import main
from experiments.progress import DriveProgress, SlamProgress
from slam.frontend.keyframes import StepStatus
from slam.mapping import MapperStep
from slam.se2 import SE2

DATA = Path(__file__).parents[1] / "data"
LOG = str(DATA / "fr101-excerpt.clf.gz")
REFERENCE = str(DATA / "fr101-excerpt.reference.tum")


class Terminal(io.StringIO):
    """What is written to it, and a width."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def shown(monkeypatch) -> Callable[..., str]:
    """What a terminal is shown by a command that ends with some status."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments: str, status: int = 0) -> str:
        terminal = Terminal()
        with contextlib.redirect_stderr(terminal):
            assert main(list(arguments)) == status
        return terminal.getvalue()

    return run


def test_slam_says_that_it_finishes_the_map(shown, tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.figures.slam_map_picture", lambda *_: None)
    text = shown("slam", LOG, "--out", str(tmp_path))
    assert "20/20" in text
    assert "; finishing the map" in text
    # and not for ever
    assert "finishing" not in text.splitlines()[-1]


def test_slam_says_why_nothing_happens_where_kernels_are_compiled(
    shown, tmp_path, monkeypatch, capsys
):
    """It once was silent for half a minute on a new machine."""
    monkeypatch.setattr("experiments.figures.slam_map_picture", lambda *_: None)
    monkeypatch.setattr(
        "experiments.slam_passes.warm_up", lambda **_: numba.njit(lambda number: 2 * number)(2)
    )
    told = f"{Path(LOG).name}: compiling, some 30 s; once per checkout"
    text = shown("slam", LOG, "--out", str(tmp_path))
    assert text.count(told) == 1
    # and where no terminal is
    assert main(["slam", LOG, "--out", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert err.splitlines()[0] == told
    assert "compiling" not in out


@pytest.mark.slow
def test_scans_that_are_tracked_are_counted(shown, tmp_path):
    options = ("--reference", REFERENCE, "--method", "limit", "--out", str(tmp_path))
    text = shown("real-log", LOG, *options)
    assert "fr101-excerpt.clf.gz" in text
    assert "10/10" in text


def test_calibration_counts_the_seconds_of_its_drive(shown, box_room):
    text = shown("calibrate", "--place", box_room, "--duration", "5", status=1)
    assert "5/5" in text
    assert "finding mounting and wheels" in text


def test_queries_are_counted_over_all_places(shown, box_room, monkeypatch, capsys):
    monkeypatch.setattr("experiments.bench.relocalization.PLACES", (box_room, box_room))
    assert "4/4" in shown("bench", "relocalization", "--trials", "2", "--people", "0")
    assert "query [ms]" in capsys.readouterr().out


def test_nothing_moves_where_no_terminal_is(capsys):
    with DriveProgress("calibrate", after="finding") as progress:
        progress.update(1.0, 2.0)
        progress.update(2.0, 2.0)
    assert capsys.readouterr().err == ""


def test_a_log_says_each_tenth_where_no_terminal_is(capsys):
    step = MapperStep(0.0, SE2.identity(), StepStatus.MATCHED, 1.0, 4)
    with SlamProgress("fr101") as progress:
        for _ in range(2):  # two passes
            for index in range(25):
                progress.update(index, 25, step)
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 20
    assert told[0] == "fr101 3 of 25: matched, 4 loops"
    assert told[9] == told[19] == "fr101 25 of 25: matched, 4 loops"

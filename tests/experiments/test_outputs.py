"""A folder that cannot be written is refused before anything is worked out for it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from experiments.commands.options import check_words
from experiments.outputs import (
    checked_file,
    checked_folder,
    results_of_one,
    results_together,
)
from experiments.trial_log import locked
from tests.experiments.refusals import refusal

DATA = Path(__file__).parents[1] / "data"
LOG = str(DATA / "fr101-excerpt.clf.gz")
REFERENCE = str(DATA / "fr101-excerpt.reference.tum")

WORK = {
    "localize": ("experiments.localize.run", ["localize", LOG, LOG]),
    "slam": ("experiments.slam_log.run", ["slam", LOG]),
    "evaluate": (
        "experiments.evaluation.evaluated_files", ["evaluate", REFERENCE, "--reference", REFERENCE]
    ),
    "tracked": ("experiments.real_logs.run", ["real-log", LOG, "--reference", REFERENCE]),
    "each": (
        "experiments.real_relocalization.run",
        ["real-log", LOG, "--reference", REFERENCE, "--protocol", "each"],
    ),
    "run": ("experiments.runs.Run.execute", ["run", "localization"]),
    "trial": ("experiments.runs.trial_result", ["trial", "localization"]),
    "picture": ("kitasap_sim.simulation.Simulation", ["picture"]),
    "bench mismatch": ("experiments.bench.mismatch.print_benchmark", ["bench", "mismatch"]),
    "bench mapping": ("experiments.bench.mapping.print_benchmark", ["bench", "mapping", LOG]),
    "bench continued": (
        "experiments.bench.continued.print_benchmark",
        ["bench", "continued", LOG, "--reference", REFERENCE],
    ),
    "bench registration": (
        "experiments.bench.registration_run.print_benchmark", ["bench", "registration"]
    ),
}  # fmt: skip
"""By command, what may not be called, and what is typed."""


@pytest.mark.parametrize("command", WORK)
@pytest.mark.parametrize("where", ["/proc/nowhere/out", "file/out"])
def test_what_cannot_be_written_is_refused_before_the_work(
    command, where, tmp_path, capsys, monkeypatch
):
    work, arguments = WORK[command]
    monkeypatch.setattr(work, lambda *_, **__: pytest.fail("worked first"))
    (tmp_path / "file").touch()
    line = refusal(capsys, *arguments, "--out", tmp_path / where)
    if where.startswith("/proc"):
        assert line.startswith("/proc/nowhere")
        assert ": nothing can be written there (" in line
    else:
        assert line.startswith(f"{tmp_path}/file/out")
        assert line.endswith(": Not a directory")


@pytest.mark.parametrize("command", ["slam", "localize", "tracked", "each"])
@pytest.mark.parametrize("name", ["trajectory.tum", "map.kitasap", "slam.png", "summary.json"])
def test_folder_in_the_place_of_a_result_is_refused_before_the_work(
    command, name, tmp_path, capsys, monkeypatch
):
    work, arguments = WORK[command]
    monkeypatch.setattr(work, lambda *_, **__: pytest.fail("worked first"))
    (tmp_path / name).mkdir()
    said = refusal(capsys, *arguments, "--out", tmp_path)
    assert said == f"{tmp_path / name}: a folder where a file is to be written"


def test_folder_that_can_be_made_is_not_made_before_there_is_something_in_it(tmp_path):
    (tmp_path / "there").touch()
    assert checked_folder(tmp_path / "a/b") == tmp_path / "a/b"
    assert checked_file(tmp_path / "a/b.json") == tmp_path / "a/b.json"
    assert checked_file(tmp_path / "there") == tmp_path / "there"
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


def test_file_and_folder_are_not_taken_for_each_other(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match=r"--out takes a folder, and .*/file is a file"):
        checked_folder(tmp_path / "file")
    with pytest.raises(ValueError, match=r"a file is to be written, and .* is a folder"):
        checked_file(tmp_path)


@pytest.mark.parametrize(
    "command",
    [
        ("slam", LOG),
        ("real-log", LOG, "--reference", REFERENCE),
        ("localize", "map.yaml", LOG),
        ("bench", "mismatch"),
    ],
)
def test_run_of_trials_is_not_written_over_by_something_else(tmp_path, capsys, command):
    (tmp_path / "trials.jsonl").write_text("{}\n")
    said = refusal(capsys, *command, "--out", tmp_path)
    assert said == f"--out {tmp_path} holds the trials of a run: give another folder"


def test_options_that_would_change_nothing_are_refused(tmp_path, capsys):
    log = ("real-log", LOG, "--reference", REFERENCE, "--out", tmp_path)
    assert "--jumps changes nothing of tracked" in refusal(capsys, *log, "--jumps", "3")
    assert "takes a PNG file" in refusal(capsys, "picture", "--out", tmp_path / "room.jpg")


@pytest.mark.parametrize("command", [("slam", LOG), ("localize", "map.yaml", LOG)])
def test_folder_in_which_a_command_is_at_work_is_refused(tmp_path, capsys, command):
    with results_of_one(tmp_path):
        said = refusal(capsys, *command, "--out", tmp_path)
    assert said == f"another run is at work in {tmp_path}: wait for its end"


@pytest.mark.parametrize(
    ("name", "text", "what"),
    [
        ("summary.json", '{"experiment": "localize"}', "results of localize"),
        ("trials.jsonl", "{}\n", "the trials of a run"),
    ],
)
def test_results_that_another_command_left_before_the_folder_was_locked_are_kept(
    tmp_path, monkeypatch, name, text, what
):
    folder = tmp_path / "out"

    @contextmanager
    def locked_late(path: Path) -> Iterator[None]:
        path.mkdir()
        (path / name).write_text(text)
        with locked(path):
            yield

    monkeypatch.setattr("experiments.outputs.locked", locked_late)
    with pytest.raises(ValueError, match=what), results_of_one(folder, "slam"):
        pytest.fail("worked there")
    assert (folder / name).read_text() == text


def test_results_take_the_place_of_those_before_all_at_once(tmp_path):
    for name in ("summary.json", "map.yaml", "sessions.tum", "of-others"):
        (tmp_path / name).write_text("old")
    with results_together(tmp_path, outdated=("sessions.tum", "map.yaml")) as unfinished:
        (unfinished / "map.yaml").write_text("new")
        (unfinished / "summary.json").write_text("new")
        assert (tmp_path / "map.yaml").read_text() == "old"
    there = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert there == {"summary.json": "new", "map.yaml": "new", "of-others": "old"}


def test_results_before_stay_where_new_ones_are_not_finished(tmp_path):
    (tmp_path / "summary.json").write_text("old")

    def written() -> None:
        with results_together(tmp_path) as unfinished:
            (unfinished / "summary.json").write_text("new")
            raise OSError("full")

    with pytest.raises(OSError, match="full"):
        written()
    assert [path.name for path in tmp_path.iterdir()] == ["summary.json"]
    assert (tmp_path / "summary.json").read_text() == "old"


def test_summary_is_gone_before_and_back_after_all_else(tmp_path, monkeypatch):
    moved = []

    def followed(path, target):
        moved.append((path.name, (tmp_path / "summary.json").exists()))
        path.rename(target)

    (tmp_path / "summary.json").write_text("old")
    monkeypatch.setattr(Path, "replace", followed)
    with results_together(tmp_path) as unfinished:
        for name in ("summary.json", "trajectory.tum", "map.kitasap"):
            (unfinished / name).write_text("new")
    assert moved == [("map.kitasap", False), ("trajectory.tum", False), ("summary.json", False)]


@pytest.mark.parametrize(
    ("there", "what"),
    [
        ('{"experiment": "localize"}', "results of localize"),
        ("{}", "a summary.json that is none of ours"),
        ("mine", "a summary.json that is none of ours"),
    ],
)
def test_results_of_something_else_are_not_written_over(tmp_path, capsys, there, what):
    (tmp_path / "summary.json").write_text(there)
    said = refusal(capsys, "slam", LOG, "--out", tmp_path)
    assert said == f"--out {tmp_path} holds {what}: give another folder"
    assert (tmp_path / "summary.json").read_text() == there


def test_summary_is_the_first_that_goes_and_what_is_outdated_follows_in_order(
    tmp_path, monkeypatch
):
    outdated, gone, unlink = ("zones", "map.yaml", "asked.jsonl", "x", "map.pgm"), [], Path.unlink

    def followed(path, missing_ok=False):
        if path.name in outdated or path.name == "summary.json":
            gone.append(path.name)
        unlink(path, missing_ok)

    for name in (*outdated, "summary.json"):
        (tmp_path / name).write_text("old")
    monkeypatch.setattr(Path, "unlink", followed)
    with results_together(tmp_path, outdated=outdated) as unfinished:
        (unfinished / "summary.json").write_text("new")
    assert gone == ["summary.json", "asked.jsonl", "map.pgm", "map.yaml", "x", "zones"]
    assert [path.name for path in tmp_path.iterdir()] == ["summary.json"]


@pytest.mark.parametrize("kind", ["folder", "file", "dangling"])
def test_what_a_killed_command_left_is_taken_away_with_the_next(tmp_path, kind):
    left = tmp_path / ".kitasap-unfinished"
    if kind == "folder":
        left.mkdir()
        (left / "map.kitasap").write_text("half of it")
    elif kind == "file":
        left.write_text("something else")
    else:
        left.symlink_to("nowhere")
    with results_of_one(tmp_path):
        assert not list(tmp_path.iterdir())


def test_folder_behind_a_link_that_a_killed_command_left_is_not_emptied(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis").touch()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".kitasap-unfinished").symlink_to(tmp_path / "mine")
    with results_of_one(tmp_path / "out"):
        assert not list((tmp_path / "out").iterdir())
    assert (tmp_path / "mine" / "thesis").exists()


def test_results_that_were_not_finished_are_not_those_of_the_next(tmp_path):
    (tmp_path / ".kitasap-unfinished").mkdir()
    (tmp_path / ".kitasap-unfinished" / "map.yaml").write_text("old")
    with results_together(tmp_path) as unfinished:
        (unfinished / "map.pgm").write_text("new")
    assert [path.name for path in tmp_path.iterdir()] == ["map.pgm"]


def test_folder_in_the_place_of_a_file_leaves_the_results_before(tmp_path):
    (tmp_path / "slam.png").mkdir()
    (tmp_path / "map.pgm").write_text("old")

    def written() -> None:
        with results_together(tmp_path) as unfinished:
            (unfinished / "map.pgm").write_text("new")
            (unfinished / "slam.png").write_text("new")

    with pytest.raises(IsADirectoryError, match=r"slam\.png"):
        written()
    assert (tmp_path / "map.pgm").read_text() == "old"


def test_folder_in_the_place_of_an_outdated_file_leaves_the_results_before(tmp_path):
    (tmp_path / "map.yaml").mkdir()
    for name in ("a", "summary.json", "z"):
        (tmp_path / name).write_text("old")

    def written() -> None:
        with results_together(tmp_path, outdated=("z", "map.yaml", "a")) as unfinished:
            (unfinished / "summary.json").write_text("new")

    with pytest.raises(IsADirectoryError, match=r"map\.yaml"):
        written()
    assert {path.name for path in tmp_path.iterdir()} == {"a", "map.yaml", "summary.json", "z"}
    assert (tmp_path / "summary.json").read_text() == "old"


def test_folder_is_locked_until_one_that_was_made_in_vain_is_gone(tmp_path, monkeypatch):
    folder, was_locked = tmp_path / "out", []
    remove = Path.rmdir

    def removed(path: Path) -> None:
        with pytest.raises(ValueError, match="at work"), locked(folder):
            pass
        was_locked.append(path)
        remove(path)

    monkeypatch.setattr(Path, "rmdir", removed)
    with results_of_one(folder):
        pass
    assert was_locked == [folder]


def test_folder_that_was_taken_away_before_it_was_locked_is_made_once_more(tmp_path, monkeypatch):
    folder, opened = tmp_path / "out", os.open

    def taken_away(path: object, *arguments: object) -> int:
        monkeypatch.setattr(os, "open", opened)
        handle = opened(path, *arguments)
        folder.rmdir()
        return handle

    monkeypatch.setattr(os, "open", taken_away)
    with locked(folder):
        assert folder.is_dir()
        with pytest.raises(ValueError, match="at work"), locked(folder):
            pass


def test_folder_that_was_made_in_vain_is_not_left_behind(tmp_path):
    with results_of_one(tmp_path / "a" / "b"):
        pass
    assert not list(tmp_path.iterdir())
    (tmp_path / "there").mkdir()
    with results_of_one(tmp_path / "there"):
        pass
    assert (tmp_path / "there").is_dir()


@pytest.mark.parametrize(
    "typed",
    [("slam", LOG, "--out", ""), ("slam", LOG, "--out="), ("slam", "")],
)
def test_empty_path_is_not_the_current_folder(tmp_path, capsys, monkeypatch, typed):
    monkeypatch.chdir(tmp_path)
    assert refusal(capsys, *typed).endswith(" is empty: is a variable of the shell not set?")
    assert not list(tmp_path.iterdir())


def test_what_stands_behind_two_dashes_and_a_viewer_without_a_file_are_no_empty_path():
    check_words(["slam", "a.clf", "--rerun=", "--", "", "--out="])
    with pytest.raises(ValueError, match=r"^an argument is empty"):
        check_words(["slam", "--start", "-1", ""])
    with pytest.raises(ValueError, match=r"^--start is empty"):
        check_words(["slam", "--start", ""])


def test_option_of_several_numbers_says_so(capsys):
    said = refusal(capsys, "slam", LOG, "--start", "1", "2", "--out", "a")
    assert said.endswith("(--start takes 3 values: X Y THETA)")

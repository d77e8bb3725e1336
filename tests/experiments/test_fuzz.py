"""The fuzzing itself: what it finds in a reader that is wrong, and that ours stand some of it."""

import random
import sys
from pathlib import Path

import pytest
import yaml

from experiments.bench import fuzz
from experiments.bench.fuzz import fuzzed
from experiments.cli import main
from experiments.fuzzing import child
from experiments.fuzzing.board import RENEWED, Board, Tally
from experiments.fuzzing.child import Trial
from experiments.fuzzing.mutations import mutated
from experiments.fuzzing.targets import TARGETS, checked_targets

READERS = [name for name, target in TARGETS.items() if target.file is not None]
UPDATES = [name for name, target in TARGETS.items() if target.file is None]


def tried(name, folder, inputs, read=None, seeds=None) -> tuple[Tally, list[str]]:
    """The tally of some mutated inputs, and the kinds of failures that they brought."""
    for one in ("files", "found"):
        (folder / one).mkdir()
    if read is None:
        seeds, read = TARGETS[name].make(folder / "files")
    trial, rng = Trial(name, folder, Board(folder / "board", is_new=True), read), random.Random(0)
    for _ in range(inputs):
        trial(mutated(rng.choice(seeds), rng, rng.choice(seeds)))
    return trial.tally, sorted(path.name for path in (folder / "found").glob("*.txt"))


@pytest.mark.parametrize("name", READERS)
def test_a_few_mutated_files_end_as_documented(tmp_path, name):
    tally, found = tried(name, tmp_path, 20)
    assert found == []
    assert tally.inputs == 20


@pytest.mark.slow
@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("name", READERS)
def test_two_thousand_mutated_files_end_as_documented(tmp_path, name):
    assert tried(name, tmp_path, 2000)[1] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", UPDATES)
def test_arbitrary_scans_leave_a_finite_pose(tmp_path, name):
    assert tried(name, tmp_path, 100)[1] == []


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (KeyError("x"), "KeyError-"),
        (MemoryError(), "MemoryError-"),
        (ValueError("t.tum line 1: 3\nnumbers"), "AssertionError-"),
        (ValueError("could not convert string to float: 'a'"), "AssertionError-"),
        (ValueError(""), "AssertionError-"),
        (AssertionError("a result that is not finite"), "AssertionError-"),
    ],
)
def test_what_a_reader_must_not_do_is_found_and_kept(tmp_path, error, kind):
    def read(data: bytes, folder: Path) -> None:
        raise error

    tally, found = tried("tum", tmp_path, 5, read, [b"12345678"])
    assert [name.startswith(kind) for name in found] == [True]
    assert len(list((tmp_path / "found").glob("*.bin"))) == 1
    assert (tally.inputs, tally.refused) == (5, 0)


def test_refusal_of_one_line_that_names_the_file_is_as_documented(tmp_path):
    def read(data: bytes, folder: Path) -> None:
        raise ValueError("t.tum line 3: expected 8 numbers, found 2")

    tally, found = tried("tum", tmp_path, 5, read, [b"12345678"])
    assert (tally.refused, found) == (5, [])


def test_memory_that_was_taken_before_is_not_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(child, "_peak_kb", lambda: 4 * child._MOST_GROWN_KB)
    assert tried("tum", tmp_path, 5, lambda data, folder: None, [b"1"])[1] == []


def test_memory_is_counted_input_by_input(tmp_path, monkeypatch):
    """What a little of each leaves is not laid on one of them."""
    now = {"kb": 0, "peak": 0}
    monkeypatch.setattr(child, "_held_kb", lambda: now["kb"])
    monkeypatch.setattr(child, "_peak_kb", lambda: now["peak"])

    def leave(data: bytes, folder: Path) -> None:
        now["kb"] += child._MOST_GROWN_KB // 3
        now["peak"] = now["kb"]

    assert tried("tum", tmp_path, 5, leave, [b"1"])[1] == []

    def take(data: bytes, folder: Path) -> None:
        now["peak"] = now["kb"] + child._MOST_GROWN_KB + 1

    (tmp_path / "more").mkdir()
    found = tried("tum", tmp_path / "more", 1, take, [b"1"])[1]
    assert [name.startswith("MemoryError-") for name in found] == [True]


def test_process_that_holds_too_much_is_followed_by_another(tmp_path, monkeypatch):
    monkeypatch.setattr(child, "_MOST_LEFT_KB", -(10**9))
    with monkeypatch.context() as patched:
        left = []
        patched.setattr(child.os, "_exit", left.append)
        patched.setattr(child, "find_spec", lambda name: None)
        patched.setattr(Trial, "arm", lambda self: None)
        for one in ("files", "found", "corpus"):
            (tmp_path / one).mkdir()
        Board(tmp_path / "board", is_new=True)
        child.main(child.Task("relations", 5.0, 0, str(tmp_path), 1))
        assert left == [RENEWED]
    _stands_in(monkeypatch, "board.write(Tally(inputs=7)); sys.exit(64)")
    result = fuzzed("tum", 60.0, 20, 0, tmp_path)
    assert (result.tally.inputs, result.found) == (21, [])


def test_update_may_refuse_nothing(tmp_path):
    def read(data: bytes, folder: Path) -> None:
        raise ValueError("one line")

    assert len(tried("mapper", tmp_path, 3, read, [b"1"])[1]) == 1


@pytest.mark.parametrize(
    ("code", "kind"),
    [("import time; time.sleep(60)", "hang-"), ("import os; os.abort()", "died-6")],
)
def test_process_that_hangs_or_dies_leaves_its_input(tmp_path, monkeypatch, code, kind):
    _stands_in(monkeypatch, f"board.begin(Tally(inputs=7), b'bad'); {code}")
    monkeypatch.setattr(fuzz, "_HANG_S", 0.3)
    monkeypatch.setattr(fuzz, "_MOST_DEATHS", 1)
    result = fuzzed("tum", 1.0, 1000, 0, tmp_path)
    assert [path.name.startswith(kind) for path in result.found] == [True]
    assert result.found[0].read_bytes() == b"bad"
    assert result.tally.inputs == 7


def _stands_in(monkeypatch, code: str) -> None:
    """In place of each process that fuzzes, one that does what the code says."""
    begun = (
        "import sys, json; from pathlib import Path;"
        "from experiments.fuzzing.board import RENEWED, Board, Tally;"
        "folder = Path(json.loads(sys.argv[-1])['folder']);"
        f"board = Board(folder / 'board', is_new=False); {code}"
    )
    usual = fuzz.subprocess.Popen
    monkeypatch.setattr(
        fuzz.subprocess,
        "Popen",
        lambda arguments, **more: usual([sys.executable, "-c", begun, arguments[-1]], **more),
    )


@pytest.mark.slow
def test_command_fuzzes_a_reader_and_says_how_much(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["bench", "fuzz", "kitti", "--inputs", "30", "--minutes", "0.5"]) == 0
    told = capsys.readouterr().out
    assert "kitti" in told
    assert int(told.split("kitti")[1].split("│")[3]) >= 30


def test_unknown_target_is_told_those_that_there_are(capsys):
    assert main(["bench", "fuzz", "tea"]) == 2
    assert "there are: all, carmen, ticks" in capsys.readouterr().err
    assert checked_targets("all") == list(TARGETS)


def test_unguided_process_mutates_on_its_own(tmp_path, monkeypatch):
    monkeypatch.setattr(child, "find_spec", lambda name: None)
    monkeypatch.setattr(Trial, "arm", lambda self: None)  # of this process, memory stays unlimited
    for one in ("files", "found", "corpus"):
        (tmp_path / one).mkdir()
    board = Board(tmp_path / "board", is_new=True)
    child.main(child.Task("relations", 5.0, 0, str(tmp_path), 25))
    assert (board.read().inputs, board.read().is_guided) == (25, 0)


def test_each_night_all_targets_are_fuzzed():
    workflow = Path(__file__).parents[2] / ".github/workflows/nightly.yml"
    jobs = yaml.safe_load(workflow.read_text(encoding="utf-8"))["jobs"]
    assert jobs["fuzz"]["strategy"]["matrix"]["target"] == list(TARGETS)

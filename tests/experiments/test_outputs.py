"""A folder that cannot be written is refused before anything is worked out for it."""

from pathlib import Path

import pytest

from experiments.outputs import checked_file, checked_folder
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

"""`online.tum`: there scan by scan, and of one run with the results beside it, whatever ends one."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.cli import main
from experiments.outputs import results_together
from experiments.slam_files import SOMETIMES, OnlinePoses
from experiments.slam_log import default_mapped
from experiments.slam_result import SlamLog
from slam.frontend.keyframes import StepStatus
from slam.mapping import MapperStep
from slam.readers.recognition import read_log
from slam.se2 import SE2
from slam.trajectory import read_tum
from tests.experiments.refusals import refusal

LOG = Path(__file__).parents[1] / "data" / "fr101-excerpt.clf.gz"
OLD = {"summary.json": '{"experiment": "slam"}', "trajectory.tum": "old", "online.tum": "old"}
WITHOUT_POSES = {name: text for name, text in OLD.items() if name != "online.tum"}


@pytest.fixture(scope="module")
def mapped() -> SlamLog:
    return default_mapped(read_log(LOG))


@pytest.fixture
def two_passes(mapped, monkeypatch) -> None:
    """`kitasap slam` goes through a scan, then through two, whose map is used, without the work."""
    twice = replace(mapped, used_pass=1)

    def run(_log, _reference, _relations, on_scan, *_) -> SlamLog:
        for scans in (1, 2):
            for index in range(scans):
                on_scan(index, scans, step())
        return twice

    monkeypatch.setattr("experiments.slam_log.run", run)
    monkeypatch.setattr("experiments.figures.slam_map_picture", lambda *_: None)


def fill(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).write_text(text)


def there(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}


def step(x_m: float = 0.0) -> MapperStep:
    return MapperStep(5.0, SE2(x_m, 0.0, 0.0), StepStatus.MATCHED, 1.0, 0)


def test_each_pose_is_there_to_be_read_when_its_scan_arrived(tmp_path, monkeypatch):
    seen = []

    def follow(_, index, scans, step):
        read = read_tum(tmp_path / "online.tum")
        seen.append((index, len(read), read.poses[-1], step.T_map_base.as_array()))

    monkeypatch.setattr("experiments.progress.SlamProgress.update", follow)
    monkeypatch.setattr("experiments.figures.slam_map_picture", lambda *_: None)
    assert main(["slam", str(LOG), "--out", str(tmp_path)]) == 0
    assert [count for _, count, _, _ in seen] == [index + 1 for index, _, _, _ in seen]
    for _, _, read, told in seen:
        np.testing.assert_allclose(read, told, atol=1e-8)
    # as it was then: loops closed later move the poses of the whole drive
    assert len(read_tum(tmp_path / "online.tum")) == len(seen)


@pytest.mark.parametrize("before", [OLD, WITHOUT_POSES])
def test_results_that_are_finished_stay_until_there_are_others(tmp_path, monkeypatch, before):
    def killed(*_):
        if (tmp_path / "summary.json").exists():  # others may follow the poses meanwhile
            assert len(read_tum(tmp_path / "online.tum")) == 1
        raise KeyboardInterrupt

    fill(tmp_path, before)
    assert main(["slam", str(tmp_path / "nowhere.clf"), "--out", str(tmp_path)]) == 2
    monkeypatch.setattr("experiments.progress.SlamProgress.update", killed)
    for _ in range(2):
        assert main(["slam", str(LOG), "--out", str(tmp_path)]) == 130
        assert there(tmp_path) == before
    # poses that belong to nothing that is finished are of the last that tried
    (tmp_path / "summary.json").unlink()
    assert main(["slam", str(LOG), "--out", str(tmp_path)]) == 130
    assert len(read_tum(tmp_path / "online.tum")) == 1


@pytest.mark.usefixtures("two_passes")
def test_first_poses_of_a_run_that_fails_stay_where_nothing_was_finished(tmp_path, monkeypatch):
    def failing(*_):
        raise OSError("full")

    monkeypatch.setattr("experiments.slam_files.write_results", failing)
    assert main(["slam", str(LOG), "--out", str(tmp_path)]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["online.tum"]
    assert len(read_tum(tmp_path / "online.tum")) == 1


@pytest.mark.usefixtures("two_passes")
@pytest.mark.parametrize("before", [OLD, WITHOUT_POSES])
@pytest.mark.parametrize(
    "fails", ["experiments.slam_files.write_results", "experiments.figures.slam_map_picture"]
)
@pytest.mark.parametrize(("by", "status"), [(OSError("full"), 2), (KeyboardInterrupt(), 130)])
def test_run_whose_results_cannot_be_written_leaves_those_before(
    tmp_path, monkeypatch, before, fails, by, status
):
    def failing(*_):
        raise by

    fill(tmp_path, before)
    monkeypatch.setattr(fails, failing)
    assert main(["slam", str(LOG), "--out", str(tmp_path)]) == status
    assert there(tmp_path) == before


@pytest.mark.usefixtures("two_passes")
@pytest.mark.parametrize("before", [OLD, WITHOUT_POSES, {"online-3.tum": "of a killed one"}])
def test_second_run_has_its_own_poses_of_the_pass_that_is_used(tmp_path, before):
    fill(tmp_path, before)
    for _ in range(2):
        assert main(["slam", str(LOG), "--out", str(tmp_path)]) == 0
        assert len(read_tum(tmp_path / "online.tum")) == 2
        assert not list(tmp_path.glob("online-*.tum"))
        assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_poses_that_a_killed_command_laid_aside_come_back(tmp_path):
    (tmp_path / ".online.tum").write_text("finished")
    (tmp_path / "online.tum").write_text("not")
    (tmp_path / "online-2.tum").write_text("not either")
    with OnlinePoses(tmp_path):
        pass
    assert there(tmp_path) == {"online.tum": "finished"}


@pytest.mark.parametrize("before", [OLD, WITHOUT_POSES])
def test_whenever_a_run_is_killed_summary_and_poses_are_of_one_run_with_the_next(
    tmp_path, monkeypatch, before
):
    folder, killed = tmp_path / "out", []
    folder.mkdir()
    fill(folder, before)

    def killed_before(name):
        done = getattr(Path, name)

        def changed(path, *arguments, **options):
            killed.append(tmp_path / f"killed-{len(killed)}")
            shutil.copytree(folder, killed[-1])
            return done(path, *arguments, **options)

        return changed

    with monkeypatch.context() as patched:
        for name in ("replace", "unlink", "touch"):
            patched.setattr(Path, name, killed_before(name))
        with OnlinePoses(folder) as online:
            for number in range(2):
                online.add(0, step(number))
            with results_together(folder, outdated=(*SOMETIMES, *online.outdated)) as unfinished:
                online.keep(1, unfinished)
                fill(unfinished, {"trajectory.tum": "new", "summary.json": "new"})
    whole = {"old": before, "new": there(folder)}
    assert len(killed) > 5
    for left in killed:
        with OnlinePoses(left):
            pass
        if (left / "summary.json").exists():
            of = (left / "trajectory.tum").read_text()
            assert there(left) == whole[of]


def test_other_passes_of_a_run_that_fails_leave_the_poses_before(tmp_path):
    fill(tmp_path, OLD)
    with OnlinePoses(tmp_path) as online:
        for number in range(3):
            online.add(0, step(number))
            online.add(1, step(number))
        # each pass by itself, while it lasts
        read = [read_tum(tmp_path / f"online{name}.tum") for name in ("", "-2", "-3")]
        assert [one.poses[:, 0].tolist() for one in read] == [[0.0] * 2, [1.0] * 2, [2.0] * 2]
    assert there(tmp_path) == OLD


@pytest.mark.parametrize("before", [OLD, WITHOUT_POSES])
def test_full_disk_leaves_the_poses_before(tmp_path, monkeypatch, before):
    fill(tmp_path, before)

    def full(path, *_, **__):
        path.touch()
        return open("/dev/full", "w", encoding="utf-8")

    def mapped() -> None:
        with OnlinePoses(tmp_path) as online:
            online.add(0, step())

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", full)
        with pytest.raises(OSError, match="No space left"):
            mapped()
    assert there(tmp_path) == before


@pytest.mark.parametrize("name", ["online.tum", ".online.tum", "online-2.tum"])
def test_folder_in_the_place_of_poses_is_refused_before_the_work(
    tmp_path, capsys, monkeypatch, name
):
    monkeypatch.setattr("experiments.slam_log.run", lambda *_: pytest.fail("worked first"))
    (tmp_path / name).mkdir()
    said = refusal(capsys, "slam", LOG, "--out", tmp_path)
    assert said == f"{tmp_path / name}: a folder where a file is to be written"
    assert (tmp_path / name).is_dir()


@pytest.mark.parametrize(("used", "kept_m"), [(0, 0.0), (1, 1.0)])
def test_online_poses_are_those_of_the_map_that_is_used(tmp_path, used, kept_m):
    (tmp_path / "online-3.tum").write_text("of a command that was killed")
    (tmp_path / "online-monday.tum").write_text("somebody's")
    with OnlinePoses(tmp_path) as online:
        for number in range(2):
            online.add(0, step(number))
            online.add(1, step(number))
        assert read_tum(tmp_path / "online.tum").poses[0, 0] == 0.0
        with results_together(tmp_path, outdated=online.outdated) as unfinished:
            online.keep(used, unfinished)
            # to be followed as before, until all is written
            assert read_tum(tmp_path / "online.tum").poses[0, 0] == 0.0
    assert {path.name for path in tmp_path.iterdir()} == {"online.tum", "online-monday.tum"}
    assert read_tum(tmp_path / "online.tum").poses[0, 0] == kept_m

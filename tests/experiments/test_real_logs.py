"""Real logs: the odd scans found on the map of the even ones, end to end."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.figures import real_log_picture
from experiments.real_logs import main, run, table
from slam.readers.carmen import read_carmen
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2
from slam.trajectory import Trajectory, read_tum
from tests.experiments.refusals import refusal
from tests.slam.logs import shared_log

pytestmark = pytest.mark.usefixtures("own_folder")

DATA = Path(__file__).parents[1] / "data"
EXCERPT = [str(DATA / "fr101-excerpt.clf.gz"), "--reference"]
REFERENCE = str(DATA / "fr101-excerpt.reference.tum")
FILES = {
    "tracked": {"summary.json", "trajectory.tum", "localization.png"},
    "each": {"summary.json", "asked.jsonl"},
}


@pytest.fixture
def without_work(monkeypatch) -> None:
    """`kitasap real-log` writes results of nothing, at once."""
    summary = {"tracked": 0, "scans": 0, "sure_elsewhere": 0}
    tracked = SimpleNamespace(
        summary=lambda: {"experiment": "real_logs", **summary},
        trajectory=lambda: Trajectory(np.zeros(1), np.zeros((1, 3))),
    )
    each = SimpleNamespace(
        summary=lambda: {"experiment": "real_relocalization_each", **summary}, asked=()
    )
    for module, result in (("real_logs", tracked), ("real_relocalization", each)):
        monkeypatch.setattr(f"experiments.{module}.run", lambda *_, result=result: result)
        monkeypatch.setattr(f"experiments.{module}.table", lambda _: "")
    monkeypatch.setattr(
        "experiments.figures.real_log_picture",
        lambda folder, _: (folder / "localization.png").touch(),
    )


@pytest.mark.slow
def test_every_odd_scan_of_the_excerpt_is_tracked(tmp_path, capsys):
    assert main([*EXCERPT, REFERENCE, "--out", str(tmp_path / "out")]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["scans"], summary["tracked"]) == (10, 10)
    # the reference itself is good to 3 cm and half a degree
    assert summary["position_error_m"]["median"] < 0.05
    assert summary["heading_error_deg"]["median"] < 0.5
    assert "tracked 10" in capsys.readouterr().out
    trajectory = read_tum(tmp_path / "out" / "trajectory.tum")
    stamps = [m.time_s for m in read_carmen(EXCERPT[0]).measurements()][1::2]
    np.testing.assert_allclose(trajectory.times_s, stamps, atol=1e-6)


def test_motion_over_passed_scans_is_kept(tmp_path):
    # every third reference pose only: scans without one must hand their motion on
    lines = Path(REFERENCE).read_text().splitlines()[1:]
    (tmp_path / "thin.tum").write_text("\n".join(lines[::3]) + "\n")
    result = run(EXCERPT[0], tmp_path / "thin.tum")
    measured = list(read_carmen(EXCERPT[0]).measurements())
    log_motion = measured[4].motion
    for measurement in measured[5:10]:
        log_motion = log_motion @ measurement.motion
    first, second = result.estimates[:2]
    motion = first.T_map_base.inverse() @ second.T_predicted
    np.testing.assert_allclose(motion.as_array(), log_motion.as_array(), atol=1e-9)


@pytest.mark.slow
def test_picture_tells_what_was_disowned_from_what_was_believed_and_wrong(tmp_path):
    result = run(EXCERPT[0], REFERENCE)
    open_ = replace(result.estimates[2], match=ScanMatch(SE2.identity(), MatchStatus.DEGENERATE))
    off = result.reference.copy()
    off[5, 0] += 1.0
    estimates = (*result.estimates[:2], open_, *result.estimates[3:])
    odd = replace(result, estimates=estimates, reference=off)
    assert np.flatnonzero(odd.is_told).tolist() == [2]
    assert np.flatnonzero(odd.is_believed_wrongly).tolist() == [5]
    assert "tracked 8, unsure or lost, and said so, 1, lost silently 1" in table(odd.summary())
    words = {"unsure or lost, and said so", "wrong, and believed"}
    for one, told in ((odd, words), (result, set())):
        real_log_picture(tmp_path, one)
        svg = (tmp_path / "localization.svg").read_text()
        assert {text for text in words if f"<!-- {text} -->" in svg} == told


@pytest.mark.slow
def test_files_of_another_protocol_do_not_stay_and_those_of_others_do(tmp_path):
    (tmp_path / "notes.txt").touch()
    # of no run of ours, as long as no summary says so
    (tmp_path / "asked.jsonl").touch()
    asked = {"asked.jsonl"}
    tracked = {"trajectory.tum", "localization.png", "localization.svg"}
    for protocol, files in (("tracked", tracked | asked), ("each", asked), ("tracked", tracked)):
        options = ["--method", "fast", "--protocol", protocol, "--out", str(tmp_path)]
        assert main([*EXCERPT, REFERENCE, *options]) in (0, 1)
        names = {path.name for path in tmp_path.iterdir()}
        assert names == {"notes.txt", "summary.json"} | files


@pytest.mark.usefixtures("without_work")
def test_results_of_one_protocol_take_the_place_of_another_s(tmp_path):
    (tmp_path / "notes.txt").touch()
    for protocol in ("tracked", "each", "tracked"):
        assert main([*EXCERPT, REFERENCE, "--protocol", protocol, "--out", str(tmp_path)]) == 0
        assert {path.name for path in tmp_path.iterdir()} == {"notes.txt"} | FILES[protocol]


@pytest.mark.usefixtures("without_work")
@pytest.mark.parametrize(
    ("protocol", "fails"),
    [
        ("tracked", "experiments.real_logs.write_atomically"),
        ("tracked", "experiments.figures.real_log_picture"),
        ("each", "experiments.real_relocalization.write_atomically"),
    ],
)
def test_results_before_stay_until_all_of_the_next_are_written(
    tmp_path, capsys, monkeypatch, protocol, fails
):
    def full(path, *_):
        if path.name != "asked.jsonl":
            raise OSError("full")
        path.touch()

    before = dict.fromkeys(FILES["tracked"] | FILES["each"], "old")
    before |= {"summary.json": '{"experiment": "real_logs"}'}
    for name, text in before.items():
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(fails, full)
    asked = ("real-log", *EXCERPT, REFERENCE, "--protocol", protocol, "--out", tmp_path)
    assert refusal(capsys, *asked) == "full"
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == before


@pytest.mark.usefixtures("without_work")
@pytest.mark.parametrize("protocol", ["tracked", "each"])
def test_summary_comes_after_all_other_results(tmp_path, monkeypatch, protocol):
    moved, replace_file = [], Path.replace

    def followed(path, target):
        if target.parent == tmp_path:
            moved.append(target.name)
        return replace_file(path, target)

    monkeypatch.setattr(Path, "replace", followed)
    assert main([*EXCERPT, REFERENCE, "--protocol", protocol, "--out", str(tmp_path)]) == 0
    assert moved == [*sorted(FILES[protocol] - {"summary.json"}), "summary.json"]


@pytest.mark.slow
def test_same_log_gives_the_same_bytes():
    first, second = run(EXCERPT[0], REFERENCE), run(EXCERPT[0], REFERENCE)
    assert first.trajectory().poses.tobytes() == second.trajectory().poses.tobytes()


def test_unreadable_input_is_one_line_and_status_2(tmp_path, capsys):
    (tmp_path / "cut.clf").write_text("ODOM 1 2\n")
    (tmp_path / "other.tum").write_text("1 0 0 0 0 0 0 1\n")
    for arguments in (
        [str(tmp_path / "cut.clf"), "--reference", REFERENCE],
        [str(tmp_path / "none.clf"), "--reference", REFERENCE],
        [*EXCERPT, str(tmp_path / "other.tum")],
    ):
        assert refusal(capsys, "real-log", *arguments)


def check_whole_log(name: str, scans: int, tracked: int) -> None:
    """Asserts what the project promises for a whole log: of the scans so many are tracked, and the
    others are said to be lost, or to leave a direction open."""
    summary = run(shared_log(f"{name}.clf.gz"), shared_log(f"{name}.reference.tum")).summary()
    assert summary["scans"] == scans
    assert summary["tracked"] >= tracked, table(summary)
    assert summary["lost_silently"] == 0
    # the references of these logs agree with each other to 3 to 5 cm
    assert summary["position_error_m"]["median"] < 0.05
    assert summary["heading_error_deg"]["median"] < 0.5


@pytest.mark.slow
def test_every_odd_scan_of_fr101_is_tracked():
    check_whole_log("fr101", 146, 146)


@pytest.mark.slow
def test_every_odd_scan_of_intel_is_tracked():
    check_whole_log("intel", 455, 449)

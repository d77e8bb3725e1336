"""`--rerun`: what is streamed, that it changes no result, and what is refused before work begins."""

import json
import socket
import sys
from pathlib import Path

import numpy as np
import pytest

from experiments import rerun_stream
from experiments.cli import main
from experiments.commands.options import viewer_told
from experiments.rerun_stream import RerunStream, shown
from experiments.rerun_views import RerunLog
from kitasap_sim.places import Place
from slam.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from slam.readers.carmen import read_carmen
from slam.se2 import SE2
from tests.experiments.fake_rerun import FakeRerun, installed
from tests.experiments.refusals import refusal

DATA = Path(__file__).parents[1] / "data"
LOG = DATA / "fr101-excerpt.clf.gz"
REFERENCE = DATA / "fr101-excerpt.reference.tum"
MEASURED = ("cpu_s", "memory_mb")


@pytest.fixture
def rerun(monkeypatch) -> FakeRerun:
    return installed(monkeypatch)


@pytest.fixture(scope="module")
def mapped(tmp_path_factory) -> Path:
    """The excerpt mapped, without any stream."""
    out = tmp_path_factory.mktemp("mapped")
    assert main(["slam", str(LOG), "--out", str(out)]) == 0
    return out


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, without what is measured of the computer."""
    files = {str(path.relative_to(folder)): path for path in folder.rglob("*") if path.is_file()}
    found = {name: path.read_bytes() for name, path in files.items() if not name.endswith(".rrd")}
    if "summary.json" in found:
        summary = json.loads(found["summary.json"])
        kept = {key: value for key, value in summary.items() if key not in MEASURED}
        found["summary.json"] = json.dumps(kept).encode()
    return found


def trial(box_room: str, out: Path, *more: str, experiment: str = "localization") -> int:
    options = ["--poses", "random", "--place", box_room, "--method", "odometry,fast"]
    return main(["trial", experiment, *options, "--out", str(out), *more])


def pose_of(shown_transform) -> SE2:
    x, y, z = shown_transform.values["translation"]
    assert z == 0.0
    *_, sine, cosine = shown_transform.values["quaternion"]
    return SE2(x, y, 2.0 * np.arctan2(sine, cosine))


def test_a_trial_shows_truth_estimates_scans_and_words_and_its_line_stays_the_same(
    rerun, box_room, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("experiments.figures.trial_picture", lambda *_: "none")
    assert trial(box_room, tmp_path / "without") == 0
    line = capsys.readouterr().out
    recording = tmp_path / "new" / "trial.rrd"
    assert trial(box_room, tmp_path / "with", "--rerun", str(recording)) == 0
    printed = capsys.readouterr()
    assert printed.out == line
    assert f"Rerun recording: {recording}" in printed.err
    assert [path.name for path in recording.parent.iterdir()] == ["trial.rrd"]
    assert contents(tmp_path / "with") == contents(tmp_path / "without")
    record = json.loads(line)
    (truth,), (fast,) = rerun.of("truth/base"), rerun.of("fast/base")
    np.testing.assert_allclose(pose_of(truth).as_array(), record["true_poses"][-1], atol=1e-12)
    assert pose_of(fast).x == record["methods"]["fast"]["x_m"]
    (verdict,) = rerun.of("verdict/fast")
    assert verdict.content == "fast: tracking"
    (error,) = rerun.of("values/fast/error_mm")
    method = record["methods"]["fast"]
    expected_mm = 1e3 * np.hypot(method["x_error_m"], method["y_error_m"])
    assert error.content == pytest.approx(expected_mm)


@pytest.mark.slow
def test_the_scan_of_a_moving_robot_lies_on_the_walls_as_seen_from_where_it_truly_is(
    rerun, box_room, tmp_path
):
    out = [str(tmp_path / "trial.rrd"), "--duration", "2"]
    assert trial(box_room, tmp_path, "--rerun", *out, experiment="tracking") == 0
    walls_m = Place(box_room).map_at(0.1).points_m(0.01)
    transforms, scans = rerun.of("truth/base"), rerun.of("truth/base/scan")
    assert len(scans) == len(transforms) > 10
    last_m = pose_of(transforms[-1]) @ scans[-1].content[:, :2]
    off_m = [np.hypot(*(walls_m - point).T).min() for point in last_m]
    assert np.quantile(off_m, 0.9) < 0.05  # beams err by 1 %: four standard deviations at 2 m
    ways = [len(one.content[0]) for one in rerun.of("truth/path/0")]
    assert ways == list(range(2, len(scans) + 1))


@pytest.mark.slow
def test_a_place_mapped_shows_the_robot_where_methods_place_it_and_their_maps_in_the_end(
    rerun, tmp_path
):
    out = str(tmp_path / "trial.rrd")
    options = ["--method", "paper", "--place", "room_fig4", "--poses", "random"]
    main(["trial", "mapping", *options, "--out", str(tmp_path), "--rerun", out])
    first, last = rerun.of("paper/base")[0], rerun.of("paper/base")[-1]
    truths = rerun.of("truth/base")
    assert pose_of(first).is_near(pose_of(truths[0]), 0.01, 0.01)
    assert last.scan == truths[-1].scan
    (points,) = rerun.of("map/paper")
    assert points.scan == last.scan
    assert len(points.content) > 100


@pytest.mark.slow
def test_a_mapped_log_shows_scans_and_the_map_and_writes_the_same(rerun, mapped, tmp_path, capsys):
    recording = str(tmp_path / "slam.rrd")
    assert main(["slam", "--rerun", recording, str(LOG), "--out", str(tmp_path / "out")]) == 0
    assert contents(tmp_path / "out") == contents(mapped)
    poses = rerun.of("estimate/base")
    assert [one.scan for one in poses] == list(range(20))
    assert rerun.of("estimate/base/scan")[0].content.shape[1] == 3
    so_far = rerun.of("map/estimate")
    assert len(so_far[0].content) < len(so_far[-2].content)
    (grid,) = rerun.of("map/grid")
    assert grid.values["cell_size"] == 0.05
    assert rerun.of("verdict/map")[-1].content == "map: good"
    assert len(rerun.of("odometry/base")) == 20


@pytest.mark.slow
def test_reference_poses_are_shown_where_the_trajectory_fits_them(rerun, tmp_path):
    stream = ["--rerun", str(tmp_path / "slam.rrd")]
    main(["slam", str(LOG), "--reference", str(REFERENCE), "--out", str(tmp_path), *stream])
    (truth,) = [one for one in rerun.of("truth/path") if one.kind == "LineStrips3D"]
    (path,) = [one for one in rerun.of("estimate/path") if one.kind == "LineStrips3D"]
    ends = truth.content[0][-1, :2] - path.content[0][-1, :2]
    assert np.hypot(*ends) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("start", [["--start", "0", "0", "0.55"], []])
def test_a_localised_log_shows_map_and_words_and_writes_the_same(
    start, rerun, mapped, tmp_path, capsys
):
    known = ["localize", str(mapped / "map.yaml"), str(LOG), "--method", "fast", *start]
    status = main([*known, "--out", str(tmp_path / "without")])
    said = capsys.readouterr().out.splitlines()[0]
    stream = ["--rerun", str(tmp_path / "one.rrd")]
    assert main([*known, "--out", str(tmp_path / "with"), *stream]) == status
    assert capsys.readouterr().out.splitlines()[0] == said
    assert contents(tmp_path / "with") == contents(tmp_path / "without")
    (grid,) = rerun.of("map/grid")
    assert grid.scan is None
    assert len(rerun.of("map/walls")[0].content) > 10
    words = [one.content.split(";")[0] for one in rerun.of("verdict/estimate")]
    assert "estimate: tracking" in words
    # the places where a robot may be that has yet to find itself
    assert any(len(one.content) for one in rerun.of("estimate/places")) == (not start)


def test_the_rows_of_a_grid_are_turned_over_since_images_begin_above(rerun, tmp_path):
    cells = np.full((2, 3), FREE)
    cells[0, 0] = OCCUPIED  # lowest y
    with RerunStream(str(tmp_path / "grid.rrd"), "grid") as stream:
        stream.grid(OccupancyGrid(cells, 0.1, SE2(1.0, 2.0, 0.0)))
    (grid,) = rerun.of("map/grid")
    image = np.frombuffer(grid.values["data"], dtype=np.int8).reshape(2, 3)
    assert image[-1, 0] == OCCUPIED
    assert grid.values["translation"][:2] == [1.0, 2.0]


def test_a_second_pass_takes_off_what_the_first_one_showed(rerun, tmp_path):
    log = read_carmen(LOG)
    with RerunStream(str(tmp_path / "log.rrd"), "log") as stream:
        stream.at(0.0, 0)
        observer = RerunLog(stream)
        observer.begins(log)
        observer.begins(log)
    assert [one.kind for one in rerun.of("/")] == ["ViewCoordinates", "Clear"]
    (said,) = rerun.of("verdict/log")
    assert "mapped again" in said.content


def test_words_said_again_are_not_repeated_and_stamps_that_go_back_stay(rerun, tmp_path):
    with RerunStream(str(tmp_path / "log.rrd"), "log") as stream:
        for time_s, status in ((1.0, "lost"), (0.5, "lost"), (2.0, "tracking")):
            stream.at(time_s, 0)
            stream.says("limit", status)
    assert [one.content for one in rerun.of("verdict/limit")] == ["limit: lost", "limit: tracking"]
    assert [one.values["level"] for one in rerun.of("verdict/limit")] == ["ERROR", "INFO"]


@pytest.mark.parametrize(
    "command", [["slam", str(LOG)], ["localize", "map.yaml", str(LOG)], ["trial", "kidnap"]]
)
def test_without_the_library_one_line_names_the_extra_before_work_begins(
    command, tmp_path, capsys, monkeypatch
):
    monkeypatch.setitem(sys.modules, "rerun", None)
    said = refusal(capsys, *command, "--out", tmp_path / "out", "--rerun", tmp_path / "a.rrd")
    assert said == "--rerun needs the library rerun: pip install 'kitasap[rerun]'"
    assert not (tmp_path / "out").exists()


def test_a_recording_is_not_written_over(rerun, tmp_path, capsys):
    path = tmp_path / "finished.rrd"
    path.write_text("finished")
    said = refusal(capsys, "slam", LOG, "--out", tmp_path / "out", "--rerun", path)
    assert "is there already, and is not written over" in said
    assert path.read_text() == "finished"


def test_without_display_and_viewer_it_is_said_how_to_start_one(
    rerun, tmp_path, capsys, monkeypatch
):
    for display in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(display, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    with socket.socket() as unused:  # bound, so that nobody else listens there
        unused.bind(("127.0.0.1", 0))
        monkeypatch.setattr(rerun_stream, "_PORT", unused.getsockname()[1])
        said = refusal(capsys, "slam", "--rerun", LOG, "--out", tmp_path)
        assert "`rerun --serve-web --bind 127.0.0.1`, or name a file: --rerun FILE.rrd" in said
        unused.listen()
        with shown(rerun_stream.VIEWER, "here") as stream:
            assert stream is not None


def test_what_fails_leaves_no_half_recording(rerun, tmp_path, capsys):
    log = tmp_path / "broken.clf"
    log.write_text("FLASER 3 1 1\n")
    refusal(capsys, "slam", log, "--out", tmp_path / "out", "--rerun", tmp_path / "a.rrd")
    assert not list(tmp_path.glob("*.rrd")) + list(tmp_path.glob(".*"))


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        (["slam", "--rerun", "a.clf"], ["slam", "--rerun=", "a.clf"]),
        (["slam", "a.clf", "--rerun"], ["slam", "a.clf", "--rerun="]),
        (["slam", "--rerun", "a.rrd", "b.clf"], ["slam", "--rerun", "a.rrd", "b.clf"]),
        (["slam", "--rerun=a.rrd"], ["slam", "--rerun=a.rrd"]),
        (["slam", "--", "--rerun"], ["slam", "--", "--rerun"]),
        ([], []),
    ],
)
def test_a_viewer_is_meant_where_no_recording_is_named(typed, told):
    assert viewer_told(typed) == told


def test_the_library_itself_writes_what_its_own_reader_reads(tmp_path, mapped):
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    path = tmp_path / "slam.rrd"
    out = ["--out", str(tmp_path / "out")]
    assert main(["slam", str(LOG), *out, "--rerun", str(path)]) == 0
    assert contents(tmp_path / "out") == contents(mapped)
    rows: dict[str, int] = {}
    for chunk in RrdReader(path).stream():
        rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    assert rows["/estimate/base"] == rows["/estimate/base/scan"] == 20
    assert rows["/map/grid"] == 1
    assert rows["/verdict/map"] == 1

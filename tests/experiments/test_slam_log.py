"""`kitasap slam` on a stretch of a real log: what it writes, and what it refuses."""

import gzip
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from experiments.cli import main
from experiments.figures import slam_map
from experiments.known_maps import map_of_file
from experiments.slam_log import run
from experiments.slam_result import few_of, table
from slam import read_map, read_slam_map, read_tum
from slam.known_map import USUAL_LASER
from slam.open3d_backend import load_open3d
from slam.pose_graph import EdgeKernel, read_g2o
from slam.pose_lookup import PoseLookup
from slam.trajectory import Trajectory
from tests.experiments.refusals import refusal
from tests.slam.logs import shared_log

pytestmark = pytest.mark.usefixtures("own_folder")

DATA = Path(__file__).parents[1] / "data"

LOG = DATA / "fr101-excerpt.clf.gz"
REFERENCE = DATA / "fr101-excerpt.reference.tum"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("slam")
    assert main(["slam", str(LOG), "--out", str(out), "--reference", str(REFERENCE)]) == 0
    return out


def test_summary_tells_verdict_and_metrics(folder):
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["verdict"] == "good"
    assert summary["matched"] >= summary["scans"] - 2
    assert summary["cpu_s"]["warm_up"] > 0.0
    assert 0.0 <= summary["memory_mb"] < 150.0
    assert summary["evaluation"]["ate"]["translation_m"]["rmse"] < 0.1
    assert summary["evaluation"]["relations"]["all"]["coverage"] == 1.0


def test_log_of_which_no_scan_can_be_placed_is_named(tmp_path, capsys):
    # ranges in centimetres: but for four beams all are farther than any laser sees
    ranges = " ".join(["5000.00"] * 176 + ["30.1", "30.2", "30.3", "30.4"])
    tail = "0 0 0 0 0 0"
    lines = [f"FLASER 180 {ranges} {tail} {k} n {k}\n" for k in range(5)]
    (tmp_path / "cm.clf").write_text("".join(lines))
    assert main(["slam", str(tmp_path / "cm.clf"), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == (
        f"kitasap: {tmp_path / 'cm.clf'}: none of the 5 scans tells where it was taken: too few of its beams"
        " came back from within 80 m; expected ranges to walls, in metres"
    )
    assert not (tmp_path / "out" / "summary.json").exists()


def test_every_record_has_a_pose_and_every_keyframe_a_node(folder):
    summary = json.loads((folder / "summary.json").read_text())
    trajectory = read_tum(folder / "trajectory.tum")
    assert len(trajectory) == summary["records"] > summary["scans"]
    graph = read_g2o(folder / "pose_graph.g2o")
    assert graph.node_count == summary["keyframes"]
    is_loop = graph.edge_kernels == EdgeKernel.LOOP
    assert is_loop.sum() == summary["loops"] + summary["loops_rejected"]
    # of each step what the wheels told, and what the scans told beside it
    steps, counts = np.unique(graph.ends[~is_loop], axis=0, return_counts=True)
    assert len(steps) == summary["keyframes"] - 1
    assert (counts == 2).mean() > 0.9


def test_records_of_one_stamp_and_one_pose_of_the_wheels_are_at_one_place(folder):
    """Each scan of the log stands behind an odometry record of the same stamp."""
    trajectory = read_tum(folder / "trajectory.tum")
    is_double = np.diff(trajectory.times_s) == 0.0
    assert is_double.sum() >= 10
    steps = np.diff(trajectory.poses, axis=0)
    assert (steps[is_double] == 0.0).all()
    assert np.hypot(steps[~is_double, 0], steps[~is_double, 1]).max() > 0.01


def test_map_is_a_ros_map_with_walls_and_free_space(folder):
    grid = read_map(folder / "map.yaml")
    assert grid.is_free.sum() > 10_000
    assert grid.is_occupied.sum() > 500
    # where the robot drove nothing stands
    poses = read_tum(folder / "trajectory.tum").poses
    assert np.mean(grid.is_free_at(poses[:, :2])) > 0.98


def test_points_are_the_map_s_in_a_file_that_others_read(folder):
    cloud = load_open3d().io.read_point_cloud(str(folder / "points.ply"))
    points = np.asarray(cloud.points)
    of_map = read_slam_map(folder / "map.kitasap").points
    assert len(points) > 500
    np.testing.assert_allclose(points[:, :2], of_map, atol=1e-4)
    assert not points[:, 2].any()
    # on the walls of the grid, or a cell beside them
    occupied = read_map(folder / "map.yaml").points()
    off_m, _ = cKDTree(occupied).query(points[:, :2])
    assert np.mean(off_m < 0.1) > 0.95


def test_few_reasons_are_told_of_many():
    assert few_of(["a", "b", "c"]) == ["a", "b", "c"]
    assert few_of(list("abcde")) == ["a", "b", "and 3 more in summary.json"]


def test_picture_shows_the_reference_where_the_ate_lays_it(folder, tmp_path, monkeypatch):
    """It once showed the estimate alone, though a reference was given."""
    drawn: list[Figure] = []

    def keep(figure: Figure, _: Path) -> Path:
        drawn.append(figure)
        return tmp_path / "slam.png"

    monkeypatch.setattr(slam_map, "saved", keep)
    result = run(LOG, REFERENCE)
    slam_map.slam_map_picture(tmp_path, result)
    slam_map.slam_map_picture(tmp_path, replace(result, reference=None))
    with_it, without = ({line.get_label(): line for line in one.axes[0].lines} for one in drawn)
    assert set(with_it) - set(without) == {"reference, aligned"}
    reference = read_tum(REFERENCE)
    estimated = PoseLookup(result.trajectory).at(reference.times_s)[:, :2]

    def rmse_m(positions: np.ndarray) -> float:
        return float(np.sqrt(np.square(positions - estimated).sum(axis=1).mean()))

    ate_m = result.evaluation.absolute.position_m.rmse
    assert rmse_m(with_it["reference, aligned"].get_xydata()) == pytest.approx(ate_m)
    # as told it lies elsewhere
    assert rmse_m(reference.poses[:, :2]) > 1.3 * ate_m


def test_reference_is_not_drawn_where_the_log_has_no_pose():
    result = run(LOG, REFERENCE)
    reference = read_tum(REFERENCE)
    late = Trajectory(np.append(reference.times_s, 1e10), np.vstack([reference.poses, [9, 9, 0]]))
    way = replace(result, reference=late).reference_way()
    assert np.isnan(way[-1]).all()
    assert np.isfinite(way[:-1]).all()


def test_picture_is_there(folder):
    assert (folder / "slam.png").stat().st_size > 20_000


@pytest.mark.parametrize("content", ["", "no log at all\n"])
def test_foreign_file_is_refused_in_one_line(tmp_path, capsys, content):
    path = tmp_path / "foreign.clf"
    path.write_text(content)
    assert "foreign.clf" in refusal(capsys, "slam", path, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_reference_that_is_none_is_refused_before_the_log_is_mapped(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("experiments.slam_passes.Mapper", lambda *_: pytest.fail("mapped first"))
    path = tmp_path / "reference.tum"
    path.write_text("no poses\n")
    line = refusal(capsys, "slam", LOG, "--out", tmp_path / "out", "--reference", path)
    assert "reference.tum" in line
    path.write_text("")
    line = refusal(capsys, "slam", LOG, "--out", tmp_path / "out", "--reference", path)
    assert line.startswith(f"{path}: no pose in it")


@pytest.mark.slow
def test_robot_finds_itself_on_the_map_it_made(folder, tmp_path):
    arguments = ["localize", str(folder / "map.kitasap"), str(LOG), "--out", str(tmp_path)]
    assert main(arguments) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["start"] is None
    assert summary["tracking"] > 0.5 * summary["scans"]
    there, here = (read_tum(one / "trajectory.tum") for one in (folder, tmp_path))
    times_s = here.times_s[-10:]
    rows = [int(np.argmin(np.abs(there.times_s - time_s))) for time_s in times_s]
    off_m = np.hypot(*(there.poses[rows, :2] - here.poses[-10:, :2]).T)
    assert off_m.max() < 0.15


@pytest.fixture
def no_picture(monkeypatch):
    monkeypatch.setattr("experiments.figures.slam_map_picture", lambda *_: None)


@pytest.mark.usefixtures("no_picture")
@pytest.mark.parametrize("is_after", [True, False])
def test_log_with_a_long_way_and_no_scans_at_an_end_is_called_failed(tmp_path, capsys, is_after):
    lines = gzip.decompress(LOG.read_bytes()).decode().splitlines(keepends=True)
    told = [line.split() for line in lines if line.startswith("ODOM")][-1 if is_after else 0]
    stamp_s = float(told[-3])
    way = []
    for k in range(1, 31):
        # 0.3 m each: 9 m
        offset = k if is_after else k - 31
        told[1] = f"{float(told[1]) + 0.3:.4f}"
        told[-3] = told[-1] = f"{stamp_s + offset:.4f}"
        way.append(" ".join(told) + "\n")
    path = tmp_path / "way.clf"
    path.write_text("".join([*lines, *way] if is_after else [*way, *lines]))
    assert main(["slam", str(path), "--out", str(tmp_path / "out")]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "no scan tells where the robot is: these poses are the wheels' alone" in said
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert len(read_tum(tmp_path / "out" / "trajectory.tum")) == summary["records"]


@pytest.mark.usefixtures("no_picture")
def test_log_continues_a_map(folder, tmp_path, capsys):
    out = tmp_path / "both"
    arguments = ["slam", str(LOG), "--map", str(folder / "map.kitasap"), "--out", str(out)]
    assert main([*arguments, "--start", "0", "0", "0"]) == 0
    said = capsys.readouterr().out
    summary = json.loads((out / "summary.json").read_text())
    assert summary["verdict"] == "good"
    # which numbers are of the log, and which of the map
    for told in ("map of 2 sessions: good", "scans of this session: ", "CPU of this session: "):
        assert f"\n{told}" in said
    told = f"session 2, on map.kitasap: joined at scan {summary['joined_at']} of {summary['scans']}"
    assert told in said
    # where no scan but the end showed it
    at_end = table(summary | {"joined_at": None})
    assert "session 2, on map.kitasap: joined at its end" in at_end
    scans = summary["scans"]
    assert [(one["scans"], one["joined"]) for one in summary["sessions"]] == [(scans, True)] * 2
    # this log's records in the one, the scans of all sessions in the other
    assert len(read_tum(out / "trajectory.tum")) == summary["records"]
    assert len(read_tum(out / "sessions.tum")) == 2 * scans
    assert [line for line in (out / "sessions.tum").read_text().splitlines() if line[0] == "#"] == [
        "# time_s x y z qx qy qz qw", "# session 1", "# session 2",
    ]  # fmt: skip


@pytest.mark.usefixtures("no_picture")
def test_session_of_another_place_is_said_to_be_never_joined(folder, tmp_path, capsys):
    path = folder / "map.kitasap"
    arguments = ["slam", str(LOG), "--map", str(path), "--start", "9", "0", "1.5"]
    assert main([*arguments, "--out", str(tmp_path)]) == 1
    said = capsys.readouterr().out
    assert (
        "session 2, on map.kitasap: never joined (nothing that it saw confirms the --start" in said
    )
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["start"] == [9.0, 0.0, 1.5]
    searched = table(summary | {"start": None, "memory_mb": -12.0})
    assert "never joined (nothing that it saw was found on the map beyond doubt)" in searched
    assert "; memory did not grow" in searched
    assert "placed by no scan (the first one among them)" in said
    assert "map of 2 sessions: failed; session 2" in said
    line = refusal(capsys, "slam", LOG, "--map", tmp_path / "map.kitasap", "--out", tmp_path / "c")
    assert "session 2 of the map was never joined" in line
    # whoever localises on it is told
    _, (said,) = map_of_file(tmp_path / "map.kitasap", USUAL_LASER)
    assert said.startswith(
        f"{tmp_path / 'map.kitasap'} was called failed when it was made: session 2"
    )
    assert map_of_file(path, USUAL_LASER)[1] == ()


def test_map_to_continue_is_refused_in_one_line(folder, tmp_path, capsys):
    path = folder / "map.kitasap"
    assert "give --map as well" in refusal(capsys, "slam", LOG, "--start", "0", "0", "0")
    arguments = ("slam", LOG, "--map", "map.kitasap", "--start", "0", "0", "90")
    assert refusal(capsys, *arguments).startswith("--start takes radians, and 90 is more than")
    line = refusal(capsys, "slam", LOG, "--map", path, "--out", folder)
    assert "holds the map that is continued" in line
    line = refusal(capsys, "slam", LOG, "--map", folder / "map.pgm", "--out", tmp_path / "out")
    assert "map.pgm: expected a map" in line
    said = f"{folder} is a folder: give the map in it, {path}"
    assert refusal(capsys, "slam", LOG, "--map", folder, "--out", tmp_path / "out") == said
    assert refusal(capsys, "localize", folder, LOG, "--out", tmp_path / "out") == said
    line = refusal(capsys, "localize", folder / "map.pgm", LOG, "--out", tmp_path / "out")
    assert line.endswith("map.pgm is the picture of a ROS map: give the .yaml that belongs to it")
    np.savez(tmp_path / "maps.npz", points=np.zeros((3, 2)))
    for arguments in (
        ("localize", tmp_path / "maps.npz", LOG),
        ("slam", LOG, "--map", tmp_path / "maps.npz"),
    ):
        line = refusal(capsys, *arguments, "--out", tmp_path / "out")
        assert "maps.npz is an array file of NumPy" in line
    assert not (tmp_path / "out").exists()


def test_start_that_lies_farther_off_the_map_than_it_reaches_is_refused_before_the_log_is_mapped(
    folder, tmp_path, capsys, monkeypatch
):
    # mapped to its end, such a log once left nothing: no grid holds two maps a kilometre apart
    monkeypatch.setattr("experiments.slam_log.best_mapped", lambda *_: pytest.fail("mapped first"))
    arguments = ["slam", LOG, "--map", folder / "map.kitasap", "--out", tmp_path / "out"]
    line = refusal(capsys, *arguments, "--start", "1000", "1000", "0")
    assert line.startswith("--start 1000 1000 lies 13")
    assert "off the map, whose scans reach" in line
    assert not (tmp_path / "out").exists()


def test_map_that_no_grid_holds_is_written_but_for_its_grid(folder, tmp_path, capsys, monkeypatch):
    # as many cells as a room has
    monkeypatch.setattr("slam.ray_counts._MOST_CELLS", 10_000)
    for name in ("map.yaml", "map.pgm", "sessions.tum"):
        (tmp_path / name).write_text("of another map")
    assert main(["slam", str(LOG), "--out", str(tmp_path)]) == 1
    *_, said, _ = capsys.readouterr().out.splitlines()
    assert said.startswith("map.yaml and map.pgm could not be written: the beams span ")
    names = {path.name for path in folder.iterdir()} - {"map.yaml", "map.pgm"}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert (tmp_path / "slam.png").stat().st_size > 20_000
    assert (tmp_path / "map.kitasap").read_bytes() == (folder / "map.kitasap").read_bytes()


def test_map_that_is_cut_is_refused_in_one_line(folder, tmp_path, capsys):
    path = tmp_path / "map.kitasap"
    path.write_bytes((folder / "map.kitasap").read_bytes()[:1000])
    assert "map.kitasap: expected a map" in refusal(capsys, "localize", path, LOG)


@pytest.mark.slow
def test_rover_is_mapped_by_the_wheels_that_its_drive_shows(tmp_path):
    assert main(["slam", str(shared_log("mines-exp2.dat.gz")), "--out", str(tmp_path)]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    wheels = summary["wheels"]
    assert summary["verdict"] == "good"
    # walls as the wheels alone put them: 111 mm about themselves, and 81 to 91
    spread_m = wheels["spread_by_wheels_m"]
    assert spread_m["after"] < 0.9 * spread_m["before"]
    # the wheels assumed leave the first lap open
    assert wheels["used"] == "calibrated"
    # on the map itself, one drive tells nothing of that: `kitasap bench wheels`
    assert 0.0 < wheels["spread_of_map_m"]["after"] < 0.15
    # the two wheels are alike, and a turn of them turns the robot by 9 to 12 % more than assumed
    left, right = wheels["calibrated"]["wheel_radius_m"]
    assert left == pytest.approx(right, rel=0.01)
    ratio = wheels["calibrated"]["track_m"] / left * 0.077 / 0.33
    assert 0.88 < ratio < 0.93


def test_log_whose_laser_tells_nothing_is_refused_and_leaves_the_folder_as_it_was(tmp_path, capsys):
    log, out = tmp_path / "blind.clf", tmp_path / "out"
    for range_m in ("81.83", "nan", "0.0", "4000"):
        line = " ".join(["FLASER", "180", *[range_m] * 180, *["0"] * 6, "{}", "host", "{}"])
        log.write_text("\n".join(line.format(k, k) for k in range(3)) + "\n")
        said = f"{log}: none of the 3 scans has a beam that came back: "
        for command in (
            ("slam", log),
            ("real-log", log, "--protocol", "each", "--reference", REFERENCE),
            ("real-log", log, "--reference", REFERENCE),
        ):
            assert refusal(capsys, *command, "--out", out).startswith(said), range_m
    assert not out.exists()


def test_reference_of_another_log_or_no_folder_is_refused_before_the_log_is_mapped(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("experiments.slam_passes.Mapper", None)
    other, out = tmp_path / "other.tum", tmp_path / "out"
    other.write_text("0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n")
    said = refusal(capsys, "slam", LOG, "--reference", other, "--out", out)
    assert "is it that of another log?" in said
    assert not out.exists()
    other = tmp_path / "other.relations"
    other.write_text("0 1 1 0 0 0 0 0\n")
    said = refusal(capsys, "slam", LOG, "--relations", other, "--out", out)
    assert "is it that of another log?" in said
    said = refusal(capsys, "slam", LOG, "--out", "/proc/nowhere/out")
    assert "/proc" in said

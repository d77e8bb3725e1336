"""Files of other programs: there and back, and read by the programs themselves."""

import gzip
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from experiments.cli import main
from slam.files.kitti_files import read_kitti, read_trajectory, write_kitti
from slam.files.map_files import read_map
from slam.files.slam_map_files import read_slam_map, write_slam_map
from slam.mapping import Mapper
from slam.open3d_backend import load_open3d
from slam.pose_graph import read_g2o
from slam.readers.bag_files import Bag
from slam.readers.recognition import read_log
from slam.trajectory import Trajectory, read_tum, write_tum
from tests.slam.ring import T_BASE_LASER, drive, way
from tests.slam.turtlebot import Frames, Recording, write_bag

LOG = Path(__file__).parents[1] / "data" / "fr101-excerpt.clf.gz"
PROGRAMS = Path(sys.executable).parent


def converted(source: Path, target: Path, *options: str) -> Path:
    assert main(["convert", str(source), str(target), *options]) == 0
    return target


def refused(capsys, *arguments) -> str:
    """What the command says of arguments that it refuses, in one line."""
    assert main(list(map(str, arguments))) == 2
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) == 1
    return said


def some_poses(count: int = 40) -> Trajectory:
    rng = np.random.default_rng(2)
    return Trajectory(10.0 + np.arange(count), rng.normal(0.0, 2.0, (count, 3)))


def assert_same_log(found: Path, expected: Path, *, has_times: bool) -> None:
    """The same scans at the same poses; odometry records may be more, at the scans themselves."""
    ours, theirs = read_log(found), read_log(expected)
    assert ours.T_base_laser.is_near(theirs.T_base_laser, 1e-5, 1e-5)
    pairs = zip(ours.measurements(), theirs.measurements(), strict=True)
    for one, other in pairs:
        assert one.time_s == pytest.approx(other.time_s, abs=2e-6)
        assert one.motion.is_near(other.motion, 1e-5, 1e-5)
        assert one.scan.angles_rad == pytest.approx(other.scan.angles_rad, abs=1e-5)
        told = np.where(other.scan.ranges_m == -np.inf, np.nan, other.scan.ranges_m)
        seen = np.where(one.scan.ranges_m == -np.inf, np.nan, one.scan.ranges_m)
        assert seen == pytest.approx(told, abs=1e-4, nan_ok=True)
        if has_times:
            assert one.scan.beam_times_s == pytest.approx(other.scan.beam_times_s, abs=2e-6)


def test_carmen_log_goes_to_a_bag_and_back(tmp_path):
    bag = converted(LOG, tmp_path / "fr101.mcap")
    assert_same_log(bag, LOG, has_times=False)
    back = converted(bag, tmp_path / "fr101.clf.gz")
    assert gzip.decompress(back.read_bytes()).startswith(b"# ODOM")
    assert_same_log(back, LOG, has_times=False)


def test_no_frame_is_told_twice_at_the_same_time(tmp_path):
    # the scans of the log have the stamps of the odometry beside them
    stamps_s = [record.time_s for record in read_log(LOG).records]
    assert len(set(stamps_s)) < len(stamps_s)
    bag = Bag(converted(LOG, tmp_path / "fr101.mcap"))
    headers = [one.content.transforms[0].header for one in bag.messages(["/tf"])]
    told = [(header.stamp.sec, header.stamp.nanosec) for header in headers]
    assert told == sorted(set(told))
    assert len(told) == len(set(stamps_s))


def test_bag_goes_to_carmen_and_to_another_bag(tmp_path):
    write_bag(tmp_path / "robot", Recording(duration_s=2.0), frames=Frames(flip=True))
    assert_same_log(
        converted(tmp_path / "robot", tmp_path / "a.mcap"), tmp_path / "robot", has_times=True
    )
    assert_same_log(
        converted(tmp_path / "robot", tmp_path / "a.clf"), tmp_path / "robot", has_times=False
    )


def test_odometry_of_a_bag_is_a_trajectory_by_its_topic(tmp_path, capsys):
    recording = Recording(duration_s=1.0)
    write_bag(tmp_path / "robot", recording)
    found = read_tum(converted(tmp_path / "robot", tmp_path / "o.tum", "--topic", "/odom"))
    found = found.in_order()
    assert found.times_s == pytest.approx([t for t, _ in recording.odometry], abs=1e-6)
    assert found.poses == pytest.approx(
        np.array([T.as_array() for _, T in recording.odometry]), abs=1e-6
    )
    said = refused(capsys, "convert", tmp_path / "robot", tmp_path / "p.tum", "--topic", "/scan")
    assert "/scan is no topic of nav_msgs/msg/Odometry, geometry_msgs/msg/PoseStamped" in said


def test_trajectory_goes_to_kitti_and_back(tmp_path):
    expected = some_poses()
    write_tum(tmp_path / "a.tum", expected)
    kitti = converted(tmp_path / "a.tum", tmp_path / "a.kitti")
    assert {len(line.split()) for line in kitti.read_text().splitlines()} == {12}
    back = read_tum(converted(kitti, tmp_path / "b.tum"))
    assert back.times_s.tolist() == list(range(40))
    assert back.poses == pytest.approx(expected.poses, abs=1e-8)


@pytest.mark.slow
@pytest.mark.skipif(not (PROGRAMS / "evo_ape").exists(), reason="evo is not installed")
def test_evaluate_and_evo_say_the_same_of_kitti(tmp_path):
    true = some_poses()
    rng = np.random.default_rng(5)
    wrong = Trajectory(true.times_s, true.poses + rng.normal(0.0, 0.05, true.poses.shape))
    write_kitti(tmp_path / "true.kitti", true)
    write_kitti(tmp_path / "est.kitti", wrong)
    names = [str(tmp_path / name) for name in ("est.kitti", "true.kitti")]
    assert main(["evaluate", *names, "--out", str(tmp_path)]) == 0
    ours = json.loads((tmp_path / "evaluation.json").read_text())["ate"]["translation_m"]
    result = tmp_path / "ape.zip"
    subprocess.run(
        [str(PROGRAMS / "evo_ape"), "kitti", *names[::-1], "--align", "--save_results", str(result)],
        check=True, capture_output=True, env=os.environ | {"HOME": str(tmp_path)},
    )  # fmt: skip
    with zipfile.ZipFile(result) as archive:
        theirs = json.loads(archive.read("stats.json"))
    assert ours["rmse"] == pytest.approx(theirs["rmse"], abs=1e-6)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("1 0 0 0 0 1 0 0 0 0 1", "expected 12 numbers, found 11"),
        ("1 0 0 0 0 1 0 0 0 0 1 nan", "not finite"),
        ("2 0 0 0 0 1 0 0 0 0 1 0", "are no rotation"),
        ("1 0 0 0 0 0 1 0 0 -1 0 0", "z does not point up"),
        ("1 0 0 1e9 0 1 0 0 0 0 1 0", "none beyond 1e+08"),
        ("1 0 0 0 0 1 0 0 0 0 1 x", "expected a number"),
    ],
)
def test_kitti_line_that_is_none_is_named(tmp_path, line, said):
    (tmp_path / "a.kitti").write_text(f"1 0 0 0 0 1 0 0 0 0 1 0\n{line}\n")
    with pytest.raises(ValueError, match=r"/a\.kitti line 2: ") as caught:
        read_kitti(tmp_path / "a.kitti")
    assert said in str(caught.value)


def test_stamps_and_lines_are_not_matched(tmp_path, capsys):
    write_tum(tmp_path / "a.tum", some_poses())
    write_kitti(tmp_path / "a.kitti", some_poses())
    write_kitti(tmp_path / "b.kitti", some_poses(30))
    said = refused(capsys, "evaluate", tmp_path / "a.tum", tmp_path / "a.kitti")
    assert "expected stamps in both, or in neither and as many poses" in said
    assert "30 without" in refused(capsys, "evaluate", tmp_path / "a.kitti", tmp_path / "b.kitti")
    assert [read_trajectory(tmp_path / name)[1] for name in ("a.tum", "a.kitti")] == [True, False]


@pytest.fixture(scope="module")
def made_map(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("map") / "map.kitasap"
    mapper = Mapper(T_BASE_LASER)
    for measurement in drive(way(0.15), np.random.default_rng(1)):
        mapper.update(measurement)
    write_slam_map(path, mapper.finish())
    return path


@pytest.mark.parametrize("end", ["ply", "pcd"])
def test_points_of_a_map_are_read_by_open3d(tmp_path, made_map, end):
    path = converted(made_map, tmp_path / f"points.{end}")
    points = np.asarray(load_open3d().io.read_point_cloud(str(path)).points)
    expected = read_slam_map(made_map).points
    assert points[:, :2] == pytest.approx(expected, abs=6e-5)
    assert (points[:, 2] == 0.0).all()


def test_map_goes_to_ros_to_g2o_and_on(tmp_path, made_map):
    slam_map = read_slam_map(made_map)
    converted(made_map, tmp_path / "map.pgm")
    grid = read_map(tmp_path / "map.yaml")
    assert grid.cells.shape == slam_map.grid().cells.shape
    converted(tmp_path / "map.yaml", tmp_path / "again.png")
    assert (read_map(tmp_path / "again.yaml").cells == grid.cells).all()
    points = load_open3d().io.read_point_cloud(
        str(converted(tmp_path / "map.yaml", tmp_path / "grid.pcd"))
    )
    assert np.asarray(points.points)[:, :2] == pytest.approx(grid.points(), abs=6e-5)
    graph = read_g2o(converted(made_map, tmp_path / "graph.g2o"))
    assert graph.poses == pytest.approx(slam_map.graph.poses)
    again = read_g2o(converted(tmp_path / "graph.g2o", tmp_path / "again.g2o"))
    assert again.poses.tolist() == graph.poses.tolist()
    found = read_tum(converted(made_map, tmp_path / "map.tum"))
    assert found.poses == pytest.approx(slam_map.trajectory.poses, abs=2e-9)


def test_what_cannot_be_made_is_said_with_what_can(tmp_path, capsys):
    write_tum(tmp_path / "a.tum", some_poses())
    said = refused(capsys, "convert", tmp_path / "a.tum", tmp_path / "a.ply")
    assert said == f"kitasap: of {tmp_path}/a.tum no '.ply' can be made, but .tum, .kitti"
    write_tum(tmp_path / "b.tum", some_poses())
    said = refused(capsys, "convert", tmp_path / "a.tum", tmp_path / "b.tum")
    assert "is there already, and is not written over" in said
    said = refused(capsys, "convert", tmp_path / "a.tum", tmp_path / "c.tum", "--topic", "/odom")
    assert "--topic is one of a ROS bag" in said
    assert "No such file" in refused(capsys, "convert", tmp_path / "x.clf", tmp_path / "x.mcap")
    assert not (tmp_path / "x.mcap").exists()

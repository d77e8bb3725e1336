"""Targets that read a file: valid ones, small, to begin with, and what a result must be."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import math
import zipfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments.fuzzing.targets import Reading

if TYPE_CHECKING:
    from slam.trajectory import Trajectory

_Made = tuple[list[bytes], Reading]
_FEW_FIELDS = 24


def carmen(_: Path) -> _Made:
    """Logs of each of CARMEN's laser lines."""
    ranges = " ".join(f"{1.0 + 0.1 * k:.2f}" for k in range(8))
    odometry = [f"ODOM 0.{k} 0 0.0{k} 0 0 0 1{k}.0 host {k}.0" for k in range(4)]
    poses = "0.3 0 0 0.2 0 0"
    flaser = [f"FLASER 8 {ranges} {poses} 1{k}.5 host {k}.5" for k in range(4)]
    head = f"0 -1.57 3.14 0.4 81.9 0.01 0 8 {ranges}"
    robot = [f"ROBOTLASER1 {head} 0 {poses} 0 0 0 0 0 1{k}.5 host {k}.5" for k in range(4)]
    raw = [f"RAWLASER2 {head} 2 1 1 1{k}.5 host {k}.5" for k in range(4)]
    parameters = [
        "# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp",
        "PARAM laser_front_laser_resolution 1.0 0 host 0",
        "PARAM robot_frontlaser_offset 0.1 0 host 0",
    ]
    texts = [
        "\n".join([*parameters, *(line for pair in zip(odometry, lines, strict=True) for line in pair)])
        for lines in (flaser, robot, raw)
    ]  # fmt: skip
    seeds = [f"{text}\n".encode() for text in (*texts, "\n".join(raw))]
    return [*seeds, gzip.compress(seeds[0], mtime=0)], read_log_wholly("log.txt")


def ticks(_: Path) -> _Made:
    """Logs of encoder ticks."""
    lines = []
    for k in range(6):
        head = [str(k * 100_000), "0", str(k * 50), str(k * 40)] + ["0"] * (_FEW_FIELDS - 4)
        lines.append(" ".join([*head, *(str(1000 + 10 * k + beam) for beam in range(12))]))
    text = "\n".join(lines) + "\n"
    return [text.encode(), f"# mines\n{text}".encode()], read_log_wholly("log.dat")


def read_log_wholly(name: str) -> Reading:
    """Reads a log of any kind, with all of its records."""
    from slam.readers.recognition import read_log

    def read(data: bytes, folder: Path) -> None:
        log = read_log(_written(folder / name, data))
        count = 0
        for measurement in log.measurements():
            _check_finite(measurement.motion.as_array(), measurement.motion_covariance)
            count += 1
        assert count == log.scan_count, f"{count} scans, {log.scan_count} told"
        _check_finite(log.T_base_laser.as_array())

    return read


def ros_map(folder: Path) -> _Made:
    """Maps of map_server: the YAML file, a line of =, the image."""
    from slam.files.map_files import ImageFormat, MapMode, read_map, write_map
    from slam.occupancy_grid import OccupancyGrid
    from slam.se2 import SE2

    between = b"\n====\n"
    cells = np.random.default_rng(0).choice([-1, 0, 100], (9, 7)).astype(np.int8)
    grid = OccupancyGrid(cells, 0.05, SE2(1.0, 2.0, 0.0))
    seeds = []
    kinds: list[tuple[MapMode, ImageFormat]] = [
        ("trinary", "pgm"), ("trinary", "png"), ("scale", "png"), ("raw", "pgm"),
    ]  # fmt: skip
    for mode, image in kinds:
        write_map(folder / "m.yaml", grid, mode, image)
        text = (
            (folder / "m.yaml").read_bytes().replace(b"m.png", b"m.img").replace(b"m.pgm", b"m.img")
        )
        seeds.append(text + between + (folder / f"m.{image}").read_bytes())

    def read(data: bytes, folder: Path) -> None:
        text, _, image = data.partition(between)
        _written(folder / "m.img", image)
        found = read_map(_written(folder / "m.yaml", text))
        assert (found.cells >= -1).all(), "a cell below -1"
        assert (found.cells <= 100).all(), "a cell above 100"
        _check_finite(found.T_map_grid.as_array(), np.array([found.resolution_m]))

    return seeds, read


def slam_map(folder: Path) -> _Made:
    """Maps kept by this library. Inputs other than zip files are the arrays, one after the other:
    the check sums of zip files would refuse nearly all that is changed."""
    from experiments.fuzzing.room import T_BASE_LASER, drive
    from slam.files.slam_map_files import read_slam_map, write_slam_map
    from slam.mapping import Mapper

    mapper = Mapper(T_BASE_LASER)
    for _, measurement in drive(12, 40):
        mapper.update(measurement)
    write_slam_map(folder / "kept.kitasap", mapper.finish())
    whole = (folder / "kept.kitasap").read_bytes()
    with zipfile.ZipFile(io.BytesIO(whole)) as archive:
        names = archive.namelist()
        members = b"".join(archive.read(name) for name in names)

    def read(data: bytes, folder: Path) -> None:
        if not data.startswith(b"PK"):
            data = _zipped(names, data)
        found = read_slam_map(_written(folder / "m.kitasap", data))
        _check_finite(found.poses, found.trajectory.poses, found.trajectory.times_s, found.points)

    return [members, whole], read


def _zipped(names: list[str], data: bytes) -> bytes:
    """Arrays one after the other as the members of a zip file, by these names."""
    magic = b"\x93NUMPY"
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name, member in zip(names, data.split(magic)[1:], strict=False):
            archive.writestr(name, magic + member)
    return content.getvalue()


def g2o(_: Path) -> _Made:
    """Pose graphs."""
    from slam.pose_graph.g2o import read_g2o

    nodes = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0.1\nVERTEX_SE2 2 2 0.1 0.2\nFIX 0\n"
    edges = "".join(
        f"EDGE_SE2 {i} {j} 1 0 0.1 100 0 0 100 0 400\n" for i, j in ((0, 1), (1, 2), (0, 2))
    )
    own = f"# kitasap pose graph, version 1: 3 nodes, 3 edges\n{nodes}# kernel LOOP\n{edges}"

    def read(data: bytes, folder: Path) -> None:
        graph = read_g2o(_written(folder / "graph.g2o", data))
        _check_finite(graph.measured, graph.information, graph.poses)

    return [(nodes + edges).encode(), own.encode()], read


def tum(_: Path) -> _Made:
    """Trajectories as TUM has them."""
    from slam.trajectory import read_tum

    text = "# t x y z qx qy qz qw\n" + "".join(f"{k}.5 {k} 0.1 0 0 0 0 1\n" for k in range(4))
    return [text.encode()], _read_trajectory("t.tum", read_tum)


def kitti(_: Path) -> _Made:
    """Trajectories as KITTI has them, or told by their first line."""
    from slam.files.kitti_files import read_kitti, read_trajectory

    text = "".join(f"1 0 0 {k} 0 1 0 0.1 0 0 1 0\n" for k in range(4)).encode()

    def read(path: Path) -> Trajectory:
        try:
            read_trajectory(path)
        except ValueError as error:
            check_refusal(error, path.name)
        return read_kitti(path)

    return [text], _read_trajectory("t.kitti", read)


def relations(_: Path) -> _Made:
    """Relations."""
    from slam.metrics.relation_files import read_relations

    lines = "".join(f"{k}.5 {k + 9}.5 1 0.5 0 0 0 0.1\n" for k in range(4))
    text = f"# timestamp1 timestamp2 x y z roll pitch yaw\n{lines}".encode()

    def read(data: bytes, folder: Path) -> None:
        found = read_relations(_written(folder / "all.relations", data))
        _check_finite(found.times_s, found.motions)

    return [text], read


def plan(_: Path) -> _Made:
    """Floor plans, and the boxes that they are made of."""
    from experiments.plan_example import EXAMPLE
    from experiments.plan_files import read_plan

    def read(data: bytes, folder: Path) -> None:
        found = read_plan(_written(folder / "plan.yaml", data))
        for solid in found.solids():
            _check_finite(
                np.array([value for value in vars(solid).values() if isinstance(value, float)])
            )

    small = b"walls:\n- line: [[0, 0], [4, 0], [4, 3]]\n  closed: yes\n  doors: [[1, 2]]\n"
    return [EXAMPLE.encode(), small], read


def house(_: Path) -> _Made:
    """Houses of HouseExpo, and the boxes that they are made of."""
    from experiments.house_files import read_house

    corners = [[0, 0], [4.5, 0], [4.5, 3], [2, 3], [2, 2], [0, 2.5]]
    fields = {"verts": corners, "room_num": 3, "id": "a", "bbox": {"min": [0, 0], "max": [4.5, 3]}}

    def read(data: bytes, folder: Path) -> None:
        found = read_house(_written(folder / "house.json", data))
        _check_finite(found.corners_m)
        try:
            blocks = found.blocks(1.0)
        except ValueError as error:  # as documented; it knows no file
            check_refusal(error, None)
            return
        _check_finite(np.array([[b.x_m, b.y_m, b.width_m, b.depth_m] for b in blocks]))

    return [json.dumps(fields).encode()], read


def baseline(_: Path) -> _Made:
    """Baselines of the gate. Where an input is JSON the digest is made to fit: it would refuse nearly
    all that is changed."""
    from experiments.gate.baseline import FORMAT, read_baseline
    from experiments.trials import TrialConfig

    config = asdict(TrialConfig(methods=("limit",)))
    values = {"limit": {"failed": [0, 0, 1], "position_error_m": [0.001, 0.002, None]}}
    run = {
        "experiment": "kidnap", "config": config, "seed": 0, "trials": 3, "inputs": {},
        "results": "0123456789abcdef", "values": values,
    }  # fmt: skip
    text = json.dumps({"kitasap_baseline": FORMAT, "digest": "", "runs": [run]})

    def read(data: bytes, folder: Path) -> None:
        try:
            content = json.loads(data)
            runs = json.dumps(content["runs"], sort_keys=True)
            content["digest"] = hashlib.sha256(runs.encode()).hexdigest()[:16]
            data = json.dumps(content).encode()
        except (ValueError, KeyError, TypeError, RecursionError):
            pass  # damaged on the way to the digest: read as it is
        for found in read_baseline(_written(folder / "baseline.json", data)):
            for told in found.values.values():
                for numbers in told.values():
                    assert all(one is None or math.isfinite(one) for one in numbers)

    return [text.encode()], read


def check_refusal(error: Exception, name: str | None) -> None:
    """Raises AssertionError for a refusal that is not one line, or does not name the file."""
    said = str(error)
    assert said.strip(), "a refusal without a word"
    assert len(said.splitlines()) == 1, f"a refusal of several lines: {said[:300]!r}"
    assert len(said) < 1000, f"a refusal of {len(said)} letters: {said[:300]!r}"
    assert name is None or name in said, f"a refusal that does not name the file: {said[:300]!r}"


def _read_trajectory(name: str, read_file: Callable[[Path], Trajectory]) -> Reading:
    def read(data: bytes, folder: Path) -> None:
        found = read_file(_written(folder / name, data))
        _check_finite(found.poses, found.times_s)

    return read


def _written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def _check_finite(*arrays: np.ndarray) -> None:
    for array in arrays:
        assert np.isfinite(array).all(), "a result that is not finite"

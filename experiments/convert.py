"""Files turned into those of other programs, by the ends of their names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from experiments.evaluation import odometry_of_log
from experiments.log_writing import write_bag, write_carmen
from experiments.outputs import checked_bag, checked_file
from slam.files.kitti_files import read_trajectory, write_kitti
from slam.files.map_files import read_map, write_map
from slam.files.point_files import write_pcd, write_ply
from slam.files.slam_map_files import read_slam_map
from slam.occupancy_grid import OccupancyGrid
from slam.pose_graph import read_g2o, write_g2o
from slam.readers.log import Log, LogChoice
from slam.readers.recognition import read_log
from slam.slam_map import SlamMap
from slam.trajectory import Trajectory, write_tum

T = TypeVar("T")

_LOGS: dict[str, Callable[[Path, Log], None]] = {
    ".clf": write_carmen,
    ".clf.gz": write_carmen,
    ".mcap": write_bag,
    ".tum": lambda path, log: write_tum(path, odometry_of_log(log)),
    ".kitti": lambda path, log: write_kitti(path, odometry_of_log(log)),
}
_TRAJECTORIES: dict[str, Callable[[Path, Trajectory], None]] = {
    ".tum": write_tum,
    ".kitti": write_kitti,
}
_GRIDS: dict[str, Callable[[Path, OccupancyGrid], None]] = {
    ".ply": lambda path, grid: write_ply(path, grid.points()),
    ".pcd": lambda path, grid: write_pcd(path, grid.points()),
    ".pgm": lambda path, grid: write_map(path.with_suffix(".yaml"), grid, image="pgm"),
    ".png": lambda path, grid: write_map(path.with_suffix(".yaml"), grid, image="png"),
    ".yaml": write_map,
}
_MAPS: dict[str, Callable[[Path, SlamMap], None]] = {
    ".ply": lambda path, slam_map: write_ply(path, slam_map.points),
    ".pcd": lambda path, slam_map: write_pcd(path, slam_map.points),
    ".g2o": lambda path, slam_map: write_g2o(path, slam_map.graph),
    ".tum": lambda path, slam_map: write_tum(path, slam_map.trajectory),
    ".kitti": lambda path, slam_map: write_kitti(path, slam_map.trajectory),
    ".pgm": lambda path, slam_map: _GRIDS[".pgm"](path, slam_map.grid()),
    ".png": lambda path, slam_map: _GRIDS[".png"](path, slam_map.grid()),
    ".yaml": lambda path, slam_map: write_map(path, slam_map.grid()),
}


def convert(
    source: Path, target: Path, topic: str | None = None, choice: LogChoice | None = None
) -> str:
    """Turns a file into another; in words, what was written.

    topic: of a bag, the poses to make a trajectory of. choice: of what a log leaves open. Raises
    ValueError for a source that is none or cannot become what the target's name asks for, or a target
    that is there already; OSError for what cannot be read or written.
    """
    end = ".clf.gz" if target.name.endswith(".clf.gz") else target.suffix
    if topic is not None:
        if source.suffix in (".tum", ".kitti", ".kitasap", ".yaml", ".g2o"):
            raise ValueError(f"--topic is one of a ROS bag, and {source} is none")
        write = _writer(source, target, end, _TRAJECTORIES)
        trajectory = _of_topic(source, topic)
        write(target, trajectory)
        return f"{target}: {len(trajectory)} poses of {topic}"
    if source.suffix in (".tum", ".kitti"):
        write = _writer(source, target, end, _TRAJECTORIES)
        trajectory, _ = read_trajectory(source)
        if len(trajectory) == 0:
            raise ValueError(f"{source}: no pose in it")
        write(target, trajectory)
        return f"{target}: {len(trajectory)} poses"
    if source.suffix == ".kitasap":
        write_slam = _writer(source, target, end, _MAPS)
        slam_map = read_slam_map(source)
        write_slam(target, slam_map)
        return f"{target}: map of {len(slam_map.keyframes)} keyframes"
    if source.suffix in (".yaml", ".yml"):
        write_grid = _writer(source, target, end, _GRIDS)
        grid = read_map(source)
        write_grid(target, grid)
        return f"{target}: map of {grid.cells.shape[1]} x {grid.cells.shape[0]} cells"
    if source.suffix == ".g2o":
        write_graph = _writer(source, target, end, {".g2o": write_g2o})
        graph = read_g2o(source)
        write_graph(target, graph)
        return f"{target}: graph of {graph.node_count} poses"
    write_log = _writer(source, target, end, _LOGS)
    log = read_log(source, choice)
    write_log(target, log)
    return "\n".join([*log.notes, f"{target}: {log.scan_count} scans, {len(log.records)} records"])


def _writer(
    source: Path, target: Path, end: str, writers: dict[str, Callable[[Path, T], None]]
) -> Callable[[Path, T], None]:
    """What writes a target, if it can be made of the source and is not there yet."""
    if end not in writers:
        raise ValueError(
            f"of {source} no '{end or target.name}' can be made, but {', '.join(writers)}"
        )
    if end == ".mcap":
        checked_bag(target)
    pair = [target.with_suffix(".yaml")] if end in (".pgm", ".png") else []
    pair += [target.with_suffix(".pgm")] if end == ".yaml" else []
    for path in (target, *pair):
        if path.exists():
            raise ValueError(f"{path} is there already, and is not written over: move it away")
    checked_file(target)
    target.parent.mkdir(parents=True, exist_ok=True)
    return writers[end]


def _of_topic(source: Path, topic: str) -> Trajectory:
    from slam.readers.bag_trajectory import read_bag_trajectory

    return read_bag_trajectory(source, topic)

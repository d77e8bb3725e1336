"""Maps that recorded logs are localised on: made from reference poses, or read from a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Self

import numpy as np

from experiments.protocols import DEFAULT_METHOD
from slam.arrays import FloatArray
from slam.beams import Beams
from slam.files.map_files import read_map
from slam.files.slam_map_files import read_slam_map
from slam.known_map import USUAL_LASER, KnownMap, reach_m
from slam.laser_model import LaserModel
from slam.measurements import Measurement
from slam.point_map import PointMap
from slam.range_noise import RangeNoise
from slam.ray_counts import still_standing
from slam.readers.log import Log
from slam.readers.recognition import is_log
from slam.se2 import SE2
from slam.slam_map import SlamMap

_ASKED_SCANS = 500
"""Of a log, at most twice as many, how far they saw."""
_ARRAYS = (".npy", ".npz")
_PICTURES = (".pgm", ".png")
"""Of maps, as map_server and we write them."""
_DESCRIPTIONS = (".yaml", ".yml")
"""Of the same maps."""


@dataclass(frozen=True)
class LogConfig:
    """What is assumed of a recorded log and its laser; the same for every log.

    method: open3d, fast or limit. range_max_m: what lies farther is left out, of map and scans, but
    of a log that is localised on a map: see `seeing`. range_sigma_m: noise of a range. Both as of
    `USUAL_LASER`.
    """

    method: str = DEFAULT_METHOD["localize"]
    range_max_m: float = USUAL_LASER.range_max_m
    range_sigma_m: float = USUAL_LASER.noise.sigma_at_m[0][1]

    @property
    def laser(self) -> LaserModel:
        """The laser assumed."""
        return LaserModel(RangeNoise(((0.0, self.range_sigma_m),)), 0.0, self.range_max_m)

    def seeing(self, log: Log) -> Self:
        """The same, as far as most of what the log saw: see `slam.known_map.reach_m`."""
        every = max(1, log.scan_count // _ASKED_SCANS)
        scans = (record.scan for record in log.records if record.scan is not None)
        hits_m = [scan.ranges_m[scan.is_hit] for scan in islice(scans, 0, None, every)]
        reach = reach_m(np.concatenate([np.zeros(0), *hits_m]))
        return replace(self, range_max_m=max(self.range_max_m, reach))


def map_of_scans(
    rows: Sequence[tuple[Measurement, SE2]],
    T_base_laser: SE2,
    spacing_m: float,
    laser: LaserModel,
) -> KnownMap:
    """The map that scans make from where they were taken; what has gone since is left out."""
    points = points_of_scans(rows, T_base_laser, spacing_m)
    seen = [(T_map_base, Beams.of(m.scan, T_base_laser)) for m, T_map_base in rows]
    return KnownMap(points[still_standing(points, seen)], laser, spacing_m=spacing_m)


def points_of_scans(
    rows: Sequence[tuple[Measurement, SE2]], T_base_laser: SE2, spacing_m: float
) -> FloatArray:
    """(K, 2) all that scans saw from where they were taken, thinned to a spacing [m]."""
    point_map = PointMap(np.empty((0, 2)), spacing_m)
    for measurement, T_map_base in rows:
        point_map.integrate(T_map_base @ measurement.scan.points(T_base_laser))
    return point_map.points


def check_is_no_folder(path: Path) -> None:
    """Raises ValueError for a folder in place of a map."""
    if path.is_dir():
        within = sorted(path.glob("*.kitasap")) or sorted(path.glob("*.yaml"))
        instead = f"the map in it, {within[0]}" if within else "the file of a map"
        raise ValueError(f"{path} is a folder: give {instead}")


def _check_are_no_arrays(path: Path) -> None:
    """Raises ValueError for what NumPy saved in place of a map."""
    if path.suffix in _ARRAYS and path.exists():
        raise ValueError(
            f"{path} is an array file of NumPy: a map is the map.kitasap that slam wrote, or, to"
            " localise on, a map.yaml with its picture"
        )


def map_to_continue(path: Path) -> SlamMap:
    """One of ours. Raises ValueError or OSError for a file that is none, and says what it seems to be."""
    check_is_no_folder(path)
    _check_are_no_arrays(path)
    if is_log(path):
        raise ValueError(
            f"{path}: is a log and no map: --map takes the map.kitasap that slam wrote, and the"
            " log stands without an option"
        )
    if path.suffix in _DESCRIPTIONS and path.exists():
        raise ValueError(
            f"{path}: is a ROS map, which cannot be continued: give the map.kitasap that slam wrote"
        )
    return read_slam_map(path)


def check_is_map(path: Path) -> None:
    """Raises ValueError for a folder, a log, arrays or a picture in place of a map."""
    check_is_no_folder(path)
    _check_are_no_arrays(path)
    if is_log(path):
        raise ValueError(
            f"{path}: is a log and no map: the map (map.yaml or map.kitasap) comes first, then"
            " the log"
        )
    if path.suffix in _PICTURES and path.exists():
        raise ValueError(f"{path} is the picture of a ROS map: give the .yaml that belongs to it")


def map_of_file(path: Path, laser: LaserModel) -> tuple[KnownMap, tuple[str, ...]]:
    """A ROS map, or one of ours, and what is to be said of it. Raises ValueError or OSError for a file
    that is none, or shows no wall."""
    check_is_map(path)
    if path.suffix == ".kitasap":
        slam_map = read_slam_map(path)
        reasons = slam_map.verdict.reasons
        said = (f"{path} was called failed when it was made: {reasons[0]}",) if reasons else ()
        return slam_map.known(laser), said
    grid = read_map(path)
    try:
        return KnownMap.of_grid(grid, laser), ()
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error

"""Logs written: as CARMEN, and as a ROS bag of what the sensors said."""

from __future__ import annotations

import gzip
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from slam.files.whole_files import write_whole
from slam.measurements import LaserScan
from slam.odometry import compose_covariance
from slam.readers.log import Log
from slam.se2 import SE2

if TYPE_CHECKING:
    from experiments.bag_writer import BagWriter

_RANGE_MAX_M = 81.92
"""What SICK units announce; more where a scan saw farther."""
_EVEN_RAD = 1e-5
"""Chosen: by which beams may be off even steps; ten kilometres away it is one's width."""


def write_carmen(path: Path, log: Log) -> None:
    """Writes ODOM and ROBOTLASER1 lines, gzip'd if the name ends in .gz; whole or not at all.

    CARMEN has no times of single beams, and one number for beams that told nothing: too near and
    invalid are both 0. Raises ValueError for beams that are not evenly spaced, OSError if it cannot
    write.
    """
    text = "".join(_carmen_lines(log)).encode("ascii")
    write_whole(path, gzip.compress(text, mtime=0) if path.suffix == ".gz" else text)


def _carmen_lines(log: Log) -> Iterator[str]:
    yield "# ODOM x y theta tv rv accel; ROBOTLASER1 with the laser's pose and the robot's\n"
    for record in log.records:
        T, time_s = record.T_odom_base, f"{record.time_s:.6f}"
        if record.scan is None:
            yield f"ODOM {_numbers(T)} 0 0 0 {time_s} kitasap {time_s}\n"
            continue
        scan = record.scan
        first_rad, step_rad = _fan(scan, log.name)
        most_m = _range_max_m(scan)
        ranges_m = np.where(scan.ranges_m == np.inf, most_m, scan.ranges_m)
        ranges_m = np.where(np.isfinite(ranges_m), ranges_m, 0.0)
        listed = " ".join(f"{value:.4f}" for value in ranges_m)
        view_rad = step_rad * max(len(ranges_m) - 1, 1)
        yield (
            f"ROBOTLASER1 0 {first_rad:.9f} {view_rad:.9f} {step_rad:.9f} {most_m:.4f} 0.01 0"
            f" {len(ranges_m)} {listed} 0 {_numbers(T @ log.T_base_laser)} {_numbers(T)}"
            f" 0 0 0 0 0 {time_s} kitasap {time_s}\n"
        )


def _fan(scan: LaserScan, name: str) -> tuple[float, float]:
    """The first angle of a scan, and from each to the next [rad]."""
    angles_rad = scan.angles_rad
    if len(angles_rad) < 2:
        return float(angles_rad[0]), math.radians(1.0)
    step_rad = float(angles_rad[-1] - angles_rad[0]) / (len(angles_rad) - 1)
    even = angles_rad[0] + step_rad * np.arange(len(angles_rad))
    if np.abs(angles_rad - even).max() > _EVEN_RAD:
        raise ValueError(f"{name}: its beams are not evenly spaced, which CARMEN has no words for")
    return float(angles_rad[0]), step_rad


def _range_max_m(scan: LaserScan) -> float:
    """Above all that a scan measured."""
    return max(_RANGE_MAX_M, 1.01 * float(scan.ranges_m[scan.is_hit].max(initial=0.0)))


def _numbers(T: SE2) -> str:
    return f"{T.x:.9f} {T.y:.9f} {T.theta:.9f}"


def write_bag(path: Path, log: Log) -> None:
    """Writes /scan, /points, /odom, /tf and /tf_static: what the sensors said, and no map.

    What hangs upside down was turned upright when it was read; of heights nothing is known. Raises
    OSError if it cannot write, ImportError without the library that does.
    """
    from experiments.bag_writer import BASE, FOOTPRINT, LASER, BagWriter

    with BagWriter(path) as bag:
        odometry = _Odometry(bag, log)
        for number, record in enumerate(log.records):
            if number == 0:
                mounted = [
                    (FOOTPRINT, BASE, SE2.identity(), 0.0),
                    (BASE, LASER, log.T_base_laser, 0.0),
                ]
                bag.transforms("/tf_static", record.time_s, mounted)
            if log.has_odometry:
                odometry.write(record.time_s, record.T_odom_base)
            if record.scan is not None:
                bag.scan(record.time_s, record.scan, (0.0, _range_max_m(record.scan)))


class _Odometry:
    """Pose after pose, with how sure they are and how fast the robot went."""

    def __init__(self, bag: BagWriter, log: Log) -> None:
        self._bag, self._noise = bag, log.noise
        self._before: tuple[float, SE2] | None = None
        self._covariance = np.zeros((3, 3))

    def write(self, time_s: float, T_odom_base: SE2) -> None:
        if self._before is not None and _is_same_stamp(self._before[0], time_s):
            return  # tf2 complains of every transform that it has been told already
        velocity = np.zeros(3)
        if self._before is not None:
            before_s, T_before = self._before
            motion = T_before.inverse() @ T_odom_base
            noise = self._noise(motion)
            self._covariance = compose_covariance(self._covariance, motion, noise)
            if time_s > before_s:
                velocity = motion.log() / (time_s - before_s)
        self._before = time_s, T_odom_base
        self._bag.odometry(time_s, T_odom_base, self._covariance, velocity)


def _is_same_stamp(one_s: float, other_s: float) -> bool:
    """Whether times are the same nanosecond, as a bag has them."""
    return round(one_s * 1e9) == round(other_s * 1e9)

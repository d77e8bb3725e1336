"""Logs of raw wheel encoder ticks: the text format of tinySLAM's `mines` recordings, plain or gzip'd.

One line per scan: field 0 the time [us], 2 and 3 the ticks of the left and the right wheel since
some start, the fields from 24 on the ranges [mm]; what else there is, is not used.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from slam.arrays import BoolArray, FloatArray
from slam.measurements import LaserScan
from slam.odometry import DifferentialDrive, OdometryNoise
from slam.readers.lines import numbers, text_lines
from slam.readers.log import Log, LogRecord, LogRecords
from slam.se2 import SE2

FIRST_RANGE = 24
"""The field where the ranges begin."""
_TIME, _LEFT, _RIGHT = 0, 2, 3
_ERROR_CODES_MM = 20.0
"""A URG-04LX writes numbers below 20 for what it could not measure; 0 is nothing within its reach."""

_MINES_DRIVE = DifferentialDrive((0.077, 0.077), track_m=0.33, ticks_per_turn=2000)
_MINES_MOUNTING = SE2(0.145, 0.0, 0.0)
_USUAL_NOISE = OdometryNoise()


@dataclass(frozen=True)
class TicksConfig:
    """What the log does not say: the robot and its sensor, by default the Mines rover of 2011.

    The drive was found by map sharpness: 0.077 m and 0.33 m with 2000 ticks per turn; the half of
    it in the data's own example leaves the odometry a factor 2 short. The sensor, a URG-04LX: 240
    degrees from -120 degrees on, a step of 240/681 degrees, 0.145 m ahead of the axle.
    range_max_m: what is not below it is no return.
    """

    drive: DifferentialDrive = _MINES_DRIVE
    noise: OdometryNoise = _USUAL_NOISE
    T_base_laser: SE2 = _MINES_MOUNTING
    first_beam_rad: float = math.radians(-120.0)
    step_rad: float = math.radians(240.0 / 681.0)
    range_max_m: float = 5.6

    def covariance(self, motion: SE2) -> FloatArray:
        """(3, 3) of a motion of the drive, by the ticks that make it."""
        x, y, turn_rad = motion.log()
        way_m = math.copysign(math.hypot(x, y), x)
        half_m = turn_rad * self.drive.track_m / 2.0
        travel_m = np.array([way_m - half_m, way_m + half_m])
        turns = travel_m / (2.0 * math.pi * np.array(self.drive.wheel_radius_m))
        return self.noise.covariance(self.drive, turns * self.drive.ticks_per_turn)


@dataclass(frozen=True, eq=False)
class _TicksLine:
    """One line: stamp [s], ticks (2,), ranges (N,) as `LaserScan` wants them."""

    time_s: float
    ticks: FloatArray
    ranges_m: FloatArray


def read_ticks(path: str | Path, config: TicksConfig | None = None) -> Log:
    """The log in a file, plain or gzip'd. It is read through once now, and again by whoever asks.

    A beam that returns in no scan of the log is blind: its ranges are invalid, not free of walls.
    Raises ValueError, one line that names the file and the line, for what is no such log, is cut,
    or has no scan in it; OSError when the file cannot be opened.
    """
    path, config = Path(path), config or TicksConfig()
    scan_count, returned = 0, np.zeros(0, dtype=bool)
    for line in _lines(path, config):
        returned = np.isfinite(line.ranges_m) | (returned if scan_count else False)
        scan_count += 1
    if scan_count == 0:
        raise ValueError(f"{path.name}: no line of ticks and ranges, so no scan to work with")
    return Log(
        name=path.name,
        T_base_laser=config.T_base_laser,
        scan_count=scan_count,
        records=LogRecords(scan_count, partial(_records, path, config, returned)),
        noise=config.covariance,
    )


def _records(path: Path, config: TicksConfig, returned: BoolArray) -> Iterator[LogRecord]:
    angles_rad = np.asarray(config.first_beam_rad + config.step_rad * np.arange(len(returned)))
    T_odom_base, last = SE2.identity(), None
    for line in _lines(path, config):
        if last is not None:
            T_odom_base = T_odom_base @ config.drive.motion(line.ticks - last.ticks)
        line.ranges_m[~returned] = np.nan
        scan = LaserScan(line.time_s, angles_rad, line.ranges_m)
        yield LogRecord(line.time_s, T_odom_base, scan)
        last = line


def _lines(path: Path, config: TicksConfig) -> Iterator[_TicksLine]:
    """The lines that hold anything; all have as many ranges as the first."""
    expected = 0
    for number, text in text_lines(path, "a log of encoder ticks"):
        fields, place = text.split(), f"{path.name} line {number}"
        if not fields or fields[0].startswith("#"):
            continue
        expected = expected or len(fields)
        if len(fields) <= FIRST_RANGE or len(fields) != expected:
            least = expected if expected > FIRST_RANGE else f"more than {FIRST_RANGE}"
            raise ValueError(
                f"{place}: a line of ticks and ranges has {least} fields, found {len(fields)}"
            )
        yield _line(fields, place, config)


def _line(fields: list[str], place: str, config: TicksConfig) -> _TicksLine:
    values = np.array(numbers(fields[: _RIGHT + 1] + fields[FIRST_RANGE:], place))
    if not np.isfinite(values).all():
        raise ValueError(f"{place}: a stamp, ticks or a range are not finite")
    ranges_mm = values[_RIGHT + 1 :]
    ranges_m = ranges_mm / 1000.0
    ranges_m[ranges_mm < _ERROR_CODES_MM] = np.nan
    ranges_m[(ranges_mm == 0.0) | (ranges_m >= config.range_max_m)] = np.inf
    return _TicksLine(float(values[_TIME]) / 1e6, values[[_LEFT, _RIGHT]], ranges_m)

"""CARMEN logs: text lines ODOM, FLASER and PARAM, plain or gzip'd.

Fields of a FLASER line, which has two more poses and stamps behind its ranges:
`FLASER n r1 .. rn  x y theta  odom_x odom_y odom_theta  ipc_timestamp host logger_timestamp`
where x y theta is the sensor's pose in the frame of the odometry.
"""

from __future__ import annotations

import gzip
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slam.arrays import FloatArray
from slam.measurements import LaserScan, Measurement
from slam.odometry import compose_covariance
from slam.se2 import SE2

# Steps of SICK units by number of beams. All start at -90 degrees; with 180 and 360 beams the last
# is one step short of +90: `linspace(-90, 90, n)` would bend every scan.
_STEP_DEG = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5}

_FIELDS_AFTER_RANGES = 9
_ODOM_FIELDS = 10
# The mounting may not differ from scan to scan by more: the log has six decimals.
_MOUNTING_TOLERANCE = 1e-3


@dataclass(frozen=True)
class CarmenConfig:
    """What a CARMEN log does not say about its sensor.

    step_rad: between beams; None takes the usual one of SICK units with 180, 181, 360, 361 beams.
    range_max_m: what is not below it is no return (logs write 81.83, 81.91 or 50.00).
    T_base_laser: the mounting; None takes it from the poses in the log.
    """

    first_beam_rad: float = -math.pi / 2.0
    step_rad: float | None = None
    range_max_m: float = 50.0
    T_base_laser: SE2 | None = None


@dataclass(frozen=True)
class LogOdometryNoise:
    """How far to trust odometry of which only the poses are known, not the wheels.

    Chosen: 5 cm after a metre, 2 degrees after a metre and 3 after a radian are what the classic
    indoor robots show against their corrected logs.
    """

    position_m_per_sqrt_m: float = 0.05
    heading_rad_per_sqrt_m: float = 0.035
    heading_rad_per_sqrt_rad: float = 0.05

    def covariance(self, motion: SE2) -> FloatArray:
        """(3, 3) of the tangent (x, y, theta) in the robot's frame at the end of the motion."""
        distance_m = math.hypot(motion.x, motion.y)
        position = self.position_m_per_sqrt_m**2 * distance_m
        heading = self.heading_rad_per_sqrt_m**2 * distance_m
        heading += self.heading_rad_per_sqrt_rad**2 * abs(motion.theta)
        return np.diag([position, position, heading])


@dataclass(frozen=True)
class CarmenRecord:
    """One line of the log: the robot's pose by wheel odometry alone, and the scan if it has one."""

    time_s: float
    T_odom_base: SE2
    scan: LaserScan | None


@dataclass(frozen=True)
class CarmenLog:
    """A log in the order of its lines. The stamps are as recorded: in some logs they go back."""

    name: str
    T_base_laser: SE2
    records: tuple[CarmenRecord, ...]
    noise: LogOdometryNoise = LogOdometryNoise()

    @property
    def scan_count(self) -> int:
        """How many of the records have a scan."""
        return sum(record.scan is not None for record in self.records)

    def measurements(self) -> Iterator[Measurement]:
        """One Measurement per scan, with the motion over all odometry records since the last."""
        motion, covariance = SE2.identity(), np.zeros((3, 3))
        T_odom_last = self.records[0].T_odom_base
        for record in self.records:
            step = T_odom_last.inverse() @ record.T_odom_base
            covariance = compose_covariance(covariance, step, self.noise.covariance(step))
            motion = motion @ step
            T_odom_last = record.T_odom_base
            if record.scan is not None:
                yield Measurement(record.time_s, motion, record.scan, covariance)
                motion, covariance = SE2.identity(), np.zeros((3, 3))


def read_carmen(path: str | Path, config: CarmenConfig | None = None) -> CarmenLog:
    """The log in a file, plain or gzip'd.

    Raises ValueError, one line that names the file and the line, for what is not a CARMEN log, is
    cut, or has no scan in it; OSError when the file cannot be opened.
    """
    path, config = Path(path), config or CarmenConfig()
    records: list[CarmenRecord] = []
    mountings: list[SE2] = []
    for number, fields in _lines(path):
        place = f"{path.name} line {number}"
        if fields[0] == "ODOM":
            records.append(_odom_record(fields, place))
        elif fields[0] == "FLASER":
            record, T_odom_laser = _scan_record(fields, place, config)
            records.append(record)
            mountings.append(record.T_odom_base.inverse() @ T_odom_laser)
    if not mountings:
        raise ValueError(f"{path.name}: no FLASER line, so no scan to work with")
    return CarmenLog(path.name, _mounting(mountings, path.name, config), tuple(records))


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """The fields of each line that has any, comments left out, with the number of the line."""
    number = 0
    try:
        with _opened(path) as lines:
            for number, line in enumerate(lines, start=1):
                if b"\0" in line:
                    raise ValueError(f"{path.name} line {number}: binary, not a CARMEN log")
                fields = line.decode("utf-8").split()
                if fields and not line.endswith(b"\n") and _is_cut(fields[0]):
                    raise ValueError(f"{path.name} line {number}: cut within its first word")
                if fields and not fields[0].startswith("#"):
                    yield number, fields
    except UnicodeDecodeError as error:
        raise ValueError(f"{path.name} line {number}: binary, not a CARMEN log") from error
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ValueError(
            f"{path.name}: the gzip file is cut or damaged after line {number} ({error})"
        ) from error


def _is_cut(word: str) -> bool:
    """Whether a word is the beginning of a keyword, and no more."""
    return any(key.startswith(word) and key != word for key in ("ODOM", "FLASER", "PARAM"))


def _opened(path: Path) -> gzip.GzipFile:
    """The file as a stream of lines; told from its first bytes, since names lie."""
    with path.open("rb") as file:
        is_gzip = file.read(2) == b"\x1f\x8b"
    # a plain binary file has all that is used of a GzipFile here: its lines, and its end
    return gzip.open(path, "rb") if is_gzip else path.open("rb")  # type: ignore[return-value]


def _odom_record(fields: list[str], place: str) -> CarmenRecord:
    if len(fields) < _ODOM_FIELDS:
        raise ValueError(f"{place}: ODOM has {_ODOM_FIELDS} fields, found {len(fields)}")
    x, y, theta, time_s = _numbers([*fields[1:4], fields[-3]], place)
    _check_finite([x, y, theta, time_s], place)
    return CarmenRecord(time_s, SE2(x, y, theta), None)


def _scan_record(fields: list[str], place: str, config: CarmenConfig) -> tuple[CarmenRecord, SE2]:
    """The record of a FLASER line, and the sensor's pose in the frame of the odometry."""
    announced = fields[1] if len(fields) > 1 else "no number of"
    found = max(len(fields) - 2 - _FIELDS_AFTER_RANGES, 0)
    if not announced.isdecimal() or int(announced) != found:
        raise ValueError(f"{place}: FLASER announces {announced} ranges, found {found}")
    ranges_m = np.array(_numbers(fields[2 : 2 + found], place))
    poses = _numbers(fields[2 + found : 8 + found], place)
    (time_s,) = _numbers([fields[-3]], place)  # ipc_timestamp, not the logger's in the last field
    _check_finite([*poses, time_s], place)
    ranges_m[ranges_m < 0.0] = np.nan
    ranges_m[ranges_m >= config.range_max_m] = np.inf
    scan = LaserScan(time_s, _beam_angles_rad(found, place, config), ranges_m)
    return CarmenRecord(time_s, SE2(*poses[3:]), scan), SE2(*poses[:3])


def _beam_angles_rad(count: int, place: str, config: CarmenConfig) -> FloatArray:
    step_rad = config.step_rad
    if step_rad is None:
        if count not in _STEP_DEG:
            raise ValueError(
                f"{place}: the step between {count} beams is not known (it is for"
                f" {', '.join(map(str, _STEP_DEG))}); give step_rad"
            )
        step_rad = math.radians(_STEP_DEG[count])
    return np.asarray(config.first_beam_rad + step_rad * np.arange(count))


def _mounting(mountings: list[SE2], name: str, config: CarmenConfig) -> SE2:
    if config.T_base_laser is not None:
        return config.T_base_laser
    poses = np.array([mounting.as_array() for mounting in mountings])
    spread = np.abs(poses - poses[0]).max(axis=0)
    if (spread > _MOUNTING_TOLERANCE).any():
        raise ValueError(
            f"{name}: the sensor moves on the robot by up to {spread.max():.3f} (its pose is not in"
            " the frame of the odometry?); give T_base_laser"
        )
    return SE2.from_array(np.median(poses, axis=0))


def _numbers(fields: list[str], place: str) -> list[float]:
    try:
        return [float(field) for field in fields]
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from error


def _check_finite(values: list[float], place: str) -> None:
    if not all(map(math.isfinite, values)):
        raise ValueError(f"{place}: a pose or a stamp is not finite")

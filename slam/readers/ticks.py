"""Logs of raw wheel encoder ticks: the text format of tinySLAM's `mines` recordings, plain or gzip'd.

One line per scan: field 0 the time [us], 2 and 3 the ticks of the left and the right wheel since
some start, the fields from 24 on the ranges [mm]; what else there is, is not used. The ticks are
those of the stamp; the ranges are of an earlier sweep, and the laser turned evenly all the while.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from slam.arrays import BoolArray, FloatArray
from slam.files.text_fields import numbers
from slam.measurements import LATEST_S, LaserScan
from slam.odometry import DifferentialDrive, OdometryNoise, WheelModel
from slam.readers.lines import text_lines, told_if_cut
from slam.readers.log import Log, LogRecords
from slam.readers.log_record import LogRecord
from slam.readers.no_return import NoReturnSearch
from slam.readers.own_parts import OwnPartsSearch, own_parts_said, without_own_parts
from slam.readers.sweep_clock import rhythm
from slam.se2 import FARTHEST_M, SE2

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
    it in the data's own example leaves the odometry a factor 2 short. The sensor, a URG-04LX by its
    maker's protocol (SCIP 2.0, C-42-03320B): 1024 steps per turn, 600 turns per minute, counter-
    clockwise; it measures from step 44 to 726, and step 384 looks ahead. 0.145 m ahead of the axle.
    late_s: from the last beam to the stamp, on average; found where the turns of scan after scan
    follow the ticks best: to 11 mrad in 0.1 s, not to 33 as if it were 0.
    side_slip_s: as in `WheelModel`. range_max_m: what is not below it is no return; nor is what the
    log shows to be its code for that (`NoReturnSearch`).
    """

    drive: DifferentialDrive = _MINES_DRIVE
    noise: OdometryNoise = _USUAL_NOISE
    T_base_laser: SE2 = _MINES_MOUNTING
    first_beam_rad: float = -340.0 * 2.0 * math.pi / 1024
    step_rad: float = 2.0 * math.pi / 1024
    sweep_s: float = 0.1
    late_s: float = 0.112
    side_slip_s: float = 0.0
    range_max_m: float = 5.6

    @property
    def wheels(self) -> WheelModel:
        """What of this a drive shows."""
        return WheelModel(self.drive, self.T_base_laser, self.side_slip_s, self.late_s)

    def with_wheels(self, wheels: WheelModel) -> TicksConfig:
        """The same but for the wheels."""
        return replace(
            self, drive=wheels.drive, T_base_laser=wheels.T_base_laser,
            side_slip_s=wheels.side_slip_s, late_s=wheels.late_s,
        )  # fmt: skip

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


@dataclass(frozen=True, eq=False)
class _Sweeps:
    """What reading the log through tells of its scans.

    ends_s: (S,) when the last beam of each was fired; ticks: (S, 2) at that time. turn_s: of the
    laser. blind: (N,) beams that never returned.
    """

    ends_s: FloatArray
    ticks: FloatArray
    turn_s: float
    blind: BoolArray

    @staticmethod
    def of(
        stamps_s: FloatArray, ticks: FloatArray, returned: BoolArray, config: TicksConfig
    ) -> _Sweeps:
        """By the stamps (S,) and the ticks (S, 2) read at them."""
        if not (np.diff(stamps_s) > 0.0).all():  # nothing tells what was when
            return _Sweeps(stamps_s, ticks, config.sweep_s, ~returned)
        turn_s, read_s = rhythm(stamps_s, config.sweep_s)
        ends_s = read_s - config.late_s
        then = np.column_stack([np.interp(ends_s, stamps_s, wheel) for wheel in ticks.T])
        return _Sweeps(ends_s, then, turn_s, ~returned)


def read_ticks(path: str | Path, config: TicksConfig | None = None) -> Log:
    """The log in a file, plain or gzip'd. It is read through once now, and again by whoever asks.

    The stamp of a record is when the last beam of its scan was fired, and its pose where the robot
    was then, by the ticks before and after. A beam that returns in no scan of the log is blind: its
    ranges are invalid, not free of walls.
    Raises ValueError, one line that names the file and the line, for what is no such log, is cut,
    or has no scan in it; OSError when the file cannot be opened.
    """
    path, config = Path(path), config or TicksConfig()
    stamps_s: list[float] = []
    ticks: list[FloatArray] = []
    nearest_m = np.zeros(0)
    codes, own_parts = NoReturnSearch(), OwnPartsSearch()
    for line in _lines(path, config):
        nearest_m = np.fmin(line.ranges_m, nearest_m if stamps_s else np.inf)
        stamps_s.append(line.time_s)
        ticks.append(line.ticks)
        # as far along its way; where that is straight, so far from where it was
        way_m = float(config.drive.wheel_travel_m(line.ticks).mean())
        codes.add(line.ranges_m, config.step_rad, (way_m, 0.0))
        own_parts.add(line.ranges_m)
    if not stamps_s:
        raise ValueError(f"{path}: no line of ticks and ranges, so no scan to work with")
    config = replace(config, range_max_m=min(config.range_max_m, codes.no_return_m))
    returned = nearest_m < config.range_max_m
    sweeps = _Sweeps.of(np.array(stamps_s), np.array(ticks), returned, config)
    is_own = own_parts.is_own
    read = without_own_parts(partial(_records, path, config, sweeps), is_own)
    return Log(
        name=path.name,
        path=path,
        T_base_laser=config.T_base_laser,
        scan_count=len(stamps_s),
        records=LogRecords(len(stamps_s), read),
        noise=config.covariance,
        is_blind=codes.is_blind,
        wheels=config.wheels,
        with_wheels=lambda wheels: read_ticks(path, config.with_wheels(wheels)),
        notes=own_parts_said(is_own),
    )


def _records(path: Path, config: TicksConfig, sweeps: _Sweeps) -> Iterator[LogRecord]:
    angles_rad = np.asarray(config.first_beam_rad + config.step_rad * np.arange(len(sweeps.blind)))
    before_s = sweeps.turn_s * (angles_rad[-1] - angles_rad) / (2.0 * math.pi)
    wheels, T_odom_base = config.wheels, SE2.identity()
    last_s, last_ticks = sweeps.ends_s[0], sweeps.ticks[0]
    for line, end_s, ticks in zip(_lines(path, config), sweeps.ends_s, sweeps.ticks, strict=True):
        T_odom_base = T_odom_base @ wheels.motion(ticks - last_ticks, end_s - last_s)
        last_s, last_ticks = end_s, ticks
        line.ranges_m[sweeps.blind] = np.nan
        scan = LaserScan(end_s, angles_rad, line.ranges_m, end_s - before_s)
        yield LogRecord(end_s, T_odom_base, scan)


def _lines(path: Path, config: TicksConfig) -> Iterator[_TicksLine]:
    """The lines that hold anything; all have as many ranges as the first."""
    expected = 0
    for number, text in text_lines(path, "a log of encoder ticks"):
        fields, place = text.split(), f"{path} line {number}"
        if not fields or fields[0].startswith("#"):
            continue
        expected = expected or len(fields)
        with told_if_cut(not text.endswith("\n")):
            if len(fields) <= FIRST_RANGE or len(fields) != expected:
                least = expected if expected > FIRST_RANGE else f"more than {FIRST_RANGE}"
                raise ValueError(
                    f"{place}: a line of ticks and ranges has {least} fields, found {len(fields)}"
                )
            read = _line(fields, place, config)
        yield read


def _line(fields: list[str], place: str, config: TicksConfig) -> _TicksLine:
    values = np.array(numbers(fields[: _RIGHT + 1] + fields[FIRST_RANGE:], place))
    if not np.isfinite(values).all():
        raise ValueError(f"{place}: a stamp, ticks or a range are not finite")
    time_s, ticks = float(values[_TIME]) / 1e6, values[[_LEFT, _RIGHT]]
    travel_m = config.drive.wheel_travel_m(ticks)
    if abs(time_s) > LATEST_S or np.abs(travel_m).max() > FARTHEST_M:
        raise ValueError(
            f"{place}: {fields[_TIME]} us, and ticks {fields[_LEFT]} and {fields[_RIGHT]}; expected"
            f" no stamp beyond {LATEST_S:g} s, and no wheel to roll {FARTHEST_M:g} m: the line is"
            " damaged, take it out"
        )
    ranges_mm = values[_RIGHT + 1 :]
    ranges_m = ranges_mm / 1000.0
    ranges_m[ranges_mm < _ERROR_CODES_MM] = np.nan
    ranges_m[(ranges_mm == 0.0) | (ranges_m >= config.range_max_m)] = np.inf
    return _TicksLine(time_s, ticks, ranges_m)

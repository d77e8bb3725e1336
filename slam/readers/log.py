"""A recorded log, whatever its format: records one at a time, and the measurements they make."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from slam.arrays import FloatArray
from slam.measurements import Measurement
from slam.odometry import WheelModel, compose_covariance
from slam.readers.late_odometry import LateOdometry
from slam.readers.log_record import LogRecord
from slam.readers.record_faults import RecordFaults
from slam.readers.uneven_odometry import UnevenOdometry
from slam.se2 import SE2

MotionNoise = Callable[[SE2], FloatArray]
"""(3, 3) covariance of a motion, of the tangent (x, y, theta) in the robot's frame at its end."""


@dataclass(frozen=True)
class LogChoice:
    """What to read of a log, where it leaves that open.

    scan_topic, odom_topic: of a ROS bag; None takes them by their types. T_base_laser: the mounting of
    the laser, upright; None takes that which the log tells.
    """

    scan_topic: str | None = None
    odom_topic: str | None = None
    T_base_laser: SE2 | None = None


@dataclass(frozen=True, eq=False)
class LogRecords:
    """The records of a log in the order of its lines: read from the file anew by each `for`.

    The stamps are as recorded: in some logs they go back.
    """

    count: int
    read: Callable[[], Iterator[LogRecord]] = field(repr=False)

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[LogRecord]:
        return self.read()


@dataclass(frozen=True, eq=False)
class Log:
    """A log that was read through once, and found whole; none of its scans is kept.

    path: where it was read from, as it was given; None of one that was made.
    has_odometry: False where the log has scans alone; the motions are then nothing but a guess.
    is_blind: True where no beam of any scan came back.
    wheels: of a log of encoder ticks; with_wheels: the same log by other wheels. notes: in words, what
    was taken of a recording with several sensors, and of poses that say nothing.
    """

    name: str
    T_base_laser: SE2
    scan_count: int
    records: LogRecords
    noise: MotionNoise = field(repr=False)
    has_odometry: bool = True
    is_blind: bool = False
    wheels: WheelModel | None = None
    with_wheels: Callable[[WheelModel], Log] | None = field(default=None, repr=False)
    notes: tuple[str, ...] = ()
    path: Path | None = None

    @property
    def told_as(self) -> str:
        """What messages call it: its path, by which it is found, or its name where it has none."""
        return self.name if self.path is None else str(self.path)

    def check_sees(self) -> None:
        """Raises ValueError, in one line that names the log, where there is nothing to map."""
        if self.is_blind:
            raise ValueError(
                f"{self.told_as}: none of the {self.scan_count} scans has a beam that came back: all"
                " ranges are nan, not above 0, one and the same, or no return; expected ranges to walls,"
                " in metres"
            )

    def measurements(self) -> Iterator[Measurement]:
        """One Measurement per scan, with the motion over all odometry records since the last."""
        motion = MotionSinceScan(self.noise)
        for record in self.records_in_time():
            measurement = motion.add(record)
            if measurement is not None:
                yield measurement

    def records_in_time(self) -> Iterator[LogRecord]:
        """The records, as many as there are, with the ways that odometry told late, or unevenly, told in time: see
        `LateOdometry` and `UnevenOdometry`."""
        if not self.has_odometry:
            yield from self.records
            return
        late, uneven = LateOdometry(), UnevenOdometry()
        for record in self.records:
            for told in late.take(record):
                yield from uneven.take(told)
        for told in late.rest():
            yield from uneven.take(told)
        yield from uneven.rest()


class MotionSinceScan:
    """The way since the last scan, record by record: for a pose at each record, not each scan."""

    def __init__(self, noise: MotionNoise) -> None:
        self._noise, self._faults = noise, RecordFaults()
        self._T_odom_last: SE2 | None = None
        self._T_fix: SE2 | None = None
        self._motion, self._covariance = SE2.identity(), np.zeros((3, 3))
        self._longest_m = 0.0

    @property
    def motion(self) -> SE2:
        """From the last scan, or the first record, to the last record."""
        return self._motion

    @property
    def T_odom_base(self) -> SE2:
        """The pose by the odometry of the last record, as if it had never jumped: see `RecordJumps`."""
        T_last = self._T_odom_last or SE2.identity()
        return T_last if self._T_fix is None else self._T_fix @ T_last

    def add(self, record: LogRecord) -> Measurement | None:
        """The measurement that a record with a scan makes; None where it has none."""
        if self._T_odom_last is not None:
            told = self._T_odom_last.inverse() @ record.T_odom_base
            step, unsure = self._faults.believed(record.time_s, told, record.is_denied)
            if step is not told:
                self._T_fix = self.T_odom_base @ step @ record.T_odom_base.inverse()
            noise = self._noise(step) if unsure is None else self._noise(step) + unsure
            late_m, late_rad = record.late_sigma
            if step is told and (late_m or late_rad):
                noise = noise + np.diag(np.square([late_m, late_m, late_rad]))
            self._covariance = compose_covariance(self._covariance, step, noise)
            self._motion = self._motion @ step
            self._longest_m = max(self._longest_m, math.hypot(step.x, step.y))
        self._T_odom_last = record.T_odom_base
        if record.scan is None:
            return None
        unsure, covariance = self._faults.since_scan(record.scan), self._covariance
        covariance = covariance if unsure is None else covariance + unsure
        measurement = Measurement(
            record.time_s, self._motion, record.scan, covariance, self._longest_m
        )
        self._motion, self._covariance, self._longest_m = SE2.identity(), np.zeros((3, 3)), 0.0
        return measurement

"""CARMEN logs, plain or gzip'd; `slam.readers.carmen_lines` has what their lines say."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from slam.arrays import FloatArray
from slam.files.text_fields import numbers
from slam.readers.carmen_lines import (
    KEYWORDS,
    LASERS,
    STEP_PARAMETER,
    Fan,
    LaserLine,
    laser_of,
    odometry_of,
)
from slam.readers.lines import text_lines, told_if_cut
from slam.readers.log import Log, LogRecords
from slam.readers.log_odometry import (
    USUAL_NOISE,
    LogOdometryNoise,
    ScansBetweenPoses,
    unknown_motion,
)
from slam.readers.log_record import LogRecord
from slam.readers.no_return import NoReturnSearch
from slam.readers.own_parts import OwnPartsSearch, own_parts_said, without_own_parts
from slam.readers.silent_wheels import SILENT, SilentWheels
from slam.se2 import SE2

_LOG_DECIMALS = 6
_LEAST_SHARE = 0.1
"""Of the lines of the laser that has most, of one that is preferred to it. Chosen: a stray line is no log."""
_MOUNTING_TOLERANCE = 1e-3
"""By which the mounting may differ from scan to scan; chosen: logs with three decimals do so."""
# Of PARAM lines robot_frontlaser_.. and robot_rearlaser_..: where CARMEN has the sensor.
_PARAMETER_ENDS = ("offset", "side_offset", "angular_offset")
_PARAMETERS = {f"robot_{side}laser_{end}" for side in ("front", "rear") for end in _PARAMETER_ENDS}
_USUAL_MOUNTINGS = {"RAWLASER2": SE2(0.0, 0.0, math.pi)}
"""CARMEN's second laser looks backward."""


@dataclass(frozen=True)
class CarmenConfig:
    """What a CARMEN log does not say about its sensor.

    first_beam_rad, step_rad: of FLASER lines; None takes the usual ones of sensors with so many
    beams, or the step of a PARAM line. range_max_m: what is not below it is no return (logs write
    81.83 or 81.91); lines that announce a maximum range go by their own. Of either, what the
    log shows to be its code for no return (`NoReturnSearch`) is none as well. T_base_laser: the
    mounting; None takes it from the poses in the log, or from its PARAM lines. laser: the name of
    the lines to read, where there are several; None takes the first of `LASERS` that there is, but
    for stray lines.
    """

    first_beam_rad: float | None = None
    step_rad: float | None = None
    range_max_m: float = 80.0
    T_base_laser: SE2 | None = None
    laser: str | None = None
    noise: LogOdometryNoise = USUAL_NOISE

    def __post_init__(self) -> None:
        if self.laser is not None and self.laser not in LASERS:
            raise ValueError(f"no laser called '{self.laser}'; there are: {', '.join(LASERS)}")

    @property
    def fan(self) -> Fan:
        """What the lines themselves do not tell."""
        return Fan(self.first_beam_rad, self.step_rad, self.range_max_m)


def read_carmen(path: str | Path, config: CarmenConfig | None = None) -> Log:
    """The log in a file, plain or gzip'd. It is read through once now, and again by whoever asks.

    Raises ValueError, one line that names the file and the line, for what is not a CARMEN log, is
    cut, or has no scan in it; OSError when the file cannot be opened.
    """
    path, config = Path(path), config or CarmenConfig()
    survey = _Survey(str(path), config.fan)
    for number, fields, is_cut in _lines(path):
        with told_if_cut(is_cut):
            survey.add(fields, f"{path} line {number}", config)
    laser = survey.chosen_laser(config)
    has_poses, is_silent = survey.has_poses(laser), survey.is_silent(laser)
    has_odometry = has_poses and not is_silent
    is_own = survey.own_parts[laser].is_own
    return Log(
        name=path.name,
        path=path,
        T_base_laser=survey.mounting(laser, config),
        scan_count=survey.counts[laser],
        records=LogRecords(
            survey.counts[laser] + survey.counts["ODOM"],
            without_own_parts(partial(_records, path, laser, survey.fan_of(laser)), is_own),
        ),
        noise=config.noise.covariance if has_odometry else unknown_motion,
        has_odometry=has_odometry,
        is_blind=survey.codes[laser].is_blind,
        notes=(
            *((SILENT,) if has_poses and is_silent else ()),
            *own_parts_said(is_own),
            *survey.left_out(laser),
            *survey.mounting_denied(laser, config),
        ),
    )


def _records(path: Path, laser: str, fan: Fan) -> Iterator[LogRecord]:
    """The records of a file, one after the other."""
    waiting = ScansBetweenPoses()
    for number, fields, _ in _lines(path):
        place = f"{path} line {number}"
        if fields[0] == "ODOM":
            yield from waiting.add_pose(*odometry_of(fields, place))
        elif fields[0] == laser:
            line = laser_of(fields, place, fan)
            if line.T_odom_base is not None:
                yield LogRecord(line.time_s, line.T_odom_base, line.scan())
            else:
                yield from waiting.add_scan(line.time_s, line.scan)
    yield from waiting.rest()


@dataclass
class _Mounting:
    """The sensor's pose on the robot by the poses of scan after scan."""

    first: SE2
    count: int = 0
    total: FloatArray = field(default_factory=lambda: np.zeros(3))
    most: FloatArray = field(default_factory=lambda: np.zeros(3))

    def add(self, T_base_laser: SE2) -> None:
        """As one more scan has it."""
        off = (self.first.inverse() @ T_base_laser).as_array()
        self.count += 1
        self.total += off
        self.most = np.maximum(self.most, np.abs(off))

    @property
    def mean(self) -> SE2:
        """Over all scans, to the six decimals of the log."""
        mean = self.first @ SE2.from_array(self.total / self.count)
        return SE2.from_array(np.round(mean.as_array(), _LOG_DECIMALS) + 0.0)  # and no -0.0


@dataclass
class _Survey:
    """What is learnt of a log by reading it through: that it is whole, and what it holds."""

    name: str
    fan: Fan
    counts: Counter[str] = field(default_factory=Counter)
    parameters: dict[str, float] = field(default_factory=dict)
    mountings: dict[str, _Mounting] = field(default_factory=dict)
    codes: dict[str, NoReturnSearch] = field(default_factory=dict)
    wheels: defaultdict[str, SilentWheels] = field(
        default_factory=lambda: defaultdict(SilentWheels)
    )
    own_parts: defaultdict[str, OwnPartsSearch] = field(
        default_factory=lambda: defaultdict(OwnPartsSearch)
    )
    T_odom_last: SE2 | None = None

    def add(self, fields: list[str], place: str, config: CarmenConfig) -> None:
        """One line more. Raises ValueError where it is not what its name says."""
        name = fields[0]
        if name == "ODOM":
            _, self.T_odom_last = odometry_of(fields, place)
            self.wheels[name].add_pose(self.T_odom_last)
        elif name == "PARAM":
            if len(fields) > 2 and fields[1] in _PARAMETERS:
                self.parameters[fields[1]] = numbers(fields[2:3], place)[0]
            elif len(fields) > 2 and fields[1] == STEP_PARAMETER:
                self.fan = replace(self.fan, told_step_deg=fields[2])
        elif name in LASERS and config.laser in (None, name):
            self._add_scan(name, laser_of(fields, place, self.fan))
        else:
            return
        self.counts[name] += 1

    def _add_scan(self, name: str, line: LaserLine) -> None:
        T_odom_base = line.T_odom_base
        if T_odom_base is not None and line.T_odom_laser is not None:
            mounting = T_odom_base.inverse() @ line.T_odom_laser
            self.mountings.setdefault(name, _Mounting(mounting)).add(mounting)
        near = T_odom_base or self.T_odom_last
        position = None if near is None else (near.x, near.y)
        codes = self.codes.setdefault(name, NoReturnSearch())
        codes.add(line.ranges_m, line.step_rad, position)
        if T_odom_base is not None:
            self.wheels[name].add_pose(T_odom_base)
        self.wheels[name].add_scan(line.ranges_m)
        self.own_parts[name].add(line.ranges_m)

    def chosen_laser(self, config: CarmenConfig) -> str:
        """The name of the lines that are the scans. Raises ValueError where there are none."""
        asked = LASERS if config.laser is None else (config.laser,)
        most = max(self.counts[laser] for laser in asked)
        for laser in asked:
            if self.counts[laser] and self.counts[laser] >= _LEAST_SHARE * most:
                return laser
        kinds = "FLASER, ROBOTLASER1 or RAWLASER" if config.laser is None else config.laser
        raise ValueError(f"{self.name}: no {kinds} line, so no scan to work with")

    def has_poses(self, laser: str) -> bool:
        """Whether poses are told, by the lines of a laser or by lines of their own."""
        return laser in ("FLASER", "ROBOTLASER1") or self.counts["ODOM"] > 0

    def is_silent(self, laser: str) -> bool:
        """Whether none of these says anything."""
        return not self.wheels["ODOM"].has_moved and self.wheels[laser].is_silent

    def fan_of(self, laser: str) -> Fan:
        """What the lines do not tell of their beams, with what the log shows of it."""
        return replace(self.fan, no_return_m=self.codes[laser].no_return_m)

    def mounting(self, laser: str, config: CarmenConfig) -> SE2:
        """The sensor on the robot: as given, by the poses of the log, by its parameters."""
        if config.T_base_laser is not None:
            return config.T_base_laser
        by_poses = self.mountings.get(laser)
        if by_poses is not None and (by_poses.most <= _MOUNTING_TOLERANCE).all():
            return by_poses.mean
        by_parameters = self._mounting_by_parameters(laser)
        if by_parameters is not None:
            return by_parameters
        if by_poses is not None:
            raise ValueError(
                f"{self.name}: the sensor moves on the robot by up to {by_poses.most.max():.3f}"
                " (its pose is not in the frame of the odometry?); give T_base_laser"
            )
        return _USUAL_MOUNTINGS.get(laser, SE2.identity())

    def left_out(self, laser: str) -> tuple[str, ...]:
        """In words, lines of other lasers, which are not taken."""
        others = [
            f"{self.counts[name]} {name}" for name in LASERS if name != laser and self.counts[name]
        ]
        return (f"{laser} is taken, and not {', '.join(others)}",) if others else ()

    def mounting_denied(self, laser: str, config: CarmenConfig) -> tuple[str, ...]:
        """In words, that parameters have the sensor elsewhere than the poses of the scans, which are believed."""
        is_asked = config.T_base_laser is None and not self.is_silent(laser)
        told = self._mounting_by_parameters(laser) if is_asked else None
        taken = self.mounting(laser, config)
        if told is None or taken.is_near(told, _MOUNTING_TOLERANCE, _MOUNTING_TOLERANCE):
            return ()
        return (
            f"the poses of the scans have the laser {taken.x:g} m ahead, the PARAM lines"
            f" {told.x:g} m: the poses are believed; else give --mount",
        )

    def _mounting_by_parameters(self, laser: str) -> SE2 | None:
        side = "rear" if laser == "RAWLASER2" else "front"
        names = [f"robot_{side}laser_{end}" for end in _PARAMETER_ENDS]
        if names[0] not in self.parameters or laser in ("RAWLASER3", "RAWLASER4"):
            return None
        usual = _USUAL_MOUNTINGS.get(laser, SE2.identity()).as_array()
        pairs = zip(names, usual, strict=True)
        mounting = [self.parameters.get(name, value) for name, value in pairs]
        if abs(mounting[2]) > 2.0 * math.pi:
            raise ValueError(
                f"{self.name}: PARAM {names[2]} {mounting[2]:g} is no angle in radians;"
                " give T_base_laser"
            )
        return SE2(*mounting)


def _lines(path: Path) -> Iterator[tuple[int, list[str], bool]]:
    """The fields of each line that has any, comments left out, with the number of the line before them
    and whether the line has no end behind."""
    for number, line in text_lines(path, "a CARMEN log"):
        fields, is_cut = line.split(), not line.endswith("\n")
        if fields and is_cut and _is_cut(fields[0]):
            with told_if_cut(is_cut):
                raise ValueError(f"{path} line {number}: cut within its first word")
        if fields and not fields[0].startswith("#"):
            yield number, fields, is_cut


def _is_cut(word: str) -> bool:
    """Whether a word is the beginning of a keyword, and no more."""
    return word not in KEYWORDS and any(key.startswith(word) for key in KEYWORDS)

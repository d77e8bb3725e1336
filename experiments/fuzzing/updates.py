"""Targets that take scans: whatever a laser and wheels say, an update gives a finite pose.

An input is a few scans of a robot that drives through a room, each a row of numbers: a head of six
(what to do with the motion, the time, the beams), and a beam after the other. A beam is what the
room has there where its two bytes are 0, else what the bytes are as a half-precision number: all
ranges that there are, among them none, infinite ones and those that a scan refuses.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from experiments.fuzzing.room import SCAN_S, START, STEP, T_BASE_LASER, WALLS, angles, drive, scan
from experiments.fuzzing.targets import Reading
from slam.arrays import FloatArray
from slam.backend.session_joining import JoiningConfig
from slam.icp import IcpConfig, StopRule
from slam.known_map import KnownMap
from slam.lines import LineMap
from slam.localization import Localizer, LocalizerConfig
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper
from slam.matchers import LineMatcher, Matcher, PaperMatcher
from slam.measurements import LaserScan, Measurement
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap

_BEAMS = 121
_HEAD = struct.Struct("<4e2B")
"""Motion x, y, theta in half precision beside the true one, time beside the usual one; how the beam
times are, how the fan."""
_ROW_BYTES = _HEAD.size + 2 * _BEAMS
_MOST_SCANS = 6
_Update = Callable[[Measurement], tuple[FloatArray, FloatArray | None]]
"""The pose (3,), and its covariance where there is one."""


def localizer_limit(_: Path) -> tuple[list[bytes], Reading]:
    """The most accurate method, which finds itself."""
    return _seeds(), _taking(lambda: _localized(_guarded("limit")))


def localizer_fast(_: Path) -> tuple[list[bytes], Reading]:
    """The fast method, which finds itself."""
    return _seeds(), _taking(lambda: _localized(_guarded("fast")))


def localizer_open3d(_: Path) -> tuple[list[bytes], Reading]:
    """ICP of Open3D, which finds itself."""
    return _seeds(), _taking(lambda: _localized(_guarded("open3d")))


def localizer_line(_: Path) -> tuple[list[bytes], Reading]:
    """The laboratory's earlier method."""
    matcher = LineMatcher(LineMap(WALLS))
    return _seeds(), _taking(lambda: _localized(_bare(matcher)))


def localizer_paper(_: Path) -> tuple[list[bytes], Reading]:
    """The paper's own ICP."""
    config = IcpConfig(
        max_pair_distance_m=10.0, threshold_m2=1.6e-3, stop_rule=StopRule.FIRST_BELOW
    )
    matcher = PaperMatcher(_map().point_map, config)
    return _seeds(), _taking(lambda: _localized(_bare(matcher, deskew=False)))


def mapper(_: Path) -> tuple[list[bytes], Reading]:
    """The mapper, with the map that it makes in the end."""
    return _seeds(), _mapping(lambda: Mapper(T_BASE_LASER))


def mapper_continued(_: Path) -> tuple[list[bytes], Reading]:
    """The mapper that looks for its place on a map, in pieces so small that all scans see some."""
    known = Mapper(T_BASE_LASER)
    for _true_pose, measurement in drive(40, _BEAMS):
        known.update(measurement)
    slam_map = known.finish()
    config = MapperConfig(joining=JoiningConfig(work=20.0))
    return _seeds(), _mapping(lambda: Mapper.continued(slam_map, T_BASE_LASER, config=config))


def _mapping(begun: Callable[[], Mapper]) -> Reading:
    def made() -> tuple[_Update, Callable[[], None]]:
        one = begun()

        def update(measurement: Measurement) -> tuple[FloatArray, None]:
            step = one.update(measurement)
            assert np.isfinite(step.inlier_ratio), "inliers that are no number"
            return step.T_map_base.as_array(), None

        def finish() -> None:
            found = one.finish()
            assert np.isfinite(found.poses).all(), "a map with a pose that is no number"
            assert np.isfinite(found.points).all(), "a map with a point that is no number"

        return update, finish

    return _taking(made)


@cache
def _map() -> KnownMap:
    return KnownMap.of_walls(SegmentMap(WALLS))


@cache
def _true(number: int) -> tuple[SE2, FloatArray]:
    """Where the robot is at a scan, and what its laser sees: never the same noise twice."""
    pose = START if number == 0 else _true(number - 1)[0] @ STEP
    return pose, scan(pose, 0.0, _BEAMS, np.random.default_rng(number)).ranges_m


def _guarded(method: str) -> Localizer:
    return _map().localizer(method, START, T_BASE_LASER)


def _bare(matcher: Matcher, *, deskew: bool = True) -> Localizer:
    return Localizer(matcher, START, T_BASE_LASER, LocalizerConfig(deskew=deskew))


def _localized(one: Localizer) -> tuple[_Update, Callable[[], None]]:
    def update(measurement: Measurement) -> tuple[FloatArray, FloatArray | None]:
        estimate = one.update(measurement)
        return estimate.T_map_base.as_array(), estimate.covariance

    return update, lambda: None


def _taking(made: Callable[[], tuple[_Update, Callable[[], None]]]) -> Reading:
    """Gives a new robot the scans of an input; what makes no measurement is passed over."""

    def take(data: bytes, _: Path) -> None:
        update, finish = made()
        time_s = 0.0
        for number in range(min(_MOST_SCANS, -(-len(data) // _ROW_BYTES))):
            row = data[number * _ROW_BYTES : (number + 1) * _ROW_BYTES].ljust(_ROW_BYTES, b"\0")
            try:
                with np.errstate(all="ignore"):
                    measurement = _measurement(row, number, time_s)
            except ValueError:
                continue  # refused by the types, which is theirs to test
            time_s = measurement.time_s
            pose, covariance = update(measurement)
            assert np.isfinite(pose).all(), "a pose that is no number"
            if covariance is not None:
                assert not np.isnan(covariance).any(), "a covariance that is no number"
                if np.isfinite(covariance).all():
                    least = np.linalg.eigvalsh(covariance)[0]
                    assert least >= -1e-9 * np.abs(covariance).max(), "a negative variance"
        finish()

    return take


def _measurement(row: bytes, number: int, time_before_s: float) -> Measurement:
    """Raises ValueError where the numbers make none."""
    dx, dy, dtheta, late_s, times, fan = _HEAD.unpack_from(row)
    halves = np.frombuffer(row, "<f2", offset=_HEAD.size).astype(np.float64)
    is_true = np.frombuffer(row, "<u2", offset=_HEAD.size) == 0
    ranges_m = np.where(is_true, _true(number)[1], halves)
    angles_rad = angles(_BEAMS)
    if fan == 1:  # few beams, none at all
        ranges_m, angles_rad = ranges_m[: times % 8], angles_rad[: times % 8]
    elif fan == 2:  # nearer to one another than any laser's
        angles_rad = angles_rad * 1e-9
    elif fan == 3:
        ranges_m = ranges_m * 1e9
    time_s = time_before_s + SCAN_S + late_s
    beam_times_s = None
    if times & 1:
        beam_times_s = time_s - np.linspace(SCAN_S, 0.0, len(ranges_m))
        if times & 2:
            beam_times_s = beam_times_s + halves[: len(ranges_m)]
        if times & 4:
            beam_times_s = beam_times_s[::-1]
    motion = SE2.identity() if number == 0 else STEP
    beside = np.array([dx, dy, dtheta], dtype=np.float64)
    if times & 8:
        beside[:2] *= 1e3
    return Measurement(
        time_s, SE2.from_array(motion.as_array() + beside),
        LaserScan(time_s, angles_rad, ranges_m, beam_times_s),
    )  # fmt: skip


def _seeds() -> list[bytes]:
    """An undisturbed drive; scans of nothing; a kidnap; beam times; beams far and near, doubled."""
    zero = bytes(_ROW_BYTES)
    head = _HEAD.pack(0.0, 0.0, 0.0, 0.0, 0, 0)
    filled = {
        name: head + np.full(_BEAMS, value, dtype="<f2").tobytes()
        for name, value in (("none", np.inf), ("nan", np.nan), ("near", 0.05), ("far", 6e4))
    }
    rng = np.random.default_rng(0)
    noise = head + rng.uniform(0.1, 9.0, _BEAMS).astype("<f2").tobytes()
    timed = _HEAD.pack(0.0, 0.0, 0.0, 0.0, 3, 0) + bytes(2 * _BEAMS)
    carried = _HEAD.pack(1.5, -0.5, 1.0, 0.0, 0, 0) + bytes(2 * _BEAMS)
    back = _HEAD.pack(0.0, 0.0, 0.0, -5.0, 0, 0) + bytes(2 * _BEAMS)
    few = _HEAD.pack(0.0, 0.0, 0.0, 0.0, 3, 1) + bytes(2 * _BEAMS)
    return [
        zero * 4,
        *(zero + row + zero for row in filled.values()),
        zero + noise * 2 + zero * 2,
        zero + timed * 2,
        zero + carried + zero * 2,
        zero + back + zero,
        zero + few + zero,
    ]

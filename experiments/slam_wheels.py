"""Wheels calibrated from the drive that a log of encoder ticks recorded, and what that is worth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from slam.arrays import FloatArray
from slam.frontend.front_end_config import FrontEndConfig
from slam.mapper_config import MapperConfig
from slam.odometry import WheelModel
from slam.readers.log import Log
from slam.se2 import SE2
from slam.sharpness import wall_spread_m
from slam.slam_map import SlamMap
from slam.straightening import Straightener
from slam.wheel_calibration import LEAST_STEPS, SeenMotions, calibrated_wheels

_ROUNDS = 3
"""Chosen: scans are straightened anew by what was found; the third moves the track by 1 %."""
_EVERY, _APART = 3, (5, 40)
"""Chosen: of every third scan, those that lie 15 to 120 scans apart: drift, not yet lost."""
_VISIT = 20
"""Keyframes that lie farther apart saw a place on two visits."""
_STEP_SIGMA = (0.0015, 0.0015, 0.0015)
"""Of each step beside its own noise, where wheels are calibrated; poses alone are a guess. Chosen on
the one log of ticks that there is: over four rounds of calibration the map's walls spread 97 mm with
0.003, 87 with 0.0015, 91 with 0.001, 124 with 0.01; single rounds scatter by 15 and more."""


@dataclass(frozen=True, eq=False)
class CalibratedLog:
    """A log by the wheels that its drive shows. sigmas: of radii and track, as shares. spread_m:
    RMS [m] of walls about themselves where wheels alone place the scans: as assumed, as found."""

    log: Log
    assumed: WheelModel
    found: WheelModel
    sigmas: tuple[float, float, float]
    spread_m: tuple[float | None, float | None]

    @property
    def is_sharper(self) -> bool:
        """Whether the wheels found make sharper walls than those assumed."""
        before_m, after_m = self.spread_m
        return before_m is not None and after_m is not None and after_m < before_m

    @property
    def mapper(self) -> MapperConfig:
        """Such wheels are followed closely."""
        return MapperConfig(front_end=FrontEndConfig(step_sigma=_STEP_SIGMA))


def calibrated_log(log: Log) -> CalibratedLog | None:
    """The log by wheels calibrated from its drive; None where it has no ticks, or is too short."""
    assumed, found = log.wheels, log
    if assumed is None or log.with_wheels is None:
        return None
    for _ in range(_ROUNDS):
        seen = SeenMotions.of(found.measurements(), found.T_base_laser)
        if len(seen) < LEAST_STEPS or found.wheels is None:
            return None
        calibration = calibrated_wheels(seen, found.wheels)
        found = log.with_wheels(calibration.wheels)
    left, right, track = calibration.sigmas[:3].tolist()
    spread_m = tuple(wall_spread_m(list(_by_wheels(one)), _APART) for one in (log, found))
    return CalibratedLog(
        found, assumed, calibration.wheels, (left, right, track), (spread_m[0], spread_m[1])
    )


def map_spread_m(slam_map: SlamMap) -> float | None:
    """RMS [m] of walls about where they were seen on other visits."""
    poses = map(SE2.from_array, slam_map.poses)
    clouds = [T @ keyframe.points for T, keyframe in zip(poses, slam_map.keyframes, strict=True)]
    return wall_spread_m(clouds, (_VISIT, float("inf")))


def wheels_summary(
    calibrated: CalibratedLog, maps: tuple[SlamMap, SlamMap], is_used: bool
) -> dict[str, Any]:
    """Plain numbers, for `summary.json`. maps: by the wheels assumed, by those found."""
    return {
        "assumed": _plain(calibrated.assumed),
        "calibrated": _plain(calibrated.found),
        "sigmas": dict(zip(("left", "right", "track"), calibrated.sigmas, strict=True)),
        "used": "calibrated" if is_used else "assumed",
        "spread_by_wheels_m": dict(zip(("before", "after"), calibrated.spread_m, strict=True)),
        "spread_of_map_m": {
            name: map_spread_m(one) for name, one in zip(("before", "after"), maps, strict=True)
        },
    }


def wheels_line(summary: dict[str, Any]) -> str:
    """The summary for people to read."""
    told, walls = summary["calibrated"], summary["spread_of_map_m"]
    alone = summary["spread_by_wheels_m"]
    return (
        f"wheels: radii {1000 * told['wheel_radius_m'][0]:.2f}, {1000 * told['wheel_radius_m'][1]:.2f}"
        f" mm, track {1000 * told['track_m']:.1f} mm; walls by wheels alone spread"
        f" {_mm(alone['before'])} -> {_mm(alone['after'])} mm, on the map {_mm(walls['before'])} ->"
        f" {_mm(walls['after'])} mm; map by the wheels {summary['used']}"
    )


def _mm(value_m: float | None) -> str:
    return "-" if value_m is None else f"{1000 * value_m:.0f}"


def _plain(wheels: WheelModel) -> dict[str, Any]:
    x, y, theta = wheels.T_base_laser.as_array().tolist()
    return {
        **asdict(wheels.drive),
        "T_base_laser": [x, y, theta],
        "side_slip_s": wheels.side_slip_s,
        "late_s": wheels.late_s,
    }


def _by_wheels(log: Log) -> Iterator[FloatArray]:
    """The points of every third scan, where the wheels alone put them."""
    straightener, T_odom_base = Straightener(log.T_base_laser), SE2.identity()
    for index, one in enumerate(log.measurements()):
        T_odom_base = T_odom_base @ one.motion
        duration_s = straightener.duration_s(one.time_s, one.motion)
        straightener.take_motion(one.time_s, one.scan.beam_times_s, one.motion, duration_s)
        if index % _EVERY == 0:
            yield T_odom_base @ straightener.beams(one.scan).points

"""The lines of CARMEN logs that matter here, each as what it says.

`name [content] ipc_timestamp ipc_hostname logger_timestamp`, where the content is, as CARMEN's own
header of a log has it:
ODOM: x y theta tv rv accel
FLASER: n r1 .. rn, then x y theta of the sensor and of the robot, both in the odometry's frame
ROBOTLASER1: laser_type start_angle field_of_view angular_resolution maximum_range accuracy
remission_mode, n r1 .. rn, num_remissions and these, x y theta of sensor and robot,
tv rv forward_safety_dist side_safety_dist turn_axis; older ones have no remissions and no turn_axis
RAWLASER1 to RAWLASER4: as far as the remissions, and no poses
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from slam.arrays import FloatArray
from slam.files.text_fields import numbers
from slam.measurements import LATEST_S, LaserScan
from slam.readers.no_return import NO_RETURN_SHARE
from slam.se2 import FARTHEST_M, SE2

LASERS = ("FLASER", "ROBOTLASER1", "RAWLASER1", "RAWLASER2", "RAWLASER3", "RAWLASER4")
"""By preference: a log often has the same scan as several of them; the first tell the odometry."""
KEYWORDS = (*LASERS, "ODOM", "PARAM")

# First beam and step of usual sensors by number of beams, which is all that FLASER tells. SICK
# units with 180 and 360 beams end one step short of +90: `linspace(-90, 90, n)` would bend every
# scan. 101, 201 and 401 beams are a SICK's 100 degrees; 270, 540 and more the sensors that see 270
# degrees; 512 and 513 a URG-04LX within 180 degrees, 682 and 683 within its 240, 726 all of its
# steps, of which 1024 make a turn, 769 those of 270 degrees, blind ones among them.
_URG_STEP_DEG = 360.0 / 1024.0
_FANS_DEG = {
    **{180: (-90.0, 1.0), 181: (-90.0, 1.0), 360: (-90.0, 0.5), 361: (-90.0, 0.5)},
    **{101: (-50.0, 1.0), 201: (-50.0, 0.5), 401: (-50.0, 0.25)},
    **{270: (-135.0, 1.0), 271: (-135.0, 1.0), 540: (-135.0, 0.5), 541: (-135.0, 0.5)},
    **{720: (-90.0, 0.25), 721: (-90.0, 0.25), 1080: (-135.0, 0.25), 1081: (-135.0, 0.25)},
    **{512: (-90.0, _URG_STEP_DEG), 513: (-90.0, _URG_STEP_DEG), 769: (-135.0, _URG_STEP_DEG)},
    **{count: (-0.5 * (count - 1) * _URG_STEP_DEG, _URG_STEP_DEG) for count in (682, 683, 726)},
}
STEP_PARAMETER = "laser_front_laser_resolution"
"""Of PARAM lines: degrees from beam to beam of FLASER."""

_FULL_TURN_DEG = 360.0
_LEAST_STEP_RAD = 1e-6
"""Chosen: a thousandth of what lasers have; beams closer than that may point the same way."""
_CODE_M = 50.0
"""What some drivers write of whatever is farther; of walls it takes a beam or two in a log."""
_STAMPS = 3
_ODOM_FIELDS = 10
_POSES = 6
_HEAD = 9  # name, seven facts of the sensor, number of ranges
_MOTION_FIELDS = 5  # behind the poses of ROBOTLASER1


@dataclass(frozen=True)
class Fan:
    """What lines do not say of their beams.

    first_beam_rad, step_rad: of FLASER; None takes the usual one of their number. range_max_m: what
    is not below it is no return, in lines that announce no maximum. no_return_m: nor is what is not
    below this, in any line. told_step_deg: as a PARAM line has it, for unusual numbers of beams, and
    where it makes them a whole turn.
    """

    first_beam_rad: float | None
    step_rad: float | None
    range_max_m: float
    no_return_m: float = math.inf
    told_step_deg: str | None = None


@dataclass(frozen=True, eq=False)
class LaserLine:
    """A scan as its line tells it. The poses are None where the line has none."""

    time_s: float
    angles_rad: FloatArray
    ranges_m: FloatArray
    T_odom_base: SE2 | None
    T_odom_laser: SE2 | None

    @property
    def step_rad(self) -> float:
        """From beam to beam; 0 where there is but one."""
        return float(self.angles_rad[1] - self.angles_rad[0]) if len(self.angles_rad) > 1 else 0.0

    def scan(self) -> LaserScan:
        """The same as a scan."""
        return LaserScan(self.time_s, self.angles_rad, self.ranges_m)


def odometry_of(fields: list[str], place: str) -> tuple[float, SE2]:
    """Stamp and pose of an ODOM line."""
    if len(fields) < _ODOM_FIELDS:
        raise ValueError(f"{place}: ODOM has {_ODOM_FIELDS} fields, found {len(fields)}")
    x, y, theta, time_s = _finite([*fields[1:4], fields[-3]], place)
    return _stamp(time_s, place), _pose((x, y, theta), place)


def laser_of(fields: list[str], place: str, fan: Fan) -> LaserLine:
    """The scan of a line whose name is one of `LASERS`."""
    if fields[0] == "FLASER":
        return _flaser(fields, place, fan)
    return _new_laser(fields, place, fan)


def _flaser(fields: list[str], place: str, fan: Fan) -> LaserLine:
    announced = fields[1] if len(fields) > 1 else "no number of"
    found = max(len(fields) - 2 - _POSES - _STAMPS, 0)
    if not announced.isdecimal() or int(announced) != found:
        raise ValueError(f"{place}: FLASER announces {announced} ranges, found {found}")
    ranges_m = np.array(numbers(fields[2 : 2 + found], place))
    # ipc_timestamp, not the logger's in the last field
    *poses, time_s = _finite([*fields[2 + found : 8 + found], fields[-3]], place)
    angles_rad = _angles_of_count(found, place, fan)
    _mark(ranges_m, min(fan.range_max_m, fan.no_return_m))
    of_base, of_laser = _pose(poses[3:], place), _pose(poses[:3], place)
    return LaserLine(_stamp(time_s, place), angles_rad, ranges_m, of_base, of_laser)


def _new_laser(fields: list[str], place: str, fan: Fan) -> LaserLine:
    """Of ROBOTLASER1 and RAWLASER, which tell their beams themselves."""
    name = fields[0]
    count = int(fields[8]) if len(fields) >= _HEAD and fields[8].isdecimal() else -1
    rest = fields[_HEAD + count :] if count >= 0 else []
    poses = _poses_of(rest, is_robot=name.startswith("ROBOT"))
    if count < 0 or poses is None:
        announced = fields[8] if len(fields) >= _HEAD else "no number of"
        raise ValueError(
            f"{place}: {name} announces {announced} ranges, which its {len(fields)} fields do not"
            " hold with what else belongs to such a line"
        )
    facts = _finite([*fields[2:6], fields[-3], *poses], place)
    first_rad, view_rad, step_rad, range_max_m, time_s = facts[:5]
    # half a step of rounding, and one for those that count the end of the view in
    if step_rad <= 0.0 or (count - 1.5) * step_rad > view_rad:
        raise ValueError(
            f"{place}: {name} has {count} beams, {step_rad} rad apart, in a view of {view_rad} rad:"
            " they do not fit"
        )
    ranges_m = np.array(numbers(fields[_HEAD : _HEAD + count], place))
    announced_m = NO_RETURN_SHARE * range_max_m if range_max_m > 0.0 else fan.range_max_m
    _mark(ranges_m, min(announced_m, fan.no_return_m))
    angles_rad = _fan(count, first_rad, step_rad, place)
    if not poses:
        return LaserLine(_stamp(time_s, place), angles_rad, ranges_m, None, None)
    of_base, of_laser = _pose(facts[8:], place), _pose(facts[5:8], place)
    return LaserLine(_stamp(time_s, place), angles_rad, ranges_m, of_base, of_laser)


def _poses_of(rest: list[str], is_robot: bool) -> list[str] | None:
    """The fields of the poses behind the ranges, none for RAWLASER; None where the rest is cut."""
    motion = _POSES + _MOTION_FIELDS if is_robot else 0
    # no remissions, not even their number, and no turn axis
    if is_robot and len(rest) in (motion - 1 + _STAMPS, motion + _STAMPS):
        return rest[:_POSES]
    remissions = int(rest[0]) if rest and rest[0].isdecimal() else -1
    if remissions < 0 or len(rest) != 1 + remissions + motion + _STAMPS:
        return None
    return rest[1 + remissions : 1 + remissions + _POSES] if is_robot else []


def _mark(ranges_m: FloatArray, no_return_m: float) -> None:
    """Writes invalid and missing ranges as `LaserScan` wants them."""
    # no laser measures 0: drivers write it where there was nothing to measure
    ranges_m[ranges_m <= 0.0] = np.nan
    ranges_m[(ranges_m >= no_return_m) | (ranges_m == _CODE_M)] = np.inf


def _angles_of_count(count: int, place: str, fan: Fan) -> FloatArray:
    if count == 0:
        return np.zeros(0)
    usual_deg = None if _is_turn(count, fan) else _FANS_DEG.get(count)
    step_rad, first_rad = fan.step_rad, fan.first_beam_rad
    if step_rad is None:
        step_deg = _told_step_deg(count, place, fan) if usual_deg is None else usual_deg[1]
        step_rad = math.radians(step_deg)
    if first_rad is None:
        # looking ahead, as the usual ones do
        first_rad = -(count // 2) * step_rad if usual_deg is None else math.radians(usual_deg[0])
    return _fan(count, first_rad, step_rad, place)


def _is_turn(count: int, fan: Fan) -> bool:
    """Whether so many beams are a whole turn by the log's PARAM line, the first direction once more or not."""
    step_deg = _parameter_deg(fan)
    return any(math.isclose(steps * step_deg, _FULL_TURN_DEG) for steps in (count, count - 1))


def _parameter_deg(fan: Fan) -> float:
    """What the log's PARAM line tells; nan where it tells no number, or there is none."""
    try:
        return float(fan.told_step_deg or math.nan)
    except ValueError:
        return math.nan


def _told_step_deg(count: int, place: str, fan: Fan) -> float:
    """From beam to beam of an unusual number, by the log's PARAM line."""
    if fan.told_step_deg is None:
        raise ValueError(
            f"{place}: FLASER does not tell where its {count} beams point, and no usual laser has"
            f" as many ({', '.join(map(str, sorted(_FANS_DEG)))}); write above the scans how many"
            f" degrees they are apart, as in: PARAM {STEP_PARAMETER} 0.5 nohost 0"
        )
    step_deg = _parameter_deg(fan)
    if not (step_deg > 0.0 and step_deg * (count - 1) <= _FULL_TURN_DEG):
        raise ValueError(
            f"{place}: {count} beams {fan.told_step_deg} degrees apart, as PARAM {STEP_PARAMETER}"
            " has it, are no fan of 360 degrees at most"
        )
    return step_deg


def _fan(count: int, first_rad: float, step_rad: float, place: str) -> FloatArray:
    """(count,) directions that increase from beam to beam."""
    if abs(first_rad) > 2.0 * math.pi or step_rad < _LEAST_STEP_RAD:
        raise ValueError(
            f"{place}: beams {step_rad:g} rad apart, the first at {first_rad:g} rad, are no fan;"
            " expected directions within a turn"
        )
    return _angles(count, first_rad, step_rad)


@lru_cache(maxsize=8)
def _angles(count: int, first_rad: float, step_rad: float) -> FloatArray:
    angles_rad = np.asarray(first_rad + step_rad * np.arange(count))
    angles_rad.flags.writeable = False
    return angles_rad


def _pose(values: Sequence[float], place: str) -> SE2:
    x, y, theta = values
    if max(abs(x), abs(y), abs(theta)) > FARTHEST_M:
        raise ValueError(
            f"{place}: a pose of {x:g} {y:g} {theta:g}; expected metres and radians, none beyond"
            f" {FARTHEST_M:g}: the line is damaged, take it out"
        )
    return SE2(x, y, theta)


def _stamp(time_s: float, place: str) -> float:
    if abs(time_s) > LATEST_S:
        raise ValueError(
            f"{place}: a stamp of {time_s:g}; expected seconds, none beyond {LATEST_S:g}: are these"
            " nanoseconds, or is the line damaged?"
        )
    return time_s


def _finite(fields: list[str], place: str) -> list[float]:
    values = numbers(fields, place)
    if not all(map(math.isfinite, values)):
        raise ValueError(f"{place}: a pose or a stamp is not finite")
    return values

"""ROS bags with a laser: scans, wheel odometry, and where the laser sits, as a `Log`.

The laser is that of a `sensor_msgs/LaserScan` topic; the odometry a `nav_msgs/Odometry`, or the
transform of the robot in a frame called odom; the mounting comes from /tf_static or /tf.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from slam.measurements import check_stamped
from slam.readers.bag_files import LASER_SCAN, MOST_NAMED, ODOMETRY, TF, Bag, BagMessage, Topic
from slam.readers.log import Log, LogChoice, LogRecords
from slam.readers.log_odometry import (
    USUAL_NOISE,
    LogOdometryNoise,
    ScansBetweenPoses,
    unknown_motion,
)
from slam.readers.log_record import LogRecord
from slam.readers.no_return import NoReturnSearch
from slam.readers.own_parts import OwnPartsSearch, own_parts_said, without_own_parts
from slam.readers.scan_message import ScanMessage
from slam.readers.silent_wheels import SILENT, SilentWheels
from slam.readers.stamp_order import in_stamp_order
from slam.readers.transforms import Mounting, Transforms, frame_name, planar
from slam.se2 import SE2

_USUAL_BASES = ("base_footprint", "base_link")
"""Of REP-105 and 120: the one is below the other."""
_APART_S = 10.0
"""Chosen: by which odometry may begin later than scans or end earlier, and be of the same clock."""
_UNSTAMPED_S = 1e6
"""A stamp of 0 in a recording of later than January 1970 was never set."""

_Entry = tuple[float, ScanMessage | SE2]
"""When, and what: a sweep, stamped by its last beam, or the robot's pose by its wheels."""


@dataclass(frozen=True)
class _Sources:
    """Where in a bag scans and odometry come from. odometry None: there is none.

    odom, base: of odometry by transforms, the frames between which it is.
    """

    bag: Bag
    scans: str
    odometry: str | None
    odom: str | None
    base: str
    mounting: Mounting
    no_return_m: float = math.inf


def read_ros_bag(
    path: str | Path, choice: LogChoice | None = None, noise: LogOdometryNoise = USUAL_NOISE
) -> Log:
    """The log in a bag of ROS 1 or ROS 2. It is read through now, and again by whoever asks.

    Records are in the order of their stamps; that of a scan is its last beam's, and its pose where
    the robot was then, between the odometry before and after.
    Raises ValueError, one line that names the bag, for what is none, is cut, or lacks scans or what
    places the laser on the robot, with what it does have; OSError when it cannot be opened.
    """
    choice = choice or LogChoice()
    bag = Bag(Path(path))
    sources, notes = _sources(bag, choice)
    survey = _Survey()
    for record in _records(sources):
        survey.add(record, sources.odometry is not None)
    survey.check(str(bag.path), sources)
    sources = replace(sources, no_return_m=survey.codes.no_return_m)
    if survey.scans == 0:
        raise ValueError(f"{bag.path}: no scan on {sources.scans} has a beam; {bag.listed()}")
    has_odometry = sources.odometry is not None and not survey.wheels.is_silent
    if sources.odometry is not None and not has_odometry:
        notes.append(SILENT)
    is_own = survey.own_parts.is_own
    read = without_own_parts(partial(_records, sources), is_own)
    return Log(
        name=bag.name,
        path=bag.path,
        T_base_laser=sources.mounting.T_base_laser,
        scan_count=survey.scans,
        records=LogRecords(survey.scans + survey.poses, read),
        noise=noise.covariance if has_odometry else unknown_motion,
        has_odometry=has_odometry,
        is_blind=survey.codes.is_blind,
        notes=(*notes, *own_parts_said(is_own)),
    )


def _sources(bag: Bag, choice: LogChoice) -> tuple[_Sources, list[str]]:
    """What of a bag is read, and in words why."""
    notes: list[str] = []
    scans = _topic(bag, choice.scan_topic, (LASER_SCAN,), "--scan-topic", ("/scan",), notes)
    if scans is None:
        raise ValueError(f"{bag.path}: no {LASER_SCAN}, so no scan to work with; {bag.listed()}")
    laser = frame_name(_first(bag, scans).header.frame_id)
    transforms = Transforms()
    for message in bag.messages([topic.name for topic in bag.topics if topic.type == TF]):
        transforms.add(message.content.transforms)
    types = (ODOMETRY,) if choice.odom_topic is None else (ODOMETRY, TF)
    odometry = _topic(bag, choice.odom_topic, types, "--odom-topic", ("/odom",), notes)
    odom = None
    if odometry is not None and odometry.type == ODOMETRY:
        base = _named_base(frame_name(_first(bag, odometry).child_frame_id), transforms)
    else:
        odom, base = _odometry_frames(transforms, laser)
        odometry = odometry or next((t for t in bag.topics if t.type == TF and odom), None)
        if odom is None and choice.odom_topic is not None:
            raise ValueError(f"{bag.path}: above {laser:.60} {choice.odom_topic} has no frame odom")
    mounting = _mounting(bag, choice, transforms, base, laser, odometry)
    by = f"the transform of {base:.60} in {odom:.60}" if odom else odometry and odometry.name
    said = f"odometry of {by}" if by else "no odometry: the scans alone tell the motion"
    notes.append(f"scans of {scans.name}, {said}; {laser:.60} on {base:.60}: {mounting}")
    name = None if odometry is None else odometry.name
    return _Sources(bag, scans.name, name, odom, base, mounting), notes


def _topic(
    bag: Bag,
    asked: str | None,
    types: tuple[str, ...],
    option: str,
    preferred: tuple[str, ...],
    notes: list[str],
) -> Topic | None:
    """The topic that was asked for, or the one of a type; None where there is none of it.

    Of several: the one with the preferred name, or that with the most messages, and a note says so.
    """
    found = [topic for topic in bag.topics if topic.type in types and topic.count > 0]
    if asked is not None:
        name = asked if asked.startswith("/") else f"/{asked}"
        for topic in found:
            if topic.name == name:
                return topic
        raise ValueError(
            f"{bag.path}: {option} {asked} is no topic of {' or '.join(types)} in it; {bag.listed()}"
        )
    if not found:
        return None
    best = max(found, key=lambda topic: (topic.name in preferred, topic.count))
    if len(found) > 1:
        names = ", ".join(topic.name for topic in found[:MOST_NAMED])
        notes.append(f"of {names} {best.name} is taken: choose by {option}")
    return best


def _first(bag: Bag, topic: Topic) -> Any:
    """The fields of the first message of a topic that has any."""
    messages = bag.messages([topic.name])
    try:
        return next(messages).content
    except StopIteration:
        raise ValueError(f"{bag.path}: {topic.name} has no message, though it is said to") from None
    finally:
        messages.close()


def _named_base(base: str, transforms: Transforms) -> str:
    """The frame of the robot that an odometry message means; many drivers leave it empty."""
    if base:
        return base
    return next((name for name in _USUAL_BASES if name in transforms.frames), _USUAL_BASES[0])


def _odometry_frames(transforms: Transforms, laser: str) -> tuple[str | None, str]:
    """The frame called odom above the laser, None if there is none, and the robot's frame in it."""
    line = transforms.above(laser)
    for base, odom in itertools.pairwise(line):
        if "odom" in odom.rsplit("/", maxsplit=1)[-1]:
            return odom, base
    return None, next((name for name in _USUAL_BASES if name in line), laser)


def _mounting(
    bag: Bag,
    choice: LogChoice,
    transforms: Transforms,
    base: str,
    laser: str,
    odometry: Topic | None,
) -> Mounting:
    """The laser on the robot, as given or by the transforms."""
    if choice.T_base_laser is not None:
        return Mounting(choice.T_base_laser)
    same = _USUAL_BASES if base in _USUAL_BASES else (base,)
    try:
        for name in (base, *same):
            mounting = transforms.mounting(name, laser)
            if mounting is not None:
                return mounting
    except ValueError as error:
        raise ValueError(f"{bag.path}: {error}; or give --mount") from error
    frames = ", ".join(f"{frame:.60}" for frame in transforms.frames[:MOST_NAMED]) or "none"
    raise ValueError(
        f"{bag.path}: no transform from {base or 'the robot':.60} to {laser:.60}, where"
        f" {'scans' if odometry is None else odometry.name} would need it (frames in its tf:"
        f" {frames}); give --mount X Y HEADING of the laser on the robot"
    )


def _records(sources: _Sources) -> Iterator[LogRecord]:
    """The records of a bag, one after the other."""
    waiting = ScansBetweenPoses()
    is_flipped, no_return_m = sources.mounting.is_flipped, sources.no_return_m
    for time_s, entry in in_stamp_order(_entries(sources)):
        if isinstance(entry, SE2):
            yield from waiting.add_pose(time_s, entry)
        else:
            yield from waiting.add_scan(time_s, partial(entry.scan, is_flipped, no_return_m))
    yield from waiting.rest()


def _entries(sources: _Sources) -> Iterator[_Entry]:
    """The sweeps and poses of a bag in the order of recording."""
    names = {sources.scans} | ({sources.odometry} if sources.odometry else set())
    if sources.odom is not None:
        names |= {topic.name for topic in sources.bag.topics if topic.type == TF}
    for message in sources.bag.messages(names):
        place = f"{sources.bag.path}: {message.topic} message {message.number}"
        if message.topic == sources.scans:
            stamp_s = _stamp_s(message.content.header, message)
            sweep = ScanMessage.of(message.content, stamp_s, place)
            if len(sweep.ranges):  # drivers that start up send sweeps without beams
                yield sweep.end_s, sweep
        elif sources.odom is None:
            pose = message.content.pose.pose
            stamp_s = _stamp_s(message.content.header, message)
            yield stamp_s, _pose(planar(pose.position, pose.orientation), stamp_s, place)
        else:
            yield from _poses_of_tf(message, sources, place)


def _poses_of_tf(message: BagMessage, sources: _Sources, place: str) -> Iterator[_Entry]:
    """The poses of the robot in its odometry's frame."""
    for one in message.content.transforms:
        child, parent = frame_name(one.child_frame_id), frame_name(one.header.frame_id)
        if (parent, child) == (sources.odom, sources.base):
            stamp_s = _stamp_s(one.header, message)
            pose = planar(one.transform.translation, one.transform.rotation)
            yield stamp_s, _pose(pose, stamp_s, place)


def _pose(pose: SE2 | None, stamp_s: float, place: str) -> SE2:
    if pose is None:
        raise ValueError(
            f"{place}: a pose is not finite, absurdly far, or its quaternion not of length 1"
        )
    try:
        check_stamped("pose", stamp_s, pose)
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from error
    return pose


def _stamp_s(header: Any, message: BagMessage) -> float:
    """When a message is of [s]; where that was never set, when it was recorded."""
    stamp_s = header.stamp.sec + header.stamp.nanosec * 1e-9
    is_unset = stamp_s == 0.0 and message.logged_s > _UNSTAMPED_S
    return float(message.logged_s if is_unset else stamp_s)


class _Survey:
    """What is learnt of a bag by reading it through: that it is whole, and what it holds."""

    def __init__(self) -> None:
        self.scans = self.poses = 0
        self.codes, self.wheels = NoReturnSearch(), SilentWheels()
        self.own_parts = OwnPartsSearch()
        self._spans = {"scans": [math.inf, -math.inf], "odometry": [math.inf, -math.inf]}

    def add(self, record: LogRecord, has_odometry: bool) -> None:
        """One record more."""
        span = self._spans["odometry" if record.scan is None else "scans"]
        span[0], span[1] = min(span[0], record.time_s), max(span[1], record.time_s)
        if record.scan is None:
            self.poses += 1
            self.wheels.add_pose(record.T_odom_base)
            return
        self.scans += 1
        angles_rad = record.scan.angles_rad
        step_rad = float(angles_rad[1] - angles_rad[0]) if len(angles_rad) > 1 else 0.0
        position = (record.T_odom_base.x, record.T_odom_base.y) if has_odometry else None
        self.codes.add(record.scan.ranges_m, step_rad, position)
        self.wheels.add_scan(record.scan.ranges_m)
        self.own_parts.add(record.scan.ranges_m)

    def check(self, name: str, sources: _Sources) -> None:
        """Raises ValueError where scans and odometry have nothing to do with each other."""
        if not self.poses or not self.scans:
            return
        scans, odometry = self._spans["scans"], self._spans["odometry"]
        if max(scans[0] - odometry[1], odometry[0] - scans[1]) > _APART_S:
            raise ValueError(
                f"{name}: {sources.scans} is of {scans[0]:.3f} to {scans[1]:.3f} s, and"
                f" {sources.odometry} of {odometry[0]:.3f} to {odometry[1]:.3f} s by their stamps:"
                " these are two clocks; choose another --odom-topic"
            )

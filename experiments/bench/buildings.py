"""`kitasap bench buildings`: logs of simulated buildings end in a right map, or in one called failed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from rich.table import Table

from experiments.bench.building_plans import PLANS, Plan, closed, rectangle
from experiments.bench.drive_troubles import TROUBLES, motions, spun, walkers
from experiments.bench.map_end import MOST_M, MOST_RMSE_M, MapEnd, table_of
from experiments.progress import CountProgress
from experiments.slam_log import default_mapped
from experiments.tables import wide_console
from slam.arrays import FloatArray
from slam.beams import Beams
from slam.measurements import LaserScan
from slam.metrics import absolute_errors
from slam.readers.log import Log, LogRecords
from slam.readers.log_odometry import USUAL_NOISE, unknown_motion
from slam.readers.log_record import LogRecord
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap

_MOST_RMSE, _MOST = 0.003, 0.01
"""Errors of a right map of a larger building, of the distance between the corners of the way."""
_LASERS = (
    (180, 180.0), (181, 180.0), (360, 180.0), (361, 180.0), (682, 240.0), (1081, 270.0),
)  # fmt: skip
"""Beams, fan [degrees]: those of SICK and Hokuyo."""
_RANGES_M = (8.0, 20.0, 30.0, 80.0)
_STEPS_M = (0.2, 0.4, 0.7, 1.0)
_STEPS_ALONE_M = (0.1, 0.15, 0.2, 0.3)
"""Between scans; without odometry."""
_TURN_RAD = 0.35
_SPEED_MPS, _FASTEST_S = 0.35, 0.2


@dataclass(frozen=True)
class Odometry:
    """What the wheels of a log are like: standard deviations of one log's scale and of its turn for
    each metre, and between which its noise is drawn: along, after a metre [m], and of the heading."""

    scale: float
    turn_rad_per_m: float
    noise_m: tuple[float, float]
    noise_rad: tuple[float, float]


ODOMETRY: dict[str, Odometry | None] = {
    "usual": Odometry(0.03, 0.01, (0.01, 0.05), (0.005, 0.03)),
    "bad": Odometry(0.12, 0.05, (0.05, 0.15), (0.03, 0.1)),
    "none": None,
}
"""Usual: as `LogOdometryNoise` takes it to be, and better."""


def print_benchmark(odometry: str, repeats: int, seed: int, trouble: str = "none") -> bool:
    """Maps and prints the table; whether no wrong map was called good.

    Raises ValueError for odometry or a trouble of which nothing is known here.
    """
    if odometry not in ODOMETRY:
        raise ValueError(f"expected odometry {', '.join(ODOMETRY)}, got '{odometry}'")
    if trouble not in TROUBLES:
        raise ValueError(f"expected trouble {', '.join(TROUBLES)}, got '{trouble}'")
    found = measured(odometry, repeats, seed, trouble)
    wide_console().print(_table(odometry, trouble, found, seed))
    return not any(one.is_deceptive for one in found)


def measured(odometry: str, repeats: int, seed: int, trouble: str = "none") -> list[MapEnd]:
    """Each kind of building, drawn anew in each repeat, with another laser and other wheels."""
    found: list[MapEnd] = []
    with CountProgress("buildings", len(PLANS) * repeats) as progress:
        for children in np.random.SeedSequence(seed).spawn(repeats):
            for name, own in zip(PLANS, children.spawn(len(PLANS)), strict=True):
                log, true = simulated(name, ODOMETRY[odometry], np.random.default_rng(own), trouble)
                slam_map = default_mapped(log).slam_map
                errors = absolute_errors(slam_map.trajectory.poses, true).position_m
                large_m = float(np.hypot(*np.ptp(true[:, :2], axis=0)))
                limits = max(MOST_RMSE_M, _MOST_RMSE * large_m), max(MOST_M, _MOST * large_m)
                found.append(MapEnd.judged(f"{name}; {log.name}", slam_map, errors, *limits))
                progress.update(len(found), name)
    return found


def simulated(
    name: str, odometry: Odometry | None, rng: np.random.Generator, trouble: str = "none"
) -> tuple[Log, FloatArray]:
    """A log of one building, whose name tells what is odd about it, and its true poses (N, 3);
    trouble: one of `TROUBLES`."""
    plan = PLANS[name](rng)
    step_m = float(rng.choice(_STEPS_ALONE_M if odometry is None else _STEPS_M))
    poses = driven(plan, step_m, rng)
    beams, fan_deg = _LASERS[rng.integers(len(_LASERS))]
    angles_rad = np.radians(np.linspace(-fan_deg / 2.0, fan_deg / 2.0, beams))
    range_m, people = float(rng.choice(_RANGES_M)), float(rng.choice([0.0, 0.0, 0.3]))
    way_m, by_wheels = _way_m(motions(poses)), motions(poses)
    if trouble == "spins":
        poses, by_wheels = spun(poses, step_m, rng)
    bodies = walkers(poses, rng) if trouble == "walkers" else [np.empty((0, 2, 2))] * len(poses)
    scans = list(scans_on_way(plan, poses, bodies, angles_rad, range_m, people, rng))
    told = told_by_wheels(by_wheels, odometry, rng)
    durations_s = [
        duration_s(*ends, step) for ends, step in zip(pairwise(poses), by_wheels, strict=True)
    ]
    times_s = np.cumsum(durations_s)
    records = [
        LogRecord(time_s, T_odom_base, replace(scan, time_s=time_s))
        for time_s, T_odom_base, scan in zip([0.0, *times_s.tolist()], told, scans, strict=True)
    ]
    words = f"{way_m:.0f} m, a scan each {step_m:g} m, {beams} beams of {range_m:g} m"
    log = Log(
        words + (", people" if people else ""), SE2.identity(), len(records),
        LogRecords(len(records), lambda: iter(records)),
        unknown_motion if odometry is None else USUAL_NOISE.covariance,
        has_odometry=odometry is not None,
    )  # fmt: skip
    return log, np.array([pose.as_array() for pose in poses])


def driven(plan: Plan, step_m: float, rng: np.random.Generator) -> list[SE2]:
    """Where scans are taken: along the way, swaying a little, and several at each of its corners."""
    poses: list[SE2] = []
    phase, done_m, heading = rng.uniform(0.0, 2.0 * math.pi), 0.0, None
    for start, end in pairwise(plan.way):
        length_m = float(np.hypot(*(end - start)))
        if length_m < 1e-6:
            continue
        along = (end - start) / length_m
        ahead = math.atan2(along[1], along[0])
        if heading is not None:
            turn = math.remainder(ahead - heading, 2.0 * math.pi)
            count = int(abs(turn) / _TURN_RAD)
            shares = (np.arange(count) + 1.0) / (count + 1.0)
            poses += [SE2(start[0], start[1], heading + share * turn) for share in shares]
        for at_m in np.arange(0.0, length_m, step_m):
            swing = math.sin(math.pi * at_m / length_m)
            aside_m = 0.1 * swing * math.sin(0.7 * (done_m + at_m) + phase)
            x, y = start + at_m * along + aside_m * np.array([-along[1], along[0]])
            sway = 0.07 * swing * math.cos(0.7 * (done_m + at_m) + phase)
            poses.append(SE2(x, y, ahead + sway))
        done_m, heading = done_m + length_m, ahead
    return poses


def _way_m(steps: list[SE2]) -> float:
    return sum(math.hypot(step.x, step.y) for step in steps)


def duration_s(one: SE2, other: SE2, by_wheels: SE2) -> float:
    """From one pose to another, or as long as the wheels turned if the robot stood."""
    way_m = math.hypot(other.x - one.x, other.y - one.y) or math.hypot(by_wheels.x, by_wheels.y)
    return max(_FASTEST_S, way_m / _SPEED_MPS)


def scans_on_way(
    plan: Plan,
    poses: list[SE2],
    bodies: list[FloatArray],
    angles_rad: FloatArray,
    range_m: float,
    people: float,
    rng: np.random.Generator,
) -> Iterator[LaserScan]:
    """What a laser sees, in whole centimetres; beside each pose's bodies (S, 2, 2) somebody stands before it
    in a share of the scans."""
    count, sigma_m = len(angles_rad), float(rng.choice([0.01, 0.02]))
    fan = Beams(np.zeros((count, 2)), angles_rad, np.zeros(count))
    bare = SegmentMap(plan.walls)
    for pose, walking in zip(poses, bodies, strict=True):
        walls = np.concatenate([plan.walls, walking]) if len(walking) else plan.walls
        seen = SegmentMap(walls) if len(walking) else bare
        if rng.random() < people:
            bearing, away_m = rng.uniform(-1.0, 1.0), rng.uniform(1.0, 3.0)
            there = pose @ SE2(away_m * math.cos(bearing), away_m * math.sin(bearing), 0.0)
            corners = rectangle(-0.15, -0.1, 0.15, 0.1)
            body = closed(np.array([there.x, there.y]) + corners)
            seen = SegmentMap(np.concatenate([walls, body]))
        ranges_m, _ = seen.ranges(fan, pose, 2.0 * range_m)
        ranges_m = np.maximum(np.round(ranges_m + rng.normal(0.0, sigma_m, count), 2), 0.0)
        yield LaserScan(0.0, angles_rad, np.where(ranges_m <= range_m, ranges_m, np.inf))


def told_by_wheels(
    steps: list[SE2], odometry: Odometry | None, rng: np.random.Generator
) -> list[SE2]:
    """Where the wheels say that the robot was, who made such steps; nowhere else, without any."""
    if odometry is None:
        return [SE2.identity()] * (len(steps) + 1)
    scale = 1.0 + odometry.scale * rng.normal()
    turn_rad_per_m = odometry.turn_rad_per_m * rng.normal()
    noise_m, noise_rad = rng.uniform(*odometry.noise_m), rng.uniform(*odometry.noise_rad)
    told = [SE2.identity()]
    for step in steps:
        way_m = math.hypot(step.x, step.y)
        off_m = noise_m * math.sqrt(way_m) * rng.normal(size=2) * [1.0, 0.3]
        off_rad = noise_rad * math.sqrt(way_m) + 0.03 * math.sqrt(abs(step.theta))
        turn = step.theta * (1.0 + 0.5 * (scale - 1.0)) + turn_rad_per_m * way_m
        told.append(
            told[-1]
            @ SE2(
                scale * step.x + off_m[0], scale * step.y + off_m[1], turn + off_rad * rng.normal()
            )
        )
    return told


def _table(odometry: str, trouble: str, found: list[MapEnd], seed: int) -> Table:
    troubled = "" if trouble == "none" else f", {trouble}"
    return table_of(
        found,
        "building",
        f"simulated buildings, odometry {odometry}{troubled}, seed {seed}",
        f"Position error of the scans; right: at most {MOST_RMSE_M:g} m (RMS) and below"
        f" {MOST_M:g} m, or {1000 * _MOST_RMSE:g} and {1000 * _MOST:g} mm for each metre of the"
        " diagonal of a larger one.",
    )

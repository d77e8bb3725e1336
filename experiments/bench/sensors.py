"""`kitasap bench sensors LOG`: a log as other lasers and other wheels would have recorded it, and as a robot that
drives the other way, end in a right map, or in one that is called failed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.bench.changed_logs import Case, print_ends, read_referenced
from experiments.bench.log_changes import (
    Change,
    in_turn,
    keeping,
    with_records,
    with_scans,
    with_wheels,
    without_wheels,
)
from slam.measurements import LaserScan
from slam.readers.log import Log
from slam.se2 import SE2
from slam.trajectory import Trajectory

_NOISE_M = 0.03
"""Of ranges, beside what the laser has: as of a URG-04LX in the sun."""
_DRIFT = 0.05, 0.05
"""Standard deviations of how much longer wheels tell each way, and of how they turn [rad/m]: one draw for a log."""
_AHEAD_M = 0.3
"""Of a laser before the axle, which nobody told."""


def print_benchmark(log_path: Path, reference: Path, repeats: int, seed: int) -> bool:
    """Changes, maps and prints the table; whether no wrong map was called good.

    Raises ValueError for files that are not what they should be.
    """
    log, against = read_referenced(log_path, reference)
    title = f"{log.name} by other sensors, each {repeats} times, seed {seed}"
    return print_ends(log, against, cases(against), repeats, seed, "sensors", title)


def cases(against: Trajectory) -> list[Case]:
    """What a log is changed to."""
    there = [Case(of, change, against) for of, change in SENSORS.items()]
    back = Trajectory(-against.times_s[::-1], against.poses[::-1])
    return there + [Case(of, change, back) for of, change in BACKWARDS.items()]


def _every_second_beam(log: Log, _: np.random.Generator) -> Log:
    return _with_beams(log, lambda angles_rad: np.arange(len(angles_rad)) % 2 == 0)


def _fan(degrees: float) -> Change:
    half_rad = math.radians(degrees) / 2.0 + 1e-6
    return lambda log, _: _with_beams(log, lambda angles_rad: np.abs(angles_rad) <= half_rad)


def _with_beams(log: Log, kept: Callable[[np.ndarray], np.ndarray]) -> Log:
    """The log with those beams alone."""

    def changed(_: int, scan: LaserScan) -> LaserScan:
        is_kept = kept(scan.angles_rad)
        times_s = scan.beam_times_s
        return replace(
            scan,
            angles_rad=scan.angles_rad[is_kept],
            ranges_m=scan.ranges_m[is_kept],
            beam_times_s=None if times_s is None else times_s[is_kept],
        )

    return with_scans(log, changed)


def _range(range_m: float) -> Change:
    return lambda log, _: with_scans(log, lambda _, scan: scan.cut(range_m))


def _noisy(log: Log, rng: np.random.Generator) -> Log:
    seed = int(rng.integers(2**63))

    def changed(index: int, scan: LaserScan) -> LaserScan:
        noise_m = np.random.default_rng([seed, index]).normal(0.0, _NOISE_M, len(scan.ranges_m))
        return replace(scan, ranges_m=np.maximum(scan.ranges_m + noise_m, 0.0))

    return with_scans(log, changed)


def _every_scan(count: int) -> Change:
    """One of so many scans is kept."""
    return lambda log, _: keeping(log, np.arange(log.scan_count) % count == 0)


def _drift(log: Log, rng: np.random.Generator) -> Log:
    scale, turn_rad_per_m = 1.0 + _DRIFT[0] * rng.normal(), _DRIFT[1] * rng.normal()

    def told(step: SE2) -> SE2:
        turn = step.theta + turn_rad_per_m * math.hypot(step.x, step.y)
        return SE2(scale * step.x, scale * step.y, turn)

    return with_wheels(log, told)


def _laser_ahead(log: Log, _: np.random.Generator) -> Log:
    ahead = SE2(_AHEAD_M, 0.0, 0.0)
    return with_wheels(log, lambda step: ahead @ step @ ahead.inverse())


def _backwards(log: Log, _: np.random.Generator) -> Log:
    """From its end to its start; the time counts down."""
    turned = [
        replace(
            record,
            time_s=-record.time_s,
            scan=None if record.scan is None else _counting_down(record.scan),
        )
        for record in reversed(list(log.records))
    ]
    return with_records(log, lambda _: iter(turned))


def _counting_down(scan: LaserScan) -> LaserScan:
    times_s = None if scan.beam_times_s is None else -scan.beam_times_s
    return replace(scan, time_s=-scan.time_s, beam_times_s=times_s)


SENSORS: dict[str, Change] = {
    "every second beam": _every_second_beam,
    "a fan of 120 degrees": _fan(120.0),
    "a fan of 90 degrees": _fan(90.0),
    "ranges up to 8 m": _range(8.0),
    "ranges up to 5.6 m": _range(5.6),
    "ranges up to 4 m": _range(4.0),
    f"ranges {100 * _NOISE_M:g} cm noisier": _noisy,
    "one scan of three": _every_scan(3),
    "one scan of six": _every_scan(6),
    f"wheels {100 * _DRIFT[0]:g} % off, and drifting": _drift,
    f"a laser {_AHEAD_M:g} m ahead, untold": _laser_ahead,
    "no wheels, every second beam": in_turn(without_wheels, _every_second_beam),
    "no wheels, a fan of 120 degrees": in_turn(without_wheels, _fan(120.0)),
    "no wheels, ranges up to 8 m": in_turn(without_wheels, _range(8.0)),
}
BACKWARDS: dict[str, Change] = {
    "driven backwards": _backwards,
    "driven backwards, no wheels": in_turn(_backwards, without_wheels),
    "driven backwards, ranges up to 8 m": in_turn(_backwards, _range(8.0)),
}

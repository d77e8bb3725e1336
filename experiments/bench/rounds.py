"""`kitasap bench rounds`: memory, and time for a scan, of a robot that drives the same way over and over."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from rich.table import Table

from experiments.bench.building_plans import Plan, ring
from experiments.bench.buildings import (
    ODOMETRY,
    driven,
    duration_s,
    scans_on_way,
    told_by_wheels,
)
from experiments.bench.drive_troubles import motions
from experiments.bench.map_end import MOST_M, MOST_RMSE_M
from experiments.bench.registration_run import one_core
from experiments.memory import MemoryGrowth
from experiments.progress import CountProgress
from experiments.tables import wide_console
from slam.arrays import FloatArray
from slam.frontend.kept_keyframes import has_scan
from slam.mapping import Mapper
from slam.metrics import absolute_errors
from slam.metrics.spread import Spread
from slam.readers.log import Log, LogRecords
from slam.readers.log_odometry import USUAL_NOISE
from slam.readers.log_record import LogRecord
from slam.se2 import SE2
from slam.slam_map import SlamMap
from slam.warm_up import warm_up

_STEP_M = 0.15
_ANGLES_RAD = np.radians(np.linspace(-90.0, 90.0, 181))
_RANGE_M = 20.0
_LENGTH_M, _WIDTH_M = (12.0, 18.0), (10.0, 14.0)
"""Of a block and the corridors about it: 40 to 55 m a round."""


@dataclass(frozen=True)
class Rounds:
    """So many rounds of a drive: scans and keyframes until then, of how many of these the scan is kept, by how much
    the process had grown [MB], None where no one tells, and the slowest update of a scan since the row before."""

    rounds: int
    scans: int
    keyframes: int
    kept: int
    memory_mb: float | None
    slowest_update_s: float


@dataclass(frozen=True)
class RoundsDriven:
    """What became of a drive: its rounds, 1, 2, 4, ... of them; the map, processor time of its end, how far its scans
    are off, and by how much the process had grown at most, for a moment or for good."""

    rounds: tuple[Rounds, ...]
    slam_map: SlamMap
    finish_s: float
    errors: Spread
    most_mb: float | None

    @property
    def is_right(self) -> bool:
        """Whether the map is right, and called good."""
        is_near = self.errors.rmse <= MOST_RMSE_M and self.errors.max < MOST_M
        return is_near and self.slam_map.verdict.is_good


def print_benchmark(rounds: int, seed: int) -> bool:
    """Drives and prints the table; whether the map is right, and called good."""
    with one_core():
        found = measured(rounds, seed)
    wide_console().print(_table(found, seed))
    return found.is_right


def measured(rounds: int, seed: int) -> RoundsDriven:
    """A drive of so many rounds, mapped."""
    log, true = simulated(rounds, np.random.default_rng(seed))
    warm_up()
    # poses that were drawn beforehand are not the mapper's to be looked through for garbage
    gc.collect()
    gc.freeze()
    growth, mapper = MemoryGrowth(), Mapper(log.T_base_laser)
    found, slowest_s, told = list[Rounds](), 0.0, 1
    with CountProgress("rounds", rounds) as progress:
        for count, one in enumerate(log.measurements(), start=1):
            started_s = time.thread_time()
            mapper.update(one)
            slowest_s = max(slowest_s, time.thread_time() - started_s)
            done = count * rounds // log.scan_count
            if done >= told or count == log.scan_count:
                keyframes = mapper.keyframes
                kept = sum(has_scan(keyframes, k) for k in range(len(keyframes)))
                grown_mb = growth.now_mb()
                found.append(Rounds(done, count, len(keyframes), kept, grown_mb, slowest_s))
                slowest_s, told = 0.0, 2 * told
                progress.update(done)
    started_s = time.thread_time()
    slam_map = mapper.finish()
    finish_s = time.thread_time() - started_s
    gc.unfreeze()
    errors = absolute_errors(slam_map.trajectory.poses, true).position_m
    return RoundsDriven(tuple(found), slam_map, finish_s, errors, growth.most_mb())


def simulated(rounds: int, rng: np.random.Generator) -> tuple[Log, FloatArray]:
    """A log of so many rounds of corridors about a block, and its true poses (N, 3); scans are made as they are
    asked for."""
    plan = ring(rng, _LENGTH_M, _WIDTH_M, laps=rounds)
    poses = driven(plan, _STEP_M, rng)
    steps = motions(poses)
    told = told_by_wheels(steps, ODOMETRY["usual"], rng)
    seed = int(rng.integers(2**63))

    def records() -> Iterator[LogRecord]:
        return _records(plan, poses, steps, told, np.random.default_rng(seed))

    log = Log(
        f"{rounds} rounds", SE2.identity(), len(poses), LogRecords(len(poses), records),
        USUAL_NOISE.covariance,
    )  # fmt: skip
    return log, np.array([pose.as_array() for pose in poses])


def _records(
    plan: Plan, poses: list[SE2], steps: list[SE2], told: list[SE2], rng: np.random.Generator
) -> Iterator[LogRecord]:
    nobody = [np.empty((0, 2, 2))] * len(poses)
    scans = scans_on_way(plan, poses, nobody, _ANGLES_RAD, _RANGE_M, 0.0, rng)
    ends = [(poses[0], poses[0]), *pairwise(poses)]
    time_s = 0.0
    for scan, T_odom_base, (one, other), step in zip(
        scans, told, ends, [SE2.identity(), *steps], strict=True
    ):
        time_s += duration_s(one, other, step)
        yield LogRecord(time_s, T_odom_base, replace(scan, time_s=time_s))


def _table(found: RoundsDriven, seed: int) -> Table:
    verdict = found.slam_map.verdict
    said = "good" if verdict.is_good else f"failed: {verdict.reasons[0]}"
    table = Table(
        title=f"corridors about a block, driven round and round, seed {seed}",
        caption=f"The map is called {said}; its scans are {found.errors.rmse:.3f} m off (RMS),"
        f" {found.errors.max:.3f} at most. {found.finish_s:.1f} s to finish it; with that the process"
        f" had grown by {_mb(found.most_mb)} at most.",
    )
    for column in (
        "rounds",
        "scans",
        "keyframes",
        "scans kept",
        "memory grew by",
        "slowest update",
    ):
        table.add_column(column, justify="right")
    for one in found.rounds:
        table.add_row(
            str(one.rounds), str(one.scans), str(one.keyframes), str(one.kept), _mb(one.memory_mb),
            f"{1000.0 * one.slowest_update_s:.0f} ms",
        )  # fmt: skip
    return table


def _mb(memory_mb: float | None) -> str:
    return "-" if memory_mb is None else f"{memory_mb:.0f} MB"

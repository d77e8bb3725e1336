"""Hours of driving with kidnaps, people and sensors that fail: `kitasap bench soak`."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from rich.markup import escape
from rich.table import Table

from experiments.memory import resident_mb
from experiments.sources import MeasurementSource
from experiments.tables import wide_console
from experiments.trials import Outcome, TrialConfig
from kitasap_sim.drive import Pilot
from kitasap_sim.hand import kidnap
from kitasap_sim.places import Place
from kitasap_sim.simulation import SensorFrame, Simulation
from slam.localization import Localizer
from slam.measurements import Measurement
from slam.se2 import SE2
from slam.verdict import Status

MOST_GROWN_MB = 20.0
"""Chosen: what an allocator keeps; a leak of 1 kB a scan would be 36 MB in an hour."""
_WARM_UP = 0.1
"""Share of the drive after which memory is first looked at."""
_KIDNAP_EVERY_S = 60.0
_FAULT_EVERY_S, _FAULT_S = 20.0, (0.2, 5.0)
_LONGEST_LEG_S = 60.0
"""By then a way is given up, should the robot be stuck."""
FAULTS = ("frozen", "nothing", "invalid", "covered", "noisy", "missing", "slipping")
"""The same scan again and again; no beam comes back; none is valid; a hand before a third of them; a
third are anywhere; no scan comes at all; a wheel turns in the air."""


@dataclass
class Faults:
    """What the sensors make of a frame; None: the scan is lost. Faults come and go by chance."""

    rng: np.random.Generator
    now: str = ""
    count: int = 0
    _until_s: float = 0.0
    _next_s: float = _FAULT_EVERY_S
    _last: SensorFrame | None = None
    _slipped: np.ndarray = field(default_factory=lambda: np.zeros(2))

    def frame(self, frame: SensorFrame) -> SensorFrame | None:
        """The frame as the robot gets it."""
        if frame.time_s >= self._until_s:
            self.now = ""
        if not self.now and frame.time_s >= self._next_s:
            self.now, self.count = str(self.rng.choice(FAULTS)), self.count + 1
            self._until_s = frame.time_s + self.rng.uniform(*_FAULT_S)
            self._next_s = self._until_s + self.rng.exponential(_FAULT_EVERY_S)
        if self.now == "slipping":
            self._slipped[0] += 5.0
        frame = replace(frame, wheel_ticks=frame.wheel_ticks + self._slipped)
        if self.now == "missing":
            return None
        if self.now == "frozen" and self._last is not None:
            return replace(frame, ranges_m=self._last.ranges_m)
        self._last = frame
        return replace(frame, ranges_m=self._ranges_m(frame.ranges_m))

    def _ranges_m(self, ranges_m: np.ndarray) -> np.ndarray:
        third, first = len(ranges_m) // 3, int(self.rng.integers(len(ranges_m)))
        some = (first + np.arange(third)) % len(ranges_m)
        changed = ranges_m.copy()
        if self.now == "nothing":
            changed[:] = np.inf
        elif self.now == "invalid":
            changed[:] = np.nan
        elif self.now == "covered":
            changed[: len(some)] = 0.05
        elif self.now == "noisy":
            changed[some] = self.rng.uniform(0.02, 4.0, third)
        return changed


@dataclass
class Soak:
    """What came of it. said: of all scans, how many were what; wrong_s: longest time in a row with a
    wrong pose believed; memory_mb: by simulated time."""

    hours: float
    said: Counter[str] = field(default_factory=Counter)
    wrong_in: Counter[str] = field(default_factory=Counter)
    kidnaps: int = 0
    found_again: int = 0
    faults: int = 0
    wrong_s: float = 0.0
    simulated_s: float = 0.0
    took_s: float = 0.0
    memory_mb: list[tuple[float, float]] = field(default_factory=list)

    @property
    def grown_mb(self) -> float:
        """From when it was warm to the end; 0 where memory cannot be read."""
        return self.memory_mb[-1][1] - self.memory_mb[0][1] if self.memory_mb else 0.0


def print_benchmark(config: TrialConfig, hours: float, seed: int) -> bool:
    """Drives, and prints what came of it; whether memory stayed flat."""
    soak = soaked(config, hours, seed)
    wide_console().print(_table(soak, config, seed))
    return soak.grown_mb <= MOST_GROWN_MB


def soaked(config: TrialConfig, hours: float, seed: int) -> Soak:
    """Drives for simulated hours. Raises whatever the localizer does, which is nothing, and
    RuntimeError for a pose that is not finite."""
    simulation_rng, way_rng, fault_rng = (
        np.random.default_rng(one) for one in np.random.SeedSequence(seed).spawn(3)
    )
    simulation = config.simulation(simulation_rng)
    start = SE2.from_array(simulation.truth().pose)
    robot = _Robot(config, simulation, start, Faults(fault_rng))
    soak, started_s = Soak(hours), time.monotonic()
    end_s = 3600.0 * hours
    look_at_s = [share * end_s for share in (_WARM_UP, 0.25, 0.5, 0.75, 1.0)]
    kidnap_s, wrong_since_s, is_lost = _KIDNAP_EVERY_S, math.inf, False
    for frame in _driven(simulation, way_rng, end_s):
        now_s = frame.time_s
        outcome = robot.take(frame)
        while look_at_s and now_s >= look_at_s[0] - 1.0:
            soak.memory_mb += [(now_s, mb) for mb in (resident_mb(),) if mb is not None]
            del look_at_s[0]
        if outcome is None:
            soak.said["no scan"] += 1
            continue
        said = _said(outcome)
        soak.said[said] += 1
        if said == "wrong and sure":
            soak.wrong_in[robot.faults.now or ("carried" if is_lost else "nothing wrong")] += 1
            wrong_since_s = min(wrong_since_s, now_s)
            soak.wrong_s = max(soak.wrong_s, now_s - wrong_since_s)
        else:
            wrong_since_s = math.inf
        if said == "tracked" and is_lost:
            soak.found_again, is_lost = soak.found_again + 1, False
        if now_s >= kidnap_s:
            kidnap(simulation, _free_of_people(simulation, way_rng))
            soak.kidnaps, is_lost = soak.kidnaps + 1, True
            kidnap_s = simulation.time_s + way_rng.uniform(0.5, 1.5) * _KIDNAP_EVERY_S
    soak.faults, soak.simulated_s = robot.faults.count, simulation.time_s
    soak.took_s = time.monotonic() - started_s
    return soak


class _Robot:
    """Follows itself by what its sensors say."""

    def __init__(
        self, config: TrialConfig, simulation: Simulation, start: SE2, faults: Faults
    ) -> None:
        from experiments.methods import METHODS

        known = config.known_place
        self._config, self._simulation, self.faults = config, simulation, faults
        self._source = MeasurementSource(known.laser, simulation.wheel_ticks())
        self._localizer: Localizer = METHODS[config.methods[0]].localizer(
            known, start, is_tracking=True, may_be_lost=True
        )

    def take(self, frame: SensorFrame) -> Outcome | None:
        """What it says after a frame; None where no scan came."""
        true = self._simulation.truth().pose
        came = self.faults.frame(frame)
        if came is None:
            return None
        measurement: Measurement = self._source.measurement(came)
        estimate = self._localizer.update(measurement)
        if not np.isfinite(estimate.T_map_base.as_array()).all():
            raise RuntimeError(f"at {frame.time_s:.1f} s the pose is {estimate.T_map_base}")
        return Outcome.of(estimate, true, self._config, is_guarded=True)


def _said(outcome: Outcome) -> str:
    if outcome.verdict.status is Status.TRACKING:
        return "tracked" if outcome.is_near else "wrong and sure"
    return "unsure" if outcome.verdict.status is Status.UNSURE else "lost"


def _driven(
    simulation: Simulation, rng: np.random.Generator, end_s: float
) -> Iterator[SensorFrame]:
    """Frames of a drive from one free spot to the next, however often it is carried elsewhere."""
    place: Place = simulation.world
    while simulation.time_s < end_s:
        here_m = simulation.truth().pose[:2]
        way_m = place.way(here_m, place.draw_free_pose(rng)[:2])
        leg_end_s = min(end_s, simulation.time_s + _LONGEST_LEG_S)
        for frame in Pilot(simulation, by_sight=True).follow(way_m[1:]):
            yield frame
            is_carried = math.dist(here_m, now_m := simulation.truth().pose[:2]) > 0.5
            here_m = now_m
            if is_carried or simulation.time_s >= leg_end_s:
                break


def _free_of_people(simulation: Simulation, rng: np.random.Generator) -> np.ndarray:
    """(3,) where the robot is set down: nobody stands there."""
    for _ in range(1000):
        pose = simulation.world.draw_free_pose(rng)
        legs_m = simulation.people_m().reshape(-1, 2) - pose[:2]
        if not (np.hypot(*legs_m.T) < 1.0).any():
            return pose
    raise RuntimeError("people stand everywhere")


def _table(soak: Soak, config: TrialConfig, seed: int) -> Table:
    table = Table(
        title=f"{soak.hours:g} simulated hours in {config.place}, {config.methods[0]}, people:"
        f" {config.people}, seed {seed}; took {soak.took_s:.0f} s",
        show_header=False,
    )
    table.add_column("")
    table.add_column("", justify="right")
    scans = max(1, sum(soak.said.values()))
    for name in ("tracked", "unsure", "lost", "wrong and sure", "no scan"):
        count = soak.said[name]
        table.add_row(f"scans: {name}", f"{count} ({100 * count / scans:.2f} %)")
    told = ", ".join(f"{name} {count}" for name, count in soak.wrong_in.most_common())
    table.add_row("wrong and sure, while", told or "never")
    table.add_row("longest wrong and sure", f"{soak.wrong_s:.1f} s")
    table.add_row("kidnaps, and then found again", f"{soak.kidnaps}, {soak.found_again}")
    table.add_row("sensor faults", str(soak.faults))
    for now_s, mb in soak.memory_mb:
        table.add_row(f"memory after {now_s / 60:.0f} min", f"{mb:.1f} MB")
    table.add_row(escape("memory grown"), f"{soak.grown_mb:+.1f} MB of {MOST_GROWN_MB:g} allowed")
    return table

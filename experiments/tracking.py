"""Tracking: the robot drives through a place that it knows, and follows itself scan by scan.

`--poses paper`: along the place's own track, turning on the spot at its corners. Any others:
round a circle somewhere in the free space, speed and turn rate held, which is the hardest for a
scan that takes its time. The turn rate is `--turn-rate`, the speed the paper's 0.2 m/s.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from experiments.bounds import scan_bound
from experiments.localization import in_view, make_localizers, start_error, update_all
from experiments.observer import NOBODY, TrialObserver
from experiments.sources import FLOOR_NOISE, MeasurementSource
from experiments.trials import Outcome, TrialConfig, TrialResult, bound_record
from kitasap_sim.drive import Driver, Pilot
from kitasap_sim.places import Place
from kitasap_sim.simulation import SensorFrame, Simulation
from slam.arrays import FloatArray
from slam.measurements import LaserScan
from slam.se2 import SE2
from slam.straightening import Straightener

NAME = "tracking"
DEFAULTS = TrialConfig()
SPEED_MPS = 0.2
"""The paper's "about 20 cm/sec" (Section 4.2)."""
SAMPLE_S = 2.0
"""From one sample to the next most of the fused error is forgotten."""
_ROOM_M = 0.1
"""Left around a circle: the wheels are not quite what the robot believes."""
_MAX_DRAWS = 10_000
_WAYPOINTS = 6


@dataclass(frozen=True)
class TrackingResult(TrialResult):
    """One drive. samples: records as of a trial, every two seconds, each with the NEES of all scans
    since the one before (scans_nees); series: every scan's errors. points_base: (N, 2) [m] of the last
    scan, straightened by the wheels, for pictures."""

    samples: list[dict[str, Any]] = field(default_factory=list)
    series: dict[str, Any] = field(default_factory=dict)
    points_base: FloatArray = field(default_factory=lambda: np.empty((0, 2)))

    def record(self) -> dict[str, Any]:
        """The drive as plain numbers: its end like any trial, then samples and series."""
        return super().record() | {"samples": self.samples, "series": self.series}


def run_trial(
    config: TrialConfig, rng: np.random.Generator, observer: TrialObserver = NOBODY
) -> TrackingResult:
    """One drive: every method gets the same measurements."""
    known, (pose_rng, simulation_rng) = config.known_place, rng.spawn(2)
    simulation = config.simulation(simulation_rng)
    start, side = _start(config, simulation.world, pose_rng)
    simulation.reset(start)
    believed = start + start_error(config, pose_rng)
    observer.begins(simulation, SE2.from_array(believed))
    noise = FLOOR_NOISE[config.odometry]
    source = MeasurementSource(known.laser, simulation.wheel_ticks(), noise)
    localizers = make_localizers(config, believed, is_tracking=True, may_be_lost=True)
    drive, straightener = _Drive(config, simulation), Straightener(known.T_base_laser)
    for frame in _driven(config, simulation, side, pose_rng):
        measurement, true = source.measurement(frame), simulation.truth().pose
        observer.frame(frame, true)
        bound = scan_bound(known, config.true_laser, measurement.scan, true)
        outcomes, cpu_s = update_all(config, localizers, measurement, true)
        observer.estimates(outcomes)
        drive.take(frame.time_s, measurement.scan, true, bound, outcomes, cpu_s)
        scan, motion = measurement.scan, measurement.motion
        duration_s = straightener.duration_s(measurement.time_s, motion)
        straightener.take_motion(measurement.time_s, scan.beam_times_s, motion, duration_s)
        if frame.time_s >= config.duration_s:
            break
    result = drive.result()
    return replace(result, points_base=straightener.beams(result.scans[-1]).points)


def checked(config: TrialConfig) -> TrialConfig:
    """The configuration, if there is room to drive. Raises ValueError if not."""
    config = config.checked()
    if config.poses != "paper":
        _free_circle(config, config.known_place.place, np.random.default_rng(0))
    return config


class _Drive:
    """What has been seen so far."""

    def __init__(self, config: TrialConfig, simulation: Simulation) -> None:
        self._config, self._simulation = config, simulation
        self._next_sample_s = SAMPLE_S
        self._told = 0
        self._samples: list[dict[str, Any]] = []
        self._series: dict[str, list[Any]] = {
            "time_s": [],
            "crlb_position_m": [],
            "crlb_heading_rad": [],
        }
        self._of_method: dict[str, dict[str, list[Any]]] = {
            name: {"position_error_m": [], "heading_error_rad": [], "nees": [], "verdict": []}
            for name in config.methods
        }
        self._last: TrialResult | None = None

    def take(
        self,
        time_s: float,
        scan: LaserScan,
        true: np.ndarray,
        bound: np.ndarray,
        outcomes: dict[str, Outcome],
        cpu_s: dict[str, float],
    ) -> None:
        """Notes one scan's outcomes."""
        limits = bound_record(bound)
        self._series["time_s"].append(round(time_s, 4))
        self._series["crlb_position_m"].append(_rounded(limits["position_m"]))
        self._series["crlb_heading_rad"].append(_rounded(limits["heading_rad"]))
        for name, outcome in outcomes.items():
            series = self._of_method[name]
            series["position_error_m"].append(_rounded(float(np.hypot(*outcome.error[:2]))))
            series["heading_error_rad"].append(_rounded(float(outcome.error[2])))
            series["verdict"].append(outcome.verdict.status.value)
            series["nees"].append(None if outcome.nees is None else round(outcome.nees, 3))
        self._last = TrialResult(
            [true], outcomes, time_s, bound, cpu_s, [scan], in_view(self._simulation)
        )
        if time_s >= self._next_sample_s - 1e-6:
            self._next_sample_s += SAMPLE_S
            self._samples.append(
                {"time_s": round(time_s, 4)}
                | self._last.record()
                | {"scans_nees": self._nees_since_sample()}
            )

    def _nees_since_sample(self) -> dict[str, list[float | None]]:
        """Of each method, the NEES of every scan that no sample has told yet."""
        first, self._told = self._told, len(self._series["time_s"])
        return {name: series["nees"][first:] for name, series in self._of_method.items()}

    def result(self) -> TrackingResult:
        """The whole drive; it succeeds for a method that was right at every sample."""
        assert self._last is not None
        outcomes = {
            name: replace(
                outcome,
                is_success=outcome.is_success
                and all(sample["methods"][name]["success"] for sample in self._samples),
            )
            for name, outcome in self._last.outcomes.items()
        }
        last = self._last
        return TrackingResult(
            last.true_poses, outcomes, last.sim_s, last.bound, last.cpu_s, last.scans,
            last.people_in_view, self._samples, self._series | {"methods": self._of_method},
        )  # fmt: skip


def _start(config: TrialConfig, place: Place, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """(3,) where the drive starts, and to which side a circle turns: 1 to the left."""
    if config.poses == "paper":
        return place.start, 1.0
    start, side = _free_circle(config, place, rng), 1.0
    if rng.random() < 0.5:  # the same circle the other way round
        start, side = start + np.array([0.0, 0.0, math.pi]), -1.0
    return start, side


def _driven(
    config: TrialConfig, simulation: Simulation, side: float, rng: np.random.Generator
) -> Iterator[SensorFrame]:
    """The frames of a drive: the first at rest, then on and on."""
    yield simulation.next_frame()
    if config.poses != "paper":
        simulation.drive(SPEED_MPS, side * config.turn_rate_radps)
        yield from simulation.frames()
    driver = Driver(speed_mps=SPEED_MPS, turn_rate_radps=config.turn_rate_radps)
    yield from _round_and_round(Pilot(simulation, driver), _loop(simulation.world, rng))


def _round_and_round(pilot: Pilot, corners_m: np.ndarray) -> Iterator[SensorFrame]:
    while True:
        yield from pilot.follow(corners_m)


def _loop(place: Place, rng: np.random.Generator) -> np.ndarray:
    """(T, 2) corners of the place's track, or of a way past some points drawn and back [m]."""
    if len(place.track_m) > 1:
        return place.track_m
    centres_m = place.free_centres_m
    drawn = centres_m[rng.integers(len(centres_m), size=_WAYPOINTS)]
    stops = np.concatenate([place.start[None, :2], drawn, place.start[None, :2]])
    ways = [place.way(start, end)[1:] for start, end in itertools.pairwise(stops)]
    return np.concatenate(ways)


def _free_circle(config: TrialConfig, place: Place, rng: np.random.Generator) -> np.ndarray:
    """(3,) a start on a circle driven counter-clockwise that is free all round, room beside it.

    Raises ValueError if the place has none.
    """
    radius_m = SPEED_MPS / config.turn_rate_radps
    turn = np.linspace(0.0, math.tau, 48, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rings_m = np.concatenate([radius_m * ring, (radius_m + _ROOM_M) * ring])
    for _ in range(_MAX_DRAWS):
        centre_m = place.draw_free_pose(rng)[:2]
        if place.is_free(centre_m + rings_m).all():
            at = rng.uniform(-math.pi, math.pi)
            x, y = centre_m + radius_m * np.array([math.cos(at), math.sin(at)])
            return np.array([x, y, at + math.pi / 2])
    raise ValueError(
        f"place {place.name}: no circle of {radius_m:.2f} m radius is free to drive; choose a higher"
        " --turn-rate, or --poses paper"
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 7)


if __name__ == "__main__":
    from experiments.cli import run_script

    run_script(NAME)

"""Experiment 3 (paper, Section 4.2, Fig. 6 and 7): an unknown place driven through, and mapped.

The robot drives along the track of the place at about 20 cm/s; its wheels are off by constants
drawn for each trial, and in every second trial people walk about. Somebody who sees the robot keeps
it on the track: left to its own wheels, it would drive into a wall. `--poses random`, and a place
without a track: a round through the whole free space, its points drawn.
"""

import time
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Protocol

import numpy as np

from experiments.map_quality import MapQuality, TrueMap
from experiments.mapping_drive import measured, round_through, track_or_round
from experiments.observer import NOBODY, TrialObserver
from experiments.trials import TrialConfig
from experiments.worlds import simulated
from kitasap_sim.laser import laser
from kitasap_sim.places import Place
from kitasap_sim.robot import OdometrySpread, odometry_preset
from slam.arrays import BoolArray, FloatArray
from slam.icp import IcpConfig, StopRule
from slam.icp_mapping import IcpMapper
from slam.loop_closing import without_ties
from slam.map_checks.map_consistency import MapVerdict
from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.metrics import AbsoluteErrors, absolute_errors
from slam.se2 import SE2
from slam.slam_map import SlamMap
from slam.trajectory import Trajectory

NAME = "mapping"
METHODS = ("odometry", "paper", "limit")
DEFAULTS = TrialConfig(place="place_fig6", people=3, methods=("paper", "limit"))
MOST_ATE_M = 0.05
LEAST_SHARE = 0.99
"""Of precision and recall: what a map must have to be a success, beside MOST_ATE_M."""
RATED_RANGE_M = {"urg_04lx": 4.0}
"""Hokuyo's data sheet: detection from 60 to 4 095 mm; what it returns from beyond is no promise."""

# The paper gives no values; experiments.paper says why this threshold. Unlike on a known map, most
# pairs farther apart than half a metre are of walls not seen before.
PAPER_MAPPING = IcpConfig(
    max_pair_distance_m=0.5, threshold_m2=1.6e-3, stop_rule=StopRule.CONVERGED
)


@dataclass(frozen=True, eq=False)
class MadeMap:
    """What one method made of a drive: where each scan was taken, and the points (K, 2) [m], in the
    frame of the first pose. verdict: what it says of itself, where it can; facts: what else; slam_map: of a `Mapper`, all of it."""

    trajectory: Trajectory
    points: FloatArray
    verdict: MapVerdict | None = None
    facts: dict[str, Any] = field(default_factory=dict)
    slam_map: SlamMap | None = field(default=None, repr=False)


@dataclass(frozen=True, eq=False)
class MapOutcome:
    """One method's map against the truth. in_world: its points (K, 2) and path (N, 2) [m], where
    they fit the true path best; end_error: (3,) of the last pose, seen from the true start;
    missed_m: (M, 2) [m] of the true surfaces, what could be seen and is not on it."""

    made: MadeMap
    ate: AbsoluteErrors
    quality: MapQuality
    end: SE2
    end_error: FloatArray
    points_m: FloatArray
    path_m: FloatArray
    missed_m: FloatArray

    @property
    def is_good(self) -> bool:
        """Whether the map is one to use."""
        quality = self.quality
        return (
            self.ate.position_m.rmse <= MOST_ATE_M
            and min(quality.precision, quality.recall) >= LEAST_SHARE
        )

    @property
    def is_called_failed(self) -> bool:
        """Whether the method itself says that it is not."""
        return self.made.verdict is not None and not self.made.verdict.is_good

    def record(self) -> dict[str, Any]:
        """The outcome as plain numbers; errors in metres and radians."""
        quality, verdict = self.quality, self.made.verdict
        return {
            "status": "failed" if self.is_called_failed else "matched",
            "reasons": [] if verdict is None else list(verdict.reasons),
            "success": self.is_good and not self.is_called_failed,
            "x_m": self.end.x,
            "y_m": self.end.y,
            "theta_rad": self.end.theta,
            "x_error_m": float(self.end_error[0]),
            "y_error_m": float(self.end_error[1]),
            "theta_error_rad": float(self.end_error[2]),
            "ate_m": self.ate.position_m.rmse,
            "ate_max_m": self.ate.position_m.max,
            "map_rmse_m": quality.rmse_m if np.isfinite(quality.rmse_m) else None,
            "map_precision": quality.precision,
            "map_recall": quality.recall,
            "map_points": len(self.points_m),
            **self.made.facts,
        }


@dataclass(frozen=True, eq=False)
class MappingResult:
    """One trial: the true poses (N, 3) of all scans, and what each method made of them."""

    config: TrialConfig
    true_poses: FloatArray
    outcomes: dict[str, MapOutcome]
    sim_s: float
    people: int
    odometry: dict[str, float]
    cpu_s: dict[str, float]

    def record(self) -> dict[str, Any]:
        """The trial as plain numbers, ready for a line of `trials.jsonl`."""
        way_m = float(np.hypot(*np.diff(self.true_poses[:, :2], axis=0).T).sum())
        return {
            "status": "ok",
            "sim_s": self.sim_s,
            "scans": len(self.true_poses),
            "way_m": way_m,
            "people": self.people,
            "odometry": self.odometry,
            "true_poses": [self.true_poses[0].tolist(), self.true_poses[-1].tolist()],
            "methods": {name: outcome.record() for name, outcome in self.outcomes.items()},
        }


class AnyMapper(Protocol):
    """What all methods have in common."""

    T_map_base: SE2

    def update(self, measurement: Measurement) -> object:
        """Places one scan."""


def run_trial(
    config: TrialConfig, rng: np.random.Generator, observer: TrialObserver = NOBODY
) -> MappingResult:
    """One trial: every method gets the same measurements."""
    way_rng, odometry_rng, simulation_rng = rng.spawn(3)
    odometry = OdometrySpread().drawn(odometry_preset(config.odometry), odometry_rng)
    range_max_m = _rated_range_m(config.laser)
    place = config.known_place.place
    simulation = simulated(
        place, config.laser, odometry, simulation_rng,
        people=config.people, mismatch=config.mismatch, range_max_m=range_max_m,
    )  # fmt: skip
    go = track_or_round if config.poses == "paper" else round_through
    corners_m = go(simulation.world, way_rng)
    mappers = {name: _mapper(name, config) for name in config.methods}
    cpu_s, true_poses, times_s = dict.fromkeys(mappers, 0.0), [], []
    for measurement, true in measured(config.known_place.laser, simulation, corners_m, observer):
        true_poses.append(true)
        times_s.append(measurement.time_s)
        for name, mapper in mappers.items():
            started_s = time.process_time()
            mapper.update(measurement)
            cpu_s[name] += time.process_time() - started_s
        observer.placed({name: mapper.T_map_base for name, mapper in mappers.items()})
    poses = np.array(true_poses)
    truth = true_map(config)
    is_seen = truth.seen_from(np.array(times_s), poses)
    outcomes = {}
    for name, mapper in mappers.items():
        started_s = time.process_time()
        made = _finished(mapper)
        cpu_s[name] += time.process_time() - started_s
        outcomes[name] = _outcome(made, poses, truth, is_seen)
    return MappingResult(
        config, poses, outcomes, simulation.time_s, config.people,
        {
            "radius_error": odometry.radius_error,
            "radius_mismatch": odometry.radius_mismatch,
            "track_error": odometry.track_error,
        },
        cpu_s,
    )  # fmt: skip


def of_trial(config: TrialConfig, index: int) -> TrialConfig:
    """The configuration of one trial of a run: people walk in every second one."""
    return config if index % 2 else replace(config, people=0)


def checked(config: TrialConfig) -> TrialConfig:
    """The configuration, if everything that it names exists. Raises ValueError if not."""
    if config.poses == "anywhere":
        raise ValueError(
            "poses of mapping are 'paper', the place's track, or 'random', not 'anywhere'"
        )
    return config.checked(METHODS)


def true_map(config: TrialConfig) -> TrueMap:
    """What the map of a trial is held against; made once per process."""
    return _true_map(config.place, config.laser)


def _mapper(name: str, config: TrialConfig) -> AnyMapper:
    T_base_laser = config.known_place.T_base_laser
    if name == "limit":
        return Mapper(T_base_laser)
    return IcpMapper(T_base_laser, PAPER_MAPPING if name == "paper" else None)


def _finished(mapper: AnyMapper) -> MadeMap:
    if isinstance(mapper, Mapper):
        slam_map = mapper.finish()
        facts = {
            "keyframes": len(slam_map.keyframes),
            "loops": len(without_ties(slam_map.loops)),
            "loops_rejected": len(without_ties(slam_map.rejected)),
        }
        return MadeMap(slam_map.trajectory, slam_map.points, slam_map.verdict, facts, slam_map)
    assert isinstance(mapper, IcpMapper)
    made = mapper.finish()
    return MadeMap(made.trajectory, made.points)


def _outcome(
    made: MadeMap, true_poses: FloatArray, truth: TrueMap, is_seen: BoolArray
) -> MapOutcome:
    ate = absolute_errors(made.trajectory.poses, true_poses)
    points_m = ate.T_true_estimated @ made.points
    path_m = ate.T_true_estimated @ made.trajectory.poses[:, :2]
    first = SE2.from_array(true_poses[0]) @ SE2.from_array(made.trajectory.poses[0]).inverse()
    end = first @ SE2.from_array(made.trajectory.poses[-1])
    true_end = SE2.from_array(true_poses[-1])
    end_error = np.array([end.x - true_end.x, end.y - true_end.y, (true_end.inverse() @ end).theta])
    quality, missed_m = truth.quality(points_m, is_seen), truth.missed_m(points_m, is_seen)
    return MapOutcome(made, ate, quality, end, end_error, points_m, path_m, missed_m)


def _rated_range_m(laser_name: str) -> float:
    """Of a laser as it is sold; one whose range was changed is rated to that."""
    sold = laser_name.partition(":")[0]
    is_as_sold = laser(laser_name).range_max_m == laser(sold).range_max_m
    return RATED_RANGE_M.get(sold, np.inf) if is_as_sold else np.inf


@cache
def _true_map(place: str, laser_name: str) -> TrueMap:
    spec = laser(laser_name)
    spec = replace(spec, range_max_m=min(spec.range_max_m, _rated_range_m(laser_name)))
    return TrueMap(Place(place).map_at(spec.mount_m[2]), spec)


if __name__ == "__main__":
    from experiments.cli import run_script

    run_script(NAME)

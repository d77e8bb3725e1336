"""Experiment 2 (paper, Section 4.1, second Fig. 5, Table 2): lifted, moved and turned.

The robot finds itself at (1), is carried to (2), -1 m in y and turned by 90 degrees, by hand, its
wheels held by the motors, and has to find itself again: its encoders tell nothing of the way. The
paper's protocol repeats one pair of poses; random ones start anywhere in the free space, wherever
(2) is free as well; `anywhere` draws (2) too, in any heading. Methods that know when they are lost
may look up to six times, turning on the spot in between where that tells more; the others have
their one scan at (2).
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from experiments.bounds import scan_bound
from experiments.localization import in_view, make_localizers, start_poses, update_all
from experiments.methods import KnownPlace
from experiments.observer import NOBODY, TrialObserver
from experiments.paper import KIDNAP_MOTION
from experiments.sources import MeasurementSource
from experiments.trials import Outcome, TrialConfig, TrialResult
from kitasap_sim.drive import Pilot
from kitasap_sim.hand import Operator, kidnap
from kitasap_sim.places import Place
from kitasap_sim.simulation import Simulation
from slam.beams import Beams
from slam.localization import Localizer
from slam.measurements import LaserScan, Measurement
from slam.se2 import SE2
from slam.verdict import Status

NAME = "kidnap"
DEFAULTS = TrialConfig()
MAX_LOOKS = 6
"""Scans after the kidnap within which a method has to be sure."""
_MAX_DRAWS = 10_000
_HAND_MARGIN_M = 0.05
"""Room left around (2) for the operator's inaccuracy: five of its standard deviations."""
_CLEAR_OF_PEOPLE_M = 0.5
"""Nobody stays where the robot is set down."""


@dataclass(frozen=True)
class KidnapResult(TrialResult):
    """One kidnap. looks: by method, what each scan after it brought, until the method was sure."""

    looks: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    false_alarms: dict[str, bool] = field(default_factory=dict)
    lost_scores: dict[str, dict[str, Any]] = field(default_factory=dict)
    """By method, what the scans before and after say for the pose believed: for the ROC."""
    last_scans: dict[str, LaserScan] = field(default_factory=dict)
    """By method, that of its last look."""

    def scan_of(self, method: str) -> LaserScan:
        """That of its last look; the robot may have turned for others since."""
        return self.last_scans[method]

    def record(self) -> dict[str, Any]:
        """The trial as plain numbers, with what each look brought."""
        record = super().record()
        for name, looks in self.looks.items():
            record["methods"][name] |= {
                "detected": looks[0]["verdict"] != Status.TRACKING.value,
                "false_alarm": self.false_alarms[name],
                "lost_scores": self.lost_scores[name],
                "looks": looks,
            }
        return record


def run_trial(
    config: TrialConfig, rng: np.random.Generator, observer: TrialObserver = NOBODY
) -> KidnapResult:
    """One trial: every method gets the same measurements, until it is sure."""
    known, (pose_rng, simulation_rng) = config.known_place, rng.spawn(2)
    simulation = config.simulation(simulation_rng)
    pose, believed = _start_with_free_target(config, simulation.world, pose_rng)
    simulation.reset(pose)
    source = MeasurementSource(known.laser, simulation.wheel_ticks())
    localizers = make_localizers(config, believed, may_be_lost=True)
    observer.begins(simulation, SE2.from_array(believed))
    frame = simulation.next_frame()
    before, true_before = source.measurement(frame), simulation.truth().pose
    observer.frame(frame, true_before)
    scores = {name: {"before": _score(known, one, before)} for name, one in localizers.items()}
    at_first, _ = update_all(config, localizers, before, true_before)
    observer.estimates(at_first)
    alarms = {name: o.verdict.status is Status.LOST for name, o in at_first.items()}
    kidnap(simulation, _target(config, simulation.world, pose, believed, pose_rng))
    legs_m = simulation.people_m().reshape(-1, 2) - simulation.truth().pose[:2]
    if (np.hypot(*legs_m.T) < _CLEAR_OF_PEOPLE_M).any():
        simulation.scatter_people()
    looks = _Looks(config, simulation, source, localizers, observer)
    looks.take(scores)
    bound = scan_bound(known, config.true_laser, looks.measurement.scan, looks.true)
    seen = in_view(simulation)
    while looks.is_wanted:
        looks.turn()
        looks.take()
    return KidnapResult(
        [true_before, looks.true], looks.outcomes, simulation.time_s, bound, looks.cpu_s,
        [before.scan, looks.measurement.scan], seen, looks.records,
        {name: alarms[name] for name in looks.records}, scores, looks.scans,
    )  # fmt: skip


class _Looks:
    """The scans after a kidnap, one after the other, to those methods that are not sure yet."""

    def __init__(
        self,
        config: TrialConfig,
        simulation: Simulation,
        source: MeasurementSource,
        localizers: dict[str, Localizer],
        observer: TrialObserver,
    ) -> None:
        self._config, self._simulation, self._source = config, simulation, source
        self._localizers, self._observer = localizers, observer
        self._waiting = dict(localizers)
        self.outcomes: dict[str, Outcome] = {}
        self.scans: dict[str, LaserScan] = {}
        self.cpu_s: dict[str, float] = {}
        self.records: dict[str, list[dict[str, Any]]] = {
            name: [] for name, localizer in localizers.items() if localizer.guard is not None
        }
        self.measurement: Measurement
        self.true: np.ndarray
        self._count = 0

    @property
    def is_wanted(self) -> bool:
        """Whether some method is not sure, and may look once more."""
        return bool(self._waiting) and self._count < MAX_LOOKS

    def take(self, scores: dict[str, dict[str, Any]] | None = None) -> None:
        """One more scan; scores: to be noted what it says for the poses believed so far."""
        frame = self._simulation.next_frame()
        self.measurement = self._source.measurement(frame)
        for name, noted in (scores or {}).items():
            known = self._config.known_place
            noted["after"] = _score(known, self._localizers[name], self.measurement)
        self.true = self._simulation.truth().pose
        self._observer.frame(frame, self.true)
        outcomes, cpu_s = update_all(self._config, self._waiting, self.measurement, self.true)
        self._observer.estimates(outcomes)
        self._count += 1
        self.outcomes |= outcomes
        self.scans |= dict.fromkeys(outcomes, self.measurement.scan)
        self.cpu_s = cpu_s | self.cpu_s  # of the first look: the search
        for name, outcome in outcomes.items():
            if name in self.records:
                self.records[name].append(_look(outcome, self.true))
            if name not in self.records or outcome.verdict.status is Status.TRACKING:
                del self._waiting[name]

    def turn(self) -> None:
        """On the spot, to where a method that is not sure expects to learn most."""
        for localizer in self._waiting.values():
            turn_rad = localizer.telling_turn_rad()
            if turn_rad:
                break
        else:
            return
        for frame in Pilot(self._simulation).turn(turn_rad):
            passed = self._source.measurement(frame)
            self._observer.frame(frame, self._simulation.truth().pose)
            for localizer in self._waiting.values():
                localizer.move(passed.time_s, passed.motion, passed.motion_covariance)


def _score(known: KnownPlace, localizer: Localizer, measurement: Measurement) -> dict[str, Any]:
    """What a scan says for the pose where a method believes to be, before it looks."""
    T_predicted = localizer.T_map_base @ measurement.motion
    beams = Beams.of(measurement.scan, known.T_base_laser)
    evidence = known.relocalizer.at(beams, T_predicted).evidence
    return {
        "inlier_ratio": evidence.inlier_ratio,
        "log_likelihood": evidence.log_likelihood,
        "violation_ratio": evidence.violation_ratio,
    }


def _look(outcome: Outcome, true: np.ndarray) -> dict[str, Any]:
    """What one scan brought: the verdict, the places it may be, and which of them is right."""
    places = outcome.verdict.hypotheses
    return {
        "verdict": outcome.verdict.status.value,
        "reasons": list(outcome.verdict.reasons),
        "is_near": outcome.is_near,
        "true_pose": true.tolist(),
        "places": [
            [*place.T_map_base.as_array().tolist(), place.log_likelihood] for place in places[:4]
        ],
    }


def checked(config: TrialConfig) -> TrialConfig:
    """The configuration, if it names a place where (2) is free. Raises ValueError if not."""
    config = config.checked()
    world = config.simulation(np.random.default_rng(0)).world
    _start_with_free_target(config, world, np.random.default_rng(0))
    return config


def _target(
    config: TrialConfig,
    place: Place,
    pose: np.ndarray,
    believed: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """(3,) where the hand goes."""
    if config.poses == "anywhere":
        return place.draw_free_pose(rng)
    nominal = believed if config.poses == "paper" else pose
    return Operator().aimed(nominal + KIDNAP_MOTION, rng)


def _start_with_free_target(
    config: TrialConfig, place: Place, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """`start_poses`, such that the robot can be set down at (2) as well.

    Raises ValueError if the place has no such pose.
    """
    if config.poses == "anywhere":
        return start_poses(config, place, rng)
    for _ in range(_MAX_DRAWS if config.poses == "random" else 1):
        pose, believed = start_poses(config, place, rng)
        if _is_free_around(place, (pose + KIDNAP_MOTION)[:2]):
            return pose, believed
    raise ValueError(
        f"place {place.name}: nothing is free 1 m lower in y than "
        + ("its start" if config.poses == "paper" else "any free pose")
        + "; the robot cannot be kidnapped as in the paper there, but --poses anywhere works"
    )


def _is_free_around(place: Place, point_m: np.ndarray) -> bool:
    """Whether the robot can stand at a point (2,) and within the hand's margin of it."""
    steps = _HAND_MARGIN_M * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    return bool(place.is_free(point_m + steps).all())


if __name__ == "__main__":
    from experiments.cli import run_script

    run_script(NAME)

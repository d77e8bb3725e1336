"""What a trial is, whatever the experiment: its configuration, its random numbers, its record."""

import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from experiments.bounds import nees
from experiments.methods import DEFAULT_METHODS, METHODS, KnownPlace, checked_methods
from experiments.paper import VICINITY_M, VICINITY_RAD
from experiments.worlds import checked_mismatch, simulated, true_laser
from kitasap_sim.laser import LaserSpec, laser
from kitasap_sim.places import Place
from kitasap_sim.robot import KITASAP2, odometry_preset
from kitasap_sim.simulation import Simulation
from slam.localization import Estimate
from slam.measurements import LaserScan
from slam.open3d_backend import load_open3d
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2, wrap_angle
from slam.verdict import Status, Verdict

Poses = Literal["paper", "random", "anywhere"]
MapOrigin = Literal["true", "made"]
MAX_TURN_RATE_RADPS = 1.5
"""Chosen: faster, the tires slip."""
MAX_DURATION_S = 86_400.0
"""Chosen: a day; a drive without an end is no trial."""
_DISOWNED = (MatchStatus.LOST, MatchStatus.NOT_CONVERGED, MatchStatus.DEGENERATE)
"""What a method says of a pose that it does not stand for."""
_EXPERIMENT_KEYS = {"localization": 1, "kidnap": 2, "mapping": 3, "tracking": 4}
"""Part of each trial's seed, so that no two experiments share random numbers."""


@dataclass(frozen=True)
class TrialConfig:
    """All that the outcome of a trial depends on, but its random numbers.

    poses: `paper` repeats one pair of poses with fresh noise; `random` draws them anywhere in the
    free space; `anywhere`, of a kidnap, sets the robot down anywhere too. start_error_m,
    start_error_rad: how wrong the robot's belief is at a random start, uniform to either side on
    each axis. people: walk about meanwhile. mismatch: in what the simulated robot and world differ
    from what is assumed, see `experiments.worlds`. map: the true one, or `made`: that which the robot
    made itself on a drive before. turn_rate_radps, duration_s: of tracking. A
    trial succeeds within success_m and success_rad.
    """

    poses: Poses = "paper"
    place: str = "room_fig4"
    laser: str = "urg_04lx"
    odometry: str = "as_built"
    methods: tuple[str, ...] = DEFAULT_METHODS
    # finer than 1 cm: along a round wall, pairs with points 1 cm apart held 3 scans in 100 up to
    # 3 cm off
    map_spacing_m: float = 0.0025
    start_error_m: float = 0.10
    start_error_rad: float = math.radians(5)
    people: int = 0
    mismatch: str = "none"
    map: MapOrigin = "true"
    turn_rate_radps: float = 0.5
    duration_s: float = 30.0
    success_m: float = VICINITY_M
    success_rad: float = VICINITY_RAD

    def checked(self, methods: Iterable[str] = METHODS) -> "TrialConfig":
        """The configuration, if every name in it exists, methods: among these.

        Raises ValueError in one line if not.
        """
        if self.poses not in get_args(Poses):
            raise ValueError(
                f"no poses called '{self.poses}'; there are: {', '.join(get_args(Poses))}"
            )
        if self.map not in get_args(MapOrigin):
            raise ValueError(
                f"no map called '{self.map}'; there are: {', '.join(get_args(MapOrigin))}"
            )
        checked_methods(self.methods, methods)
        odometry_preset(self.odometry)
        laser(self.laser)
        # whatever is wrong with the place, or the system, is said before the first trial
        _ = self.known_place.place.free_centres_m
        checked_mismatch(self.mismatch)
        if self.people < 0:
            raise ValueError(f"people are 0 or more, not {self.people}")
        self._check_sizes()
        is_turning = 0.0 < self.turn_rate_radps <= MAX_TURN_RATE_RADPS
        if not (is_turning and 1.0 <= self.duration_s <= MAX_DURATION_S):
            raise ValueError(
                f"a track needs turns above 0 and up to {MAX_TURN_RATE_RADPS} rad/s, and a second up"
                f" to a day, not {self.turn_rate_radps} rad/s and {self.duration_s} s"
            )
        self.simulation(np.random.default_rng(0))
        load_open3d()
        return self

    def _check_sizes(self) -> None:
        """Raises ValueError for a length or an angle that is none."""
        limits = {"start_error_m": 100.0, "start_error_rad": math.pi, "map_spacing_m": 1.0}
        limits |= {"success_m": 1000.0, "success_rad": 1000.0}  # as large for any that ends
        for name, most in limits.items():
            value, may_be_none = getattr(self, name), name.startswith("start")
            if not (0.0 < value <= most or (may_be_none and value == 0.0)):
                least = "0 or more" if may_be_none else "above 0"
                raise ValueError(f"{name} is {least} and at most {most:g}, not {value:g}")

    def simulation(self, rng: np.random.Generator) -> Simulation:
        """The simulated robot in its world as it truly is, at the place's start."""
        return simulated(
            self.known_place.place,
            self.laser,
            self.odometry,
            rng,
            people=self.people,
            mismatch=self.mismatch,
        )

    @property
    def true_laser(self) -> LaserSpec:
        """The laser as it truly is."""
        return true_laser(self.laser, self.mismatch)

    @property
    def known_place(self) -> KnownPlace:
        """The place with its true map; made once per process."""
        return _known_place(self.place, self.laser, self.map_spacing_m, self.map == "made")


@cache
def _known_place(place: str, laser_name: str, map_spacing_m: float, is_made: bool) -> KnownPlace:
    return KnownPlace(Place(place), laser(laser_name), map_spacing_m, is_made)


def forget_places() -> None:
    """The places known so far are made anew when they are wanted: their maps are large."""
    _known_place.cache_clear()


@dataclass(frozen=True)
class Outcome:
    """What one method made of a trial: estimated minus true pose, and what it says of itself.

    nees: normalised estimation error squared, where the method claims a covariance, (3, 3) as that of
    `Estimate`.
    """

    T_map_base: SE2
    error: np.ndarray
    match: ScanMatch
    is_success: bool
    is_near: bool = False
    nees: float | None = None
    warnings: tuple[str, ...] = ()
    verdict: Verdict = field(default_factory=lambda: Verdict(Status.TRACKING))
    covariance: np.ndarray | None = None

    @classmethod
    def of(
        cls, estimate: Estimate, true: np.ndarray, config: TrialConfig, *, is_guarded: bool
    ) -> "Outcome":
        """The outcome at a true pose (3,); a pose that is not believed is no success.

        is_guarded: the localizer has a guard, whose verdict it is; else only its match says
        whether the pose is believed, and odometry, which has none, is judged by where it is.
        """
        T_map_base = estimate.T_map_base
        error = T_map_base.as_array() - true
        error[2] = wrap_angle(error[2])
        is_near = np.hypot(*error[:2]) <= config.success_m and abs(error[2]) <= config.success_rad
        claimed = None
        if estimate.covariance is not None and estimate.covariance.any():
            tangent = (T_map_base.inverse() @ SE2.from_array(true)).log()
            claimed = nees(tangent, estimate.covariance)
        if is_guarded:
            is_believed = estimate.verdict.status is Status.TRACKING
        else:
            is_believed = estimate.match.status not in _DISOWNED
        return cls(
            T_map_base, error, estimate.match, bool(is_near and is_believed), bool(is_near),
            claimed, estimate.warnings, estimate.verdict, estimate.covariance,
        )  # fmt: skip

    def record(self) -> dict[str, Any]:
        """The outcome as plain numbers; errors in metres and radians."""
        return {
            "status": self.match.status.value,
            "verdict": self.verdict.status.value,
            "reasons": list(self.verdict.reasons),
            "success": self.is_success,
            "x_m": self.T_map_base.x,
            "y_m": self.T_map_base.y,
            "theta_rad": self.T_map_base.theta,
            "x_error_m": float(self.error[0]),
            "y_error_m": float(self.error[1]),
            "theta_error_rad": float(self.error[2]),
            "iterations": len(self.match.history),
            "error_m2": self.match.error_m2 if math.isfinite(self.match.error_m2) else None,
            "pair_count": self.match.pair_count,
            "nees": self.nees,
            "warnings": list(self.warnings),
            "steps": self._steps(),
        }

    def _steps(self) -> dict[str, list[float | None]] | None:
        """Expression (1) and the distance from the true position at each pass of the search, to
        four digits: what the curves of convergence are drawn of. None of a search without any."""
        history = self.match.history
        if not history:
            return None
        true = self.T_map_base.as_array() - self.error
        off_m = [math.hypot(s.T_map_base.x - true[0], s.T_map_base.y - true[1]) for s in history]
        return {
            "error_m2": [_four_digits(step.error_m2) for step in history],
            "position_error_m": [_four_digits(one) for one in off_m],
        }


def _four_digits(value: float) -> float | None:
    return float(f"{value:.4g}") if math.isfinite(value) else None


@dataclass(frozen=True)
class TrialResult:
    """One trial: the true poses, what each method found, and what was seen on the way.

    true_poses: the (3,) true poses at which scans were taken, the last being the one to find.
    bound: (3, 3) Cramer-Rao bound there, base frame. cpu_s: processor time of each method's last
    search, by method; kept out of the record, which is the same to the byte whenever the trial is
    repeated. scans: as taken at the true poses. people_in_view: how many had a leg in the last one.
    """

    true_poses: list[np.ndarray]
    outcomes: dict[str, Outcome]
    sim_s: float
    bound: np.ndarray
    cpu_s: dict[str, float] = field(default_factory=dict)
    scans: list[LaserScan] = field(default_factory=list, repr=False)
    people_in_view: int = 0

    def scan_of(self, method: str) -> LaserScan:
        """The scan that a method's outcome is of."""
        return self.scans[-1]

    def record(self) -> dict[str, Any]:
        """The trial as plain numbers, ready for a line of `trials.jsonl`."""
        return {
            "status": "ok",
            "sim_s": self.sim_s,
            "true_poses": [pose.tolist() for pose in self.true_poses],
            "crlb": bound_record(self.bound),
            "people_in_view": self.people_in_view,
            "methods": {name: outcome.record() for name, outcome in self.outcomes.items()},
        }


def bound_record(bound: np.ndarray) -> dict[str, float | None]:
    """The bound (3, 3) as two standard deviations; null where the scan leaves a direction open."""
    if not np.isfinite(bound).all():
        return {"position_m": None, "heading_rad": None}
    return {
        "position_m": math.sqrt(bound[0, 0] + bound[1, 1]),
        "heading_rad": math.sqrt(bound[2, 2]),
    }


def generator(experiment: str, seed: int, index: int) -> np.random.Generator:
    """The random numbers of one trial, by its number: the same in any shard and any process."""
    key = (_EXPERIMENT_KEYS[experiment], index)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def config_hash(experiment: str, config: TrialConfig, seed: int) -> str:
    """Names what the outcome of a run depends on: configuration, seed, code and libraries.

    Lines of a trial log under another hash are never mixed with these.
    """
    return _named(inputs(experiment, config, seed))


def inputs(experiment: str, config: TrialConfig, seed: int) -> dict[str, Any]:
    """All that the outcome of a run depends on; of files and code, digests of what they hold."""
    return {
        "experiment": experiment,
        "seed": seed,
        "config": asdict(config),
        "robot": _named(asdict(KITASAP2)),
        "place": config.known_place.place.digest,
        "code": _code_digest(),
    }


def _named(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


@cache
def _code_digest() -> str:
    """Of this project's sources and models, and of the libraries whose arithmetic enters."""
    from experiments.provenance import versions

    folders = [Path(str(files(name))) for name in ("kitasap_sim", "slam", "experiments", "models")]
    sources = [
        path for folder in folders for path in folder.rglob("*") if path.suffix in (".py", ".xml")
    ]
    return _digest(sorted(sources), json.dumps(versions(), sort_keys=True))


def _digest(paths: list[Path], more: str = "") -> str:
    digest = hashlib.sha256(more.encode())
    for path in paths:
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()

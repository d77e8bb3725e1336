"""Calibration: the simulated robot drives, and finds its laser's mounting and its wheels.

Not in the paper, whose robot is taken as measured. A turn on the spot to the left and back to the
right, then along the place's track, and so on back along it; slowly, since spinning tires give way.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from experiments.methods import METHODS, KnownPlace
from experiments.sources import DRIVE, MeasurementSource
from experiments.worlds import checked_mismatch, simulated, true_laser
from kitasap_sim.drive import Driver, Pilot
from kitasap_sim.laser import laser
from kitasap_sim.places import Place
from kitasap_sim.robot import KITASAP2, odometry_preset
from kitasap_sim.simulation import SensorFrame, Simulation
from slam.calibration import Calibration, calibrate
from slam.measurements import Measurement
from slam.se2 import SE2

DRIVER = Driver(turn_rate_radps=0.25, turn_acceleration_radps2=0.5)
"""Chosen: from 0.3 rad/s on the tires of `as_built` creep backwards while they spin, 1.5 mm per
radian at 0.5 rad/s; slower they do not."""
_SWING_RADPS = 0.04
"""Turned on the spot to each side per second of the drive: a third of a drive's time goes there."""
_WAYPOINTS = 6
_MAP_SPACING_M = 0.0025
_SEED_KEY = (5, 0)
"""After the experiments' own in `experiments.trials`."""
_LABELS = (
    *("radius left [mm]", "radius right [mm]", "track [mm]"),
    *("laser x [mm]", "laser y [mm]", "laser heading [deg]"),
)
OnScan = Callable[[float, float], None]
_SHOWN_PER_UNIT = np.array([1e3] * 5 + [180.0 / math.pi])


@dataclass(frozen=True)
class CalibrationConfig:
    """The drive and the robot. The names are those of `experiments.trials.TrialConfig`."""

    place: str = "room_fig4"
    laser: str = "urg_04lx"
    odometry: str = "as_built"
    mismatch: str = "mount"
    duration_s: float = 60.0

    def __post_init__(self) -> None:
        checked_mismatch(self.mismatch)
        odometry_preset(self.odometry)
        if not 5.0 <= self.duration_s < math.inf:
            raise ValueError(f"a calibration drive takes 5 s or more, not {self.duration_s} s")

    @property
    def true_values(self) -> np.ndarray:
        """(6,) as the simulated robot was built, in the order of `slam.calibration.PARAMETERS`."""
        built, spec = odometry_preset(self.odometry), true_laser(self.laser, self.mismatch)
        half = built.radius_mismatch / 2.0
        left_m, right_m = KITASAP2.wheel_radius_m * (
            1.0 + built.radius_error + np.array([half, -half])
        )
        track_m = KITASAP2.track_m * (1.0 + built.track_error)
        theta = spec.first_angle_rad - laser(self.laser).first_angle_rad
        return np.array([left_m, right_m, track_m, spec.mount_m[0], spec.mount_m[1], theta])


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """What was assumed, found and true; arrays (6,) as in `slam.calibration.PARAMETERS`."""

    assumed: np.ndarray
    found: Calibration
    true: np.ndarray

    @property
    def nees(self) -> float:
        """Normalised estimation error squared of the six; 6 on average where honest."""
        error = self.found.values - self.true
        return float(error @ np.linalg.solve(self.found.covariance, error))

    def table(self) -> str:
        """A line for each parameter, then how well the drive fits and what to do with it."""
        lines = [f"{'':20}{'assumed':>10}{'found':>10}{'+-':>9}{'true':>10}"]
        columns = (self.assumed, self.found.values, self.found.sigmas, self.true)
        rows = np.column_stack(columns) * _SHOWN_PER_UNIT[:, np.newaxis]
        for label, (assumed, found, sigma, true) in zip(_LABELS, rows, strict=True):
            lines.append(f"{label:20}{assumed:10.3f}{found:10.3f}{sigma:9.3f}{true:10.3f}")
        found = self.found
        lines.append(
            f"{found.matched} scans matched; residuals squared over promised (1 is as assumed,"
            f" less is better): scans {found.chi2_match:.2f}, wheels {found.chi2_wheels:.2f}"
        )
        lines.extend(f"warning: {warning}" for warning in found.warnings)
        if not found.is_observable:
            return "\n".join([*lines, f"not enough: {found.advice}"])
        mount, wheels = found.T_base_laser, found.drive
        left_m, right_m = wheels.wheel_radius_m
        return "\n".join(
            [
                *lines,
                "to use it, give these to Localizer and to the odometry:",
                f"  T_base_laser = SE2({mount.x:.5f}, {mount.y:.5f}, {mount.theta:.5f})",
                f"  drive = DifferentialDrive(({left_m:.6f}, {right_m:.6f}), {wheels.track_m:.5f},"
                f" {wheels.ticks_per_turn})",
            ]
        )


def run_calibration(
    config: CalibrationConfig, seed: int, on_scan: OnScan | None = None
) -> CalibrationResult:
    """One drive and what it tells. Raises ValueError where it cannot be driven or tells nothing.

    on_scan: told of the time of each scan and of the end of the drive [s].
    """
    known = KnownPlace(Place(config.place), laser(config.laser), _MAP_SPACING_M)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=_SEED_KEY))
    simulation_rng, way_rng = rng.spawn(2)
    simulation = simulated(
        known.place, config.laser, config.odometry, simulation_rng, mismatch=config.mismatch
    )
    start = SE2.from_array(simulation.truth().pose)
    measurements = _driven(known, simulation, config.duration_s, way_rng, on_scan)
    matcher = METHODS["limit"].matcher(known)
    found = calibrate(measurements, matcher, start, known.T_base_laser, DRIVE)
    assumed = np.array([*DRIVE.wheel_radius_m, DRIVE.track_m, *known.T_base_laser.as_array()])
    return CalibrationResult(assumed, found, config.true_values)


def _driven(
    known: KnownPlace,
    simulation: Simulation,
    duration_s: float,
    rng: np.random.Generator,
    on_scan: OnScan | None,
) -> list[Measurement]:
    source, measurements = MeasurementSource(known.laser, simulation.wheel_ticks()), []
    corners_m = _corners(simulation.world, rng)
    swing_rad = min(math.pi, _SWING_RADPS * duration_s)
    for frame in _frames(simulation, corners_m, swing_rad):
        measurements.append(source.measurement(frame))
        if on_scan is not None:
            on_scan(frame.time_s, duration_s)
        if frame.time_s >= duration_s:
            break
    return measurements


def _frames(
    simulation: Simulation, corners_m: np.ndarray, swing_rad: float
) -> Iterator[SensorFrame]:
    """The frames of a drive: the first at rest, then to and fro without an end."""
    yield simulation.next_frame()
    pilot = Pilot(simulation, DRIVER)
    while True:
        yield from pilot.turn(swing_rad)
        yield from pilot.turn(-swing_rad)
        yield from pilot.follow(corners_m)
        corners_m = corners_m[::-1]


def _corners(place: Place, rng: np.random.Generator) -> np.ndarray:
    """(T, 2) corners of the place's track, or of a way from its start past points drawn [m]."""
    if len(place.track_m) > 1:
        return place.track_m
    centres_m = place.free_centres_m
    stops = [place.start[:2], *centres_m[rng.integers(len(centres_m), size=_WAYPOINTS)]]
    ways = [place.way(start, end) for start, end in pairwise(stops)]
    return np.concatenate(ways)

"""Where the laser sits and what the wheels truly measure: found from one drive on a known map.

The six parameters of Censi, Franchi, Marchionni and Oriolo, "Simultaneous calibration of odometry
and sensor parameters for mobile robots", IEEE T-RO 29(2), 2013. They match scans with each other;
here each is matched on the map, and all poses along the drive are unknowns as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.deskew import BodyMotion, deskewed
from slam.drive_adjustment import (
    LEAST_SCANS,
    PARAMETER_COUNT,
    PARAMETERS,
    DriveAdjustment,
    WheelRecord,
)
from slam.matchers import Matcher
from slam.measurements import Measurement
from slam.odometry import DifferentialDrive
from slam.scan_match import ScanMatch
from slam.se2 import SE2

_MOST_SCANS = 0.5
"""Chosen: where fewer are matched, it is the place that leaves things open, and not the drive."""
_STRAIGHT = "drive straight for some metres"
_TURNS = "turn slowly on the spot, half a turn or more to the left and as much to the right"
_ADVICE = dict(
    zip(PARAMETERS, (_STRAIGHT, _STRAIGHT, _TURNS, _TURNS, _TURNS, _STRAIGHT), strict=True)
)
_MAX_CHI2 = 1.8
"""Chosen: drives as assumed show 0.7 to 1.2 for the scans and up to 1.5 for the wheels; ranges 5 mm
too long, which put the laser 1.2 mm off, show 2.0 and 3.9 or more."""


@dataclass(frozen=True)
class CalibrationConfig:
    """What is assumed before the drive, and how the search ends.

    prior_sigmas: radii and track as shares of the assumed, x, y [m], theta [rad], then side slip
    [s], lag [s] (see `WheelPrior`) and creep: metres forward per radian turned either way, by
    which spinning tires give way [m]. chosen: as wide as a wrong drawing; the last three several
    times what Kitasap2 shows. max_sigmas: of the six; one known less well is not observable.
    passes: scans are straightened and matched anew with what was found.
    max_match_sigmas: matches farther off than this count less (Huber).
    """

    prior_sigmas: tuple[float, ...] = (0.1, 0.1, 0.2, 0.3, 0.3, 0.3, 0.01, 0.02, 0.005)
    max_sigmas: tuple[float, ...] = (0.002, 0.002, 0.005, 0.003, 0.003, 0.005)
    passes: int = 2
    max_steps: int = 20
    max_match_sigmas: float = 4.0

    def __post_init__(self) -> None:
        if len(self.prior_sigmas) != PARAMETER_COUNT or len(self.max_sigmas) != len(PARAMETERS):
            raise ValueError(
                f"{PARAMETER_COUNT} prior_sigmas and {len(PARAMETERS)} max_sigmas, not {self}"
            )
        if self.passes < 1 or self.max_steps < 1:
            raise ValueError(f"a calibration needs a pass and a step at least, not {self}")


@dataclass(frozen=True, eq=False)
class Calibration:
    """The laser's mounting and the wheels as the drive shows them.

    covariance: (6, 6) of `PARAMETERS` [m], [rad]; widened where residuals were larger than promised,
    never narrowed. chi2_match, chi2_wheels: mean squared residual of each kind against its promise;
    1 is as assumed. side_slip_s, lag_s, creep_m: see `CalibrationConfig`. matched: of so many
    scans those that took part. not_observable: those of `PARAMETERS` that the drive leaves open.
    """

    T_base_laser: SE2
    drive: DifferentialDrive
    covariance: FloatArray
    chi2_match: float
    chi2_wheels: float
    side_slip_s: float
    lag_s: float
    creep_m: float
    matched: int
    scans: int
    not_observable: tuple[str, ...]

    @property
    def values(self) -> FloatArray:
        """(6,) as in `PARAMETERS`."""
        return np.array(
            [*self.drive.wheel_radius_m, self.drive.track_m, *self.T_base_laser.as_array()]
        )

    @property
    def sigmas(self) -> FloatArray:
        """(6,) standard deviations of `values`."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def is_observable(self) -> bool:
        """True when the drive shows all six."""
        return not self.not_observable

    @property
    def advice(self) -> str:
        """What to drive for what is still open; empty when nothing is."""
        ways = dict.fromkeys(_ADVICE[name] for name in self.not_observable)
        if not ways:
            return ""
        open_words = f"the drive does not show {', '.join(self.not_observable)}"
        if self.matched < _MOST_SCANS * self.scans:
            return (
                f"{open_words}: {self.matched} of {self.scans} scans were matched; drive where walls"
                " and furniture hold the pose in all directions"
            )
        return f"{open_words}: {'; '.join(ways)}"

    @property
    def warnings(self) -> tuple[str, ...]:
        """What does not fit the drive, in words; its sigmas are then too small for a bias."""
        kinds = {
            "scans": (self.chi2_match, "does the map hold, do the ranges carry an offset?"),
            "wheels": (self.chi2_wheels, "did they slip, or is their noise assumed too small?"),
        }
        return tuple(
            f"{kind} scatter {chi2:.1f} times as promised (squared): {question}"
            for kind, (chi2, question) in kinds.items()
            if chi2 > _MAX_CHI2
        )


def calibrate(
    measurements: Sequence[Measurement],
    matcher: Matcher,
    T_map_base: SE2,
    T_base_laser: SE2,
    drive: DifferentialDrive,
    config: CalibrationConfig | None = None,
) -> Calibration:
    """The mounting and the wheels that explain a drive best, all poses along it unknown too.

    measurements: of the whole drive, their motions by the assumed `drive`. matcher: one that knows
    its information. T_map_base: roughly where the drive starts. T_base_laser, drive: as assumed.
    What the drive leaves open stays about as assumed and is named, see `Calibration.advice`.
    Raises ValueError where fewer than 10 scans match, the matcher tells no information, or the
    motions come without covariance.
    """
    config = config or CalibrationConfig()
    wheels = WheelRecord.of(measurements, drive)
    found = assumed = np.array([1.0, 1.0, 1.0, *T_base_laser.as_array(), 0.0, 0.0, 0.0])
    for _ in range(config.passes):
        T_matched = SE2.from_array(found[3:6])
        motions = [SE2.exp(twist) for twist in wheels.twists(found)]
        matches = _matches(measurements, motions, matcher, T_map_base, T_matched)
        adjustment = DriveAdjustment(
            wheels, matches, T_matched, assumed, config.prior_sigmas, config.max_match_sigmas
        )
        found = adjustment.solve(found, config.max_steps)
    return _calibration(adjustment, found, drive, config, len(measurements))


def _calibration(
    adjustment: DriveAdjustment,
    found: FloatArray,
    drive: DifferentialDrive,
    config: CalibrationConfig,
    scans: int,
) -> Calibration:
    """The result at the parameters found (9,), of a drive of so many scans."""
    covariance = adjustment.covariance(found)[:6, :6]
    names = zip(PARAMETERS, np.diag(covariance), config.max_sigmas, strict=True)
    not_observable = tuple(name for name, variance, limit in names if variance > limit**2)
    units = np.array([*drive.wheel_radius_m, drive.track_m, 1.0, 1.0, 1.0])
    left, right, track = (found[:3] * units[:3]).tolist()
    return Calibration(
        T_base_laser=SE2.from_array(found[3:6]),
        drive=DifferentialDrive((left, right), track, drive.ticks_per_turn),
        covariance=covariance * np.outer(units, units),
        chi2_match=float(adjustment.spread[0]),
        chi2_wheels=float(adjustment.spread[1]),
        side_slip_s=float(found[6]),
        lag_s=float(found[7]),
        creep_m=float(found[8]),
        matched=adjustment.matched,
        scans=scans,
        not_observable=not_observable,
    )


def _matches(
    measurements: Sequence[Measurement],
    motions: Sequence[SE2],
    matcher: Matcher,
    T_map_base: SE2,
    T_base_laser: SE2,
) -> list[ScanMatch]:
    """Each scan, straightened by the wheels, on the map: each pose of its own, nothing fused."""
    found: list[ScanMatch] = []
    motion: BodyMotion | None = None
    for i, measurement in enumerate(measurements):
        beams = Beams.of(measurement.scan, T_base_laser)
        if i > 0:
            T_map_base = T_map_base @ motions[i - 1]
            if measurement.scan.beam_times_s is not None:
                start_s, end_s = measurements[i - 1].time_s, measurement.time_s
                motion = BodyMotion.over(motions[i - 1], start_s, end_s, motion)
                beams = deskewed(measurement.scan, T_base_laser, motion)
        match = matcher(beams, T_map_base)
        if match.is_matched:
            if match.information is None:
                raise ValueError("calibration needs a matcher that tells its information")
            T_map_base = match.T_map_base
            if motion is not None:
                match = replace(match, information=motion.less_sure(match.information))
        else:
            match = replace(match, T_map_base=T_map_base)
        found.append(match)
    matched = sum(match.is_matched for match in found)
    if matched < LEAST_SCANS:
        raise ValueError(
            f"{matched} of {len(found)} scans match the map, not {LEAST_SCANS} or more"
        )
    return found

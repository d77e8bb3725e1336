"""Wheels calibrated from a drive in an unknown place: by how scan after scan was matched.

The parameters are those of Censi, Franchi, Marchionni and Oriolo (IEEE T-RO 29(2), 2013), and three
more; `slam.calibration` finds them on a known map, and better.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from slam.arrays import FloatArray
from slam.drive_adjustment import PARAMETER_COUNT, WheelRecord
from slam.frontend.front_end import FrontEnd
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.keyframes import StepStatus
from slam.measurements import Measurement
from slam.odometry import DifferentialDrive, WheelModel
from slam.se2 import SE2

LEAST_STEPS = 50
"""Chosen: fewer motions show no wheels."""
_LOOSE = 100.0
"""Chosen: by which the wheels' variances are widened, so that matches tell of themselves."""
_LOOSE_STEP = (0.05, 0.05, 0.05)
_PRIOR_SIGMAS = (0.05, 0.05, 0.1, 0.05, 0.05, 0.05, 0.3, 0.05, 0.01)
"""Chosen: as `CalibrationConfig.prior_sigmas`; of a robot that is known roughly, and may slip."""
_FAR = 2.0
"""Chosen: scatters at which a motion counts half (Cauchy)."""
_ROUNDS = 30


@dataclass(frozen=True, eq=False)
class SeenMotions:
    """What the scans and the wheels told of the same motions, (N, 3) twists each, and how long they
    took, (N,) [s]."""

    by_scans: FloatArray
    by_wheels: FloatArray
    duration_s: FloatArray

    def __len__(self) -> int:
        return len(self.duration_s)

    @staticmethod
    def of(measurements: Iterable[Measurement], T_base_laser: SE2) -> SeenMotions:
        """Of a drive, each scan matched with those before it, the wheels hardly heard."""
        front_end = FrontEnd(T_base_laser, FrontEndConfig(step_sigma=_LOOSE_STEP))
        rows: list[FloatArray] = []
        last_s, T_last, was_matched = 0.0, SE2.identity(), False
        for measurement in measurements:
            loose = _LOOSE * measurement.motion_covariance
            step = front_end.update(replace(measurement, motion_covariance=loose))
            is_matched = step.status is StepStatus.MATCHED
            duration_s = measurement.time_s - last_s
            if was_matched and is_matched and duration_s > 0.0:
                seen = T_last.inverse() @ step.T_map_base
                rows.append(np.array([*seen.log(), *measurement.motion.log(), duration_s]))
            last_s, T_last, was_matched = measurement.time_s, step.T_map_base, is_matched
        told = np.array(rows).reshape(-1, 7)
        return SeenMotions(told[:, :3], told[:, 3:6], told[:, 6])


@dataclass(frozen=True, eq=False)
class WheelCalibration:
    """The wheels as a drive shows them. sigmas: (9,) of `values`, as in `drive_adjustment`; scatter:
    (3,) of a scan's motion about the wheels' [m], [m], [rad], before: by the wheels as assumed."""

    wheels: WheelModel
    values: FloatArray
    sigmas: FloatArray
    scatter_before: FloatArray
    scatter: FloatArray


def calibrated_wheels(seen: SeenMotions, assumed: WheelModel) -> WheelCalibration:
    """The wheels, the laser's place and its lateness that explain the motions seen best.

    Robust: motions far off count little. Raises ValueError for fewer than 50 motions.
    """
    if len(seen) < LEAST_STEPS:
        raise ValueError(f"wheels are calibrated from {LEAST_STEPS} motions, not {len(seen)}")
    wheels = _record(seen, assumed.drive)
    start = np.array([1.0, 1.0, 1.0, *assumed.T_base_laser.as_array(), 0.0, 0.0, 0.0])
    # the wheels' twists that the log told have the slip assumed within
    start[6] = assumed.side_slip_s
    found, prior = start, np.diag(np.array(_PRIOR_SIGMAS) ** -2.0)
    before = _scatter(seen.by_scans - _predicted(wheels, start, assumed.T_base_laser))
    for _ in range(_ROUNDS):
        r = seen.by_scans - _predicted(wheels, found, assumed.T_base_laser)
        scatter = _scatter(r)
        weights = 1.0 / (1.0 + np.sum(np.square(r / scatter), axis=1) / (3.0 * _FAR**2))
        J = _slopes(wheels, found, assumed.T_base_laser)
        W = weights[:, np.newaxis] / np.square(scatter)
        information = np.einsum("nip,ni,niq->pq", J, W, J) + prior
        step = np.linalg.solve(
            information, np.einsum("nip,ni->p", J, W * r) + prior @ (start - found)
        )
        found = found + step
        sigmas = np.sqrt(np.diag(np.linalg.inv(information)))
        if (np.abs(step) < 1e-3 * sigmas).all():
            break
    left, right = np.array(assumed.drive.wheel_radius_m) * found[:2]
    drive = replace(
        assumed.drive,
        wheel_radius_m=(float(left), float(right)),
        track_m=assumed.drive.track_m * float(found[2]),
    )
    model = WheelModel(
        drive, SE2.from_array(found[3:6]), float(found[6]), assumed.late_s - float(found[7])
    )
    after = _scatter(seen.by_scans - _predicted(wheels, found, assumed.T_base_laser))
    return WheelCalibration(model, found, sigmas, before, after)


def _record(seen: SeenMotions, drive: DifferentialDrive) -> WheelRecord:
    ahead_m, turn_rad = seen.by_wheels[:, 0], seen.by_wheels[:, 2]
    half_m = turn_rad * drive.track_m / 2.0
    rates = np.column_stack([ahead_m, turn_rad]) / seen.duration_s[:, np.newaxis]
    changes = np.gradient(rates, axis=0)
    none = np.zeros((len(seen), 3, 3))
    travel_m = np.column_stack([ahead_m - half_m, ahead_m + half_m])
    return WheelRecord(travel_m, seen.duration_s, changes, none, drive.track_m)


def _predicted(wheels: WheelRecord, found: FloatArray, T_assumed: SE2) -> FloatArray:
    """(N, 3) twists of the base as the scans see it, where the laser's place is assumed."""
    T_base_seen = SE2.from_array(found[3:6]) @ T_assumed.inverse()
    return np.asarray(wheels.twists(found) @ T_base_seen.inverse().adjoint().T)


def _slopes(wheels: WheelRecord, found: FloatArray, T_assumed: SE2) -> FloatArray:
    """(N, 3, 9) of `_predicted` by the parameters."""
    size, now = 1e-6, _predicted(wheels, found, T_assumed)
    slopes = np.empty((*now.shape, PARAMETER_COUNT))
    for i in range(PARAMETER_COUNT):
        moved = found.copy()
        moved[i] += size
        slopes[:, :, i] = (_predicted(wheels, moved, T_assumed) - now) / size
    return slopes


def _scatter(residuals: FloatArray) -> FloatArray:
    """(3,) standard deviations of residuals (N, 3), most of them."""
    return np.asarray(np.maximum(1.4826 * np.median(np.abs(residuals), axis=0), 1e-5))

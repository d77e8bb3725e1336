"""Where the laser sits and what the wheels truly measure: found from one drive on a known map.

The six parameters of Censi, Franchi, Marchionni and Oriolo, "Simultaneous calibration of odometry
and sensor parameters for mobile robots", IEEE T-RO 29(2), 2013. They match scans with each other;
here each is matched on the map, and all poses along the drive are unknowns as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, coo_array, csc_array, diags_array
from scipy.sparse.linalg import SuperLU, splu

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.deskew import BodyMotion, deskewed
from slam.matchers import Matcher
from slam.measurements import Measurement
from slam.odometry import DifferentialDrive
from slam.scan_match import ScanMatch
from slam.se2 import SE2

PARAMETERS = ("radius_left_m", "radius_right_m", "track_m", "x_m", "y_m", "theta_rad")
"""What is found, in the order of `Calibration.covariance`."""

_STRAIGHT = "drive straight for some metres"
_TURNS = "turn slowly on the spot, half a turn or more to the left and as much to the right"
_ADVICE = dict(
    zip(PARAMETERS, (_STRAIGHT, _STRAIGHT, _TURNS, _TURNS, _TURNS, _STRAIGHT), strict=True)
)
_COUNT = len(PARAMETERS) + 3
"""With the three of no interest: side slip, lag and creep."""
_PROBES = 30
"""Chosen: the traces of some thousand residuals come out to a percent."""
_LEAST_SCANS = 10
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
        if len(self.prior_sigmas) != _COUNT or len(self.max_sigmas) != len(PARAMETERS):
            raise ValueError(f"{_COUNT} prior_sigmas and {len(PARAMETERS)} max_sigmas, not {self}")
        if self.passes < 1 or self.max_steps < 1:
            raise ValueError(f"a calibration needs a pass and a step at least, not {self}")


@dataclass(frozen=True, eq=False)
class Calibration:
    """The laser's mounting and the wheels as the drive shows them.

    covariance: (6, 6) of `PARAMETERS` [m], [rad]; widened where residuals were larger than promised,
    never narrowed. chi2_match, chi2_wheels: mean squared residual of each kind against its promise;
    1 is as assumed. side_slip_s, lag_s, creep_m: see `CalibrationConfig`. matched: scans that took
    part. not_observable: those of `PARAMETERS` that the drive leaves open.
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
        return f"the drive does not show {', '.join(self.not_observable)}: {'; '.join(ways)}"

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
    wheels = _Wheels.of(measurements, drive)
    found = assumed = np.array([1.0, 1.0, 1.0, *T_base_laser.as_array(), 0.0, 0.0, 0.0])
    for _ in range(config.passes):
        T_matched = SE2.from_array(found[3:6])
        motions = [SE2.exp(twist) for twist in wheels.twists(found)]
        matches = _matches(measurements, motions, matcher, T_map_base, T_matched)
        problem = _Problem(wheels, matches, T_matched, assumed, config)
        found = problem.solve(found)
    return problem.calibration(found, drive)


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
        variance = np.zeros((3, 3))
        if i > 0:
            T_map_base = T_map_base @ motions[i - 1]
            if measurement.scan.beam_times_s is not None:
                start_s, end_s = measurements[i - 1].time_s, measurement.time_s
                motion = BodyMotion.over(motions[i - 1], start_s, end_s, motion)
                beams = deskewed(measurement.scan, T_base_laser, motion)
                variance = np.diag(motion.unsteadiness**2)
        match = matcher(beams, T_map_base)
        if match.is_matched:
            if match.information is None:
                raise ValueError("calibration needs a matcher that tells its information")
            T_map_base = match.T_map_base
            # as less sure as deskewing may have missed: (R + D)^-1
            wider = np.linalg.inv(np.linalg.inv(match.information) + variance)
            match = replace(match, information=np.asarray(wider, dtype=np.float64))
        else:
            match = replace(match, T_map_base=T_map_base)
        found.append(match)
    matched = sum(match.is_matched for match in found)
    if matched < _LEAST_SCANS:
        raise ValueError(
            f"{matched} of {len(found)} scans match the map, not {_LEAST_SCANS} or more"
        )
    return found


@dataclass(frozen=True, eq=False)
class _Wheels:
    """What the wheels told between N scans, by the assumed drive.

    travel_m: (N-1, 2) left, right; duration_s: (N-1,); changes: (N-1, 2) of forward speed and turn
    rate since the interval before; covariances: (N-1, 3, 3) of each motion's noise.
    """

    travel_m: FloatArray
    duration_s: FloatArray
    changes: FloatArray
    covariances: FloatArray
    track_m: float

    @staticmethod
    def of(measurements: Sequence[Measurement], drive: DifferentialDrive) -> _Wheels:
        if len(measurements) < _LEAST_SCANS:
            raise ValueError(
                f"a calibration needs {_LEAST_SCANS} scans or more, not {len(measurements)}"
            )
        duration_s = np.diff([measurement.time_s for measurement in measurements])
        if not (duration_s > 0.0).all():
            raise ValueError("measurements must come in the order of time")
        twists = np.array([measurement.motion.log() for measurement in measurements[1:]])
        v, w = twists[:, 0], twists[:, 2]
        half_m = w * drive.track_m / 2.0
        rates = np.column_stack([v, w]) / duration_s[:, np.newaxis]
        changes = np.diff(rates, axis=0, prepend=rates[:1])
        covariances = np.array([measurement.motion_covariance for measurement in measurements[1:]])
        if not (np.linalg.eigvalsh(covariances)[:, 0] > 0.0).all():
            raise ValueError("each measurement's motion_covariance must be positive definite")
        return _Wheels(
            np.column_stack([v - half_m, v + half_m]), duration_s, changes, covariances,
            drive.track_m,
        )  # fmt: skip

    def twists(self, found: FloatArray) -> FloatArray:
        """(N-1, 3) motions as they truly were, if the parameters (9,) are right."""
        left, right, track, _, _, _, slip, lag, creep = found
        left_m, right_m = self.travel_m[:, 0] * left, self.travel_m[:, 1] * right
        v, w = (left_m + right_m) / 2.0, (right_m - left_m) / (self.track_m * track)
        aside = slip * v * w / self.duration_s
        ahead = v + lag * self.changes[:, 0] + creep * np.abs(w)
        return np.column_stack([ahead, aside, w + lag * self.changes[:, 1]])

    def slopes(self, found: FloatArray) -> FloatArray:
        """(N-1, 3, 9) of the motions' ends, base frame there, by the parameters."""
        step = 1e-6  # linear in all but the track
        twists = self.twists(found)
        slopes = np.zeros((*twists.shape, _COUNT))
        for i in range(_COUNT):
            moved = found.copy()
            moved[i] += step
            slopes[:, :, i] = (self.twists(moved) - twists) / step
        # right Jacobian of exp: 1 - ad / 2 + ad^2 / 6, for steps of a tenth of a radian
        ad = np.zeros((len(twists), 3, 3))
        ad[:, 0, 1], ad[:, 0, 2] = -twists[:, 2], twists[:, 1]
        ad[:, 1, 0], ad[:, 1, 2] = twists[:, 2], -twists[:, 0]
        return np.asarray((np.eye(3) - ad / 2.0 + ad @ ad / 6.0) @ slopes)


class _Problem:
    """All poses of a drive and the parameters, least squares: unknowns (3 N + 9,), poses first."""

    def __init__(
        self,
        wheels: _Wheels,
        matches: Sequence[ScanMatch],
        T_matched: SE2,
        assumed: FloatArray,
        config: CalibrationConfig,
    ) -> None:
        """T_matched: T_base_laser with which the scans were matched."""
        self._wheels, self._T_matched, self._config = wheels, T_matched, config
        self._assumed = assumed
        self._at = np.flatnonzero([match.is_matched for match in matches])
        matched = [match for match in matches if match.is_matched]
        self._seen = [match.T_map_base for match in matched]
        self._information = np.array([match.information for match in matched])
        self._stiffness = np.linalg.inv(wheels.covariances)
        self._poses = [match.T_map_base for match in matches]
        self._scales = np.ones(2)
        """By how much matches and wheels scatter wider than promised, at least 1 (variances)."""
        self._spread = np.ones(2)

    def solve(self, found: FloatArray) -> FloatArray:
        """The parameters (9,) by Gauss-Newton; the poses end in `self._poses`."""
        self._fill_gaps(found)
        for _ in range(self._config.max_steps):
            J, W, r = self._linearised(found)
            factor = _factored(J, W)
            step = -factor.solve(J.T @ (W @ r))
            self._poses = [
                T @ SE2.exp(twist)
                for T, twist in zip(self._poses, step[:-_COUNT].reshape(-1, 3), strict=True)
            ]
            found = found + step[-_COUNT:]
            self._spread = self._spreads(J, W, r + J @ step, factor)
            scales = np.maximum(self._spread, 1.0)
            is_still = bool((np.abs(scales / self._scales - 1.0) < 0.01).all())
            self._scales = scales
            sigmas = np.sqrt(np.diag(_last_block(factor)))
            if is_still and (np.abs(step[-_COUNT:]) < 1e-4 * sigmas).all():
                break
        return found

    def calibration(self, found: FloatArray, drive: DifferentialDrive) -> Calibration:
        """The result at the parameters found (9,)."""
        J, W, _ = self._linearised(found)
        covariance = _last_block(_factored(J, W))[:6, :6]
        names = zip(PARAMETERS, np.diag(covariance), self._config.max_sigmas, strict=True)
        not_observable = tuple(name for name, variance, limit in names if variance > limit**2)
        units = np.array([*drive.wheel_radius_m, drive.track_m, 1.0, 1.0, 1.0])
        left, right, track = (found[:3] * units[:3]).tolist()
        return Calibration(
            T_base_laser=SE2.from_array(found[3:6]),
            drive=DifferentialDrive((left, right), track, drive.ticks_per_turn),
            covariance=covariance * np.outer(units, units),
            chi2_match=float(self._spread[0]),
            chi2_wheels=float(self._spread[1]),
            side_slip_s=float(found[6]),
            lag_s=float(found[7]),
            creep_m=float(found[8]),
            matched=len(self._at),
            not_observable=not_observable,
        )

    def _fill_gaps(self, found: FloatArray) -> None:
        """Where no scan matched, the wheels lead on from the last that did."""
        is_matched = set(self._at.tolist())
        for i, twist in enumerate(self._wheels.twists(found), start=1):
            if i not in is_matched:
                self._poses[i] = self._poses[i - 1] @ SE2.exp(twist)

    def _linearised(self, found: FloatArray) -> tuple[csc_array, csc_array, FloatArray]:
        """Jacobian, weights and residuals: of the wheels, of the matches, of the priors."""
        poses, at = self._poses, self._at
        T_base_laser = SE2.from_array(found[3:6])
        ways = [a.inverse() @ b for a, b in pairwise(poses)]
        twists = self._wheels.twists(found)
        r_wheels = [(SE2.exp(-t) @ way).log() for t, way in zip(twists, ways, strict=True)]
        # the pose that was matched is of the base where the laser's assumed mounting puts it
        T_base_seen = T_base_laser @ self._T_matched.inverse()
        r_match = [
            (seen.inverse() @ poses[i] @ T_base_seen).log()
            for i, seen in zip(at, self._seen, strict=True)
        ]
        r_prior = found - self._assumed
        count, last = len(poses), 3 * len(poses)
        n, m = 3 * (count - 1), 3 * (count - 1) + 3 * len(at)
        back = -np.array([way.inverse().adjoint() for way in ways])
        ahead = np.broadcast_to(np.eye(3), back.shape)
        turn = np.eye(3)
        turn[:2, :2] = T_base_laser.matrix()[:2, :2].T
        of_mount = np.zeros((3, _COUNT))
        of_mount[:, 3:6] = self._T_matched.adjoint() @ turn
        of_pose = T_base_seen.inverse().adjoint()
        steps, seen = 3 * np.arange(count - 1), n + 3 * np.arange(len(at))
        J = _assembled(
            (m + _COUNT, last + _COUNT),
            (steps, steps, back),
            (steps, steps + 3, ahead),
            (steps, np.full(count - 1, last), -self._wheels.slopes(found)),
            (seen, 3 * at, np.broadcast_to(of_pose, (len(at), 3, 3))),
            (seen, np.full(len(at), last), np.broadcast_to(of_mount, (len(at), 3, _COUNT))),
            (np.array([m]), np.array([last]), np.eye(_COUNT)[np.newaxis]),
        )
        r_matched = np.array(r_match)
        far = np.einsum("ni,nij,nj->n", r_matched, self._information / self._scales[0], r_matched)
        huber = np.minimum(1.0, self._config.max_match_sigmas / np.sqrt(np.maximum(far, 1e-12)))
        weights = [
            *(self._stiffness / self._scales[1]),
            *(self._information / self._scales[0] * huber[:, np.newaxis, np.newaxis]),
            diags_array(np.array(self._config.prior_sigmas) ** -2.0),
        ]
        r = np.concatenate([np.ravel(r_wheels), r_matched.ravel(), r_prior])
        return J, csc_array(block_diag(weights, format="csc")), r

    def _spreads(self, J: csc_array, W: csc_array, r: FloatArray, factor: SuperLU) -> FloatArray:
        """(2,) variance of the matches' and of the wheels' residuals over the promised one.

        Foerstner's estimate of variance components (1979); traces by Hutchinson's probes.
        """
        n = 3 * len(self._stiffness)
        kinds = (slice(n, n + 3 * len(self._at)), slice(0, n))
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (J.shape[1], _PROBES))
        solved = factor.solve(signs)
        scales = []
        for kind, scale in zip(kinds, self._scales, strict=True):
            Jk, Wk, rk = J[kind], W[kind, kind], r[kind]
            # how many of the residuals the unknowns take up
            taken = float(np.mean(np.sum(signs * (Jk.T @ (Wk @ (Jk @ solved))), axis=0)))
            left = max(len(rk) - taken, 1.0)
            scales.append(scale * float(rk @ (Wk @ rk)) / left)
        return np.array(scales)


def _assembled(
    shape: tuple[int, int], *groups: tuple[NDArray[np.int_], NDArray[np.int_], FloatArray]
) -> csc_array:
    """A sparse matrix of groups of blocks: first row (B,), first column (B,), (B, h, w)."""
    values, rows, columns = [], [], []
    for row, column, blocks in groups:
        _, height, width = blocks.shape
        at_row = row[:, np.newaxis, np.newaxis] + np.arange(height)[:, np.newaxis]
        at_column = column[:, np.newaxis, np.newaxis] + np.arange(width)
        values.append(blocks.ravel())
        rows.append(np.broadcast_to(at_row, blocks.shape).ravel())
        columns.append(np.broadcast_to(at_column, blocks.shape).ravel())
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return csc_array(coo_array(entries, shape=shape))


def _factored(J: csc_array, W: csc_array) -> SuperLU:
    return splu((J.T @ W @ J).tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})


def _last_block(factor: SuperLU) -> FloatArray:
    """(9, 9) covariance of the parameters, whatever the poses."""
    unit = np.zeros((factor.shape[0], _COUNT))
    unit[-_COUNT:] = np.eye(_COUNT)
    return np.asarray(factor.solve(unit)[-_COUNT:])

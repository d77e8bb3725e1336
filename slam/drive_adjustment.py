"""All poses of a drive, the laser's mounting and the wheels, adjusted together by least squares.

Unknowns as in Censi, Franchi, Marchionni and Oriolo (IEEE T-RO 29(2), 2013), with three more that
are of no interest in themselves: side slip, lag and creep.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, coo_array, csc_array, diags_array
from scipy.sparse.linalg import SuperLU, splu

from slam.arrays import FloatArray
from slam.measurements import Measurement
from slam.odometry import DifferentialDrive
from slam.scan_match import ScanMatch
from slam.se2 import SE2

PARAMETERS = ("radius_left_m", "radius_right_m", "track_m", "x_m", "y_m", "theta_rad")
"""What is found, in the order of `Calibration.covariance`; radii and track here as shares."""
PARAMETER_COUNT = len(PARAMETERS) + 3
LEAST_SCANS = 10
_PROBES = 30
"""Chosen: the traces of some thousand residuals come out to a percent."""


@dataclass(frozen=True, eq=False)
class WheelRecord:
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
    def of(measurements: Sequence[Measurement], drive: DifferentialDrive) -> WheelRecord:
        """The record of a drive. Raises ValueError for fewer than 10 scans, stamps that do not go on,
        or motions without covariance."""
        if len(measurements) < LEAST_SCANS:
            raise ValueError(
                f"a calibration needs {LEAST_SCANS} scans or more, not {len(measurements)}"
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
        return WheelRecord(
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
        slopes = np.zeros((*twists.shape, PARAMETER_COUNT))
        for i in range(PARAMETER_COUNT):
            moved = found.copy()
            moved[i] += step
            slopes[:, :, i] = (self.twists(moved) - twists) / step
        # right Jacobian of exp: 1 - ad / 2 + ad^2 / 6, for steps of a tenth of a radian
        ad = np.zeros((len(twists), 3, 3))
        ad[:, 0, 1], ad[:, 0, 2] = -twists[:, 2], twists[:, 1]
        ad[:, 1, 0], ad[:, 1, 2] = twists[:, 2], -twists[:, 0]
        return np.asarray((np.eye(3) - ad / 2.0 + ad @ ad / 6.0) @ slopes)


class DriveAdjustment:
    """All poses of a drive and the parameters, least squares: unknowns (3 N + 9,), poses first.

    spread: (2,) variance of the matches' and of the wheels' residuals over the promised one.
    """

    def __init__(
        self,
        wheels: WheelRecord,
        matches: Sequence[ScanMatch],
        T_matched: SE2,
        assumed: FloatArray,
        prior_sigmas: tuple[float, ...],
        max_match_sigmas: float,
    ) -> None:
        """T_matched: T_base_laser with which the scans were matched. The rest: `CalibrationConfig`."""
        self._wheels, self._T_matched = wheels, T_matched
        self._prior_sigmas, self._max_match_sigmas = prior_sigmas, max_match_sigmas
        self._assumed = assumed
        self._at = np.flatnonzero([match.is_matched for match in matches])
        matched = [match for match in matches if match.is_matched]
        self._seen = [match.T_map_base for match in matched]
        self._information = np.array([match.information for match in matched])
        self._stiffness = np.linalg.inv(wheels.covariances)
        self._poses = [match.T_map_base for match in matches]
        self._scales = np.ones(2)
        """By how much matches and wheels scatter wider than promised, at least 1 (variances)."""
        self.spread = np.ones(2)

    @property
    def matched(self) -> int:
        """How many scans take part."""
        return len(self._at)

    def solve(self, found: FloatArray, max_steps: int) -> FloatArray:
        """The parameters (9,) by Gauss-Newton; the poses end in `self._poses`."""
        self._fill_gaps(found)
        for _ in range(max_steps):
            J, W, r = self._linearised(found)
            factor = _factored(J, W)
            step = -factor.solve(J.T @ (W @ r))
            self._poses = [
                T @ SE2.exp(twist)
                for T, twist in zip(
                    self._poses, step[:-PARAMETER_COUNT].reshape(-1, 3), strict=True
                )
            ]
            found = found + step[-PARAMETER_COUNT:]
            self.spread = self._spreads(J, W, r + J @ step, factor)
            scales = np.maximum(self.spread, 1.0)
            is_still = bool((np.abs(scales / self._scales - 1.0) < 0.01).all())
            self._scales = scales
            sigmas = np.sqrt(np.diag(_last_block(factor)))
            if is_still and (np.abs(step[-PARAMETER_COUNT:]) < 1e-4 * sigmas).all():
                break
        return found

    def covariance(self, found: FloatArray) -> FloatArray:
        """(9, 9) of the parameters found (9,), whatever the poses."""
        J, W, _ = self._linearised(found)
        return _last_block(_factored(J, W))

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
        of_mount = np.zeros((3, PARAMETER_COUNT))
        of_mount[:, 3:6] = self._T_matched.adjoint() @ turn
        of_pose = T_base_seen.inverse().adjoint()
        steps, seen = 3 * np.arange(count - 1), n + 3 * np.arange(len(at))
        J = _assembled(
            (m + PARAMETER_COUNT, last + PARAMETER_COUNT),
            (steps, steps, back),
            (steps, steps + 3, ahead),
            (steps, np.full(count - 1, last), -self._wheels.slopes(found)),
            (seen, 3 * at, np.broadcast_to(of_pose, (len(at), 3, 3))),
            (
                seen,
                np.full(len(at), last),
                np.broadcast_to(of_mount, (len(at), 3, PARAMETER_COUNT)),
            ),
            (np.array([m]), np.array([last]), np.eye(PARAMETER_COUNT)[np.newaxis]),
        )
        r_matched = np.array(r_match)
        far = np.einsum("ni,nij,nj->n", r_matched, self._information / self._scales[0], r_matched)
        huber = np.minimum(1.0, self._max_match_sigmas / np.sqrt(np.maximum(far, 1e-12)))
        weights = [
            *(self._stiffness / self._scales[1]),
            *(self._information / self._scales[0] * huber[:, np.newaxis, np.newaxis]),
            diags_array(np.array(self._prior_sigmas) ** -2.0),
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
    unit = np.zeros((factor.shape[0], PARAMETER_COUNT))
    unit[-PARAMETER_COUNT:] = np.eye(PARAMETER_COUNT)
    return np.asarray(factor.solve(unit)[-PARAMETER_COUNT:])

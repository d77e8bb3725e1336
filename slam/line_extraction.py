"""Straight lines taken from one ordered scan: split at corners, keep what is straight."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray
from slam.beams import Beams

# Chords that leave a circle of radius R by s turn by sqrt(8 s / R): 23 degrees for 4 cm on 2 m.
# Below 5 degrees it may be one straight wall, split at an outlier.
_BLUNT_RAD = math.radians(5.0), math.radians(35.0)


@dataclass(frozen=True)
class LineExtractionConfig:
    """What counts as a straight line.

    Noise of a range: the larger of range_sigma_m and range_sigma_ratio of it (URG-04LX data sheet).
    split_sigmas: a piece is split where a point leaves its chord by more; four is exceeded by
    noise alone once in 16 000 points. bow_sigmas: a piece is curved when the second-order term of
    its shape is more significant than this. The other values are chosen for rooms.
    """

    range_sigma_m: float = 0.01
    range_sigma_ratio: float = 0.01
    max_gap_m: float = 0.3
    split_sigmas: float = 4.0
    bow_sigmas: float = 4.0
    min_length_m: float = 0.5
    min_points: int = 12


@dataclass(frozen=True)
class ScanLine:
    """A straight piece of a scan in the base frame.

    centre: (x, y) [m], weighted mean of its points. direction_rad: of the line, in (-pi/2, pi/2].
    sigma_direction_rad, sigma_offset_m: standard deviations of the direction and of the centre
    across the line.
    """

    centre: tuple[float, float]
    direction_rad: float
    length_m: float
    sigma_direction_rad: float
    sigma_offset_m: float
    point_count: int


@dataclass(frozen=True)
class _Fit:
    """A line fitted to a piece; roughness: mean squared residual in units of the noise."""

    line: ScanLine
    roughness: float
    is_bowed: bool

    def is_line(self, config: LineExtractionConfig) -> bool:
        """True when the piece is long, dense, smooth and straight enough."""
        return (
            self.line.length_m >= config.min_length_m
            and self.line.point_count >= config.min_points
            and self.roughness <= config.split_sigmas
            and not self.is_bowed
        )


def extract_lines(beams: Beams, config: LineExtractionConfig) -> tuple[ScanLine, ...]:
    """The straight lines of a scan, base frame, in the order of the beams.

    A round wall gives none: its pieces are bowed, and those too short to tell are not kept.
    """
    points_base, ranges_m = beams.points, beams.ranges_m[beams.is_hit]
    sigmas_m = np.maximum(config.range_sigma_m, config.range_sigma_ratio * ranges_m)
    lines: list[ScanLine] = []
    for run in _unbroken_runs(points_base, config.max_gap_m):
        split = _split(points_base, sigmas_m, run, config)
        # one spot told many times (some drivers write 0 for "invalid") has no direction
        pieces = [piece for piece in split if np.ptp(points_base[piece], axis=0).any()]
        fits = [_fit(points_base[piece], sigmas_m[piece], config) for piece in pieces]
        lines += [
            fit.line
            for i, fit in enumerate(fits)
            if fit.is_line(config) and not _continues_a_curve(i, fits, pieces)
        ]
    return tuple(lines)


def _continues_a_curve(i: int, fits: list[_Fit], pieces: list[slice]) -> bool:
    """True when the piece runs, without a gap, into a bowed one or into one it meets bluntly.

    What is left over at the end of a round wall may be too short to show its own bow, and a round
    wall split where it leaves its chord is a polygon: the corners of rooms are sharper.
    """
    for j in (i - 1, i + 1):
        if not 0 <= j < len(fits) or pieces[min(i, j)].stop <= pieces[max(i, j)].start:
            continue
        turn_rad = abs(fold_direction(fits[i].line.direction_rad - fits[j].line.direction_rad))
        if fits[j].is_bowed or _BLUNT_RAD[0] < turn_rad < _BLUNT_RAD[1]:
            return True
    return False


def _unbroken_runs(points: FloatArray, max_gap_m: float) -> list[slice]:
    """The scan cut where two neighbouring hits are farther apart than max_gap_m."""
    if len(points) == 0:
        return []
    gaps_m = np.hypot(*np.diff(points, axis=0).T)
    cuts = [0, *(np.flatnonzero(gaps_m > max_gap_m) + 1).tolist(), len(points)]
    return [slice(start, stop) for start, stop in itertools.pairwise(cuts)]


def _split(
    points: FloatArray, sigmas_m: FloatArray, run: slice, config: LineExtractionConfig
) -> list[slice]:
    """The run cut at its corners, each cut where a piece leaves its chord the most."""
    pieces, open_runs = [], [run]
    while open_runs:
        piece = open_runs.pop()
        if piece.stop - piece.start < config.min_points:
            continue
        deviations = _chord_deviations_m(points[piece]) / sigmas_m[piece]
        corner = int(np.argmax(deviations))
        if deviations[corner] <= config.split_sigmas or corner in (0, len(deviations) - 1):
            pieces.append(piece)
        else:
            corner += piece.start
            open_runs += [slice(corner, piece.stop), slice(piece.start, corner + 1)]
    return pieces


def _chord_deviations_m(points: FloatArray) -> FloatArray:
    """How far each point lies from the line through the mean of the first and of the last three.

    Three and not one, so that the noise of a single end point does not tilt the chord.
    """
    start, end = points[:3].mean(axis=0), points[-3:].mean(axis=0)
    along = end - start
    length_m = math.hypot(*along)
    if length_m == 0.0:
        return np.asarray(np.hypot(*(points - start).T))
    return np.asarray(np.abs((points - start) @ np.array([-along[1], along[0]])) / length_m)


def _fit(points: FloatArray, sigmas_m: FloatArray, config: LineExtractionConfig) -> _Fit:
    """The line through a piece, and what speaks against it."""
    weights = sigmas_m**-2
    centre = np.average(points, axis=0, weights=weights)
    scatter = np.cov(points.T, aweights=weights, ddof=0)
    along = np.linalg.eigh(scatter)[1][:, 1]
    t = (points - centre) @ along
    n = (points - centre) @ np.array([-along[1], along[0]])
    line = ScanLine(
        centre=(float(centre[0]), float(centre[1])),
        direction_rad=fold_direction(math.atan2(along[1], along[0])),
        length_m=float(t.max() - t.min()),
        sigma_direction_rad=float(1.0 / np.sqrt(np.sum(weights * t**2))),
        sigma_offset_m=float(1.0 / np.sqrt(np.sum(weights))),
        point_count=len(points),
    )
    return _Fit(line, float(np.mean((n / sigmas_m) ** 2)), _is_bowed(t, n, sigmas_m, config))


def _is_bowed(
    t: FloatArray, n: FloatArray, sigmas_m: FloatArray, config: LineExtractionConfig
) -> bool:
    """True when n(t) has a second-order term that noise does not explain.

    A polynomial of second order, weighted; sigma from the larger of data sheet and the scatter
    that is really there, so that a rough but straight wall is not called round.
    """
    scale = float(np.abs(t).max())
    terms: NDArray[np.float64] = np.vander(t / scale, 3) / sigmas_m[:, np.newaxis]
    inverse = np.linalg.pinv(terms.T @ terms)
    coefficients = inverse @ terms.T @ (n / sigmas_m)
    residuals = n / sigmas_m - terms @ coefficients
    roughness = float(np.mean(residuals**2))
    sigma = math.sqrt(inverse[0, 0] * roughness)
    return abs(float(coefficients[0])) > config.bow_sigmas * max(sigma, 1e-9)


def fold_direction(angle_rad: float) -> float:
    """The direction of an undirected line, in (-pi/2, pi/2] [rad]."""
    return math.pi / 2.0 - (math.pi / 2.0 - angle_rad) % math.pi

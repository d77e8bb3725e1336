"""Localisation by straight lines: the laboratory's method before the paper (Section 1).

Lines of the scan are matched with known walls. It needs straight lines in the scan, and walls
that somebody entered: where either is missing it fails, and says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.arrays import FloatArray, frozen_array
from slam.beams import Beams
from slam.line_extraction import LineExtractionConfig, ScanLine, extract_lines
from slam.scan_match import IcpStep, MatchStatus, ScanMatch
from slam.se2 import SE2

# Two segments belong to one wall when the shorter lies within these of the longer one's line.
_MERGE_ANGLE_RAD = math.radians(1.0)  # chosen: below the 1.9 degrees between 10 cm facets at 3 m
_MERGE_OFFSET_M = 0.02
_MERGE_GAP_M = 0.05


class LineMap:
    """Known straight walls: `segments` (S, 2, 2) [m], map frame, collinear neighbours merged.

    Walls shorter than min_length_m are left out. Raises ValueError if segments are not (S, 2, 2).
    """

    def __init__(self, segments: ArrayLike, min_length_m: float = 0.5) -> None:
        given = frozen_array(segments, (None, 2, 2), "segments")
        merged = _merged(given)
        long_enough = _lengths_m(merged) >= min_length_m
        self.segments = frozen_array(merged[long_enough], (None, 2, 2), "segments")
        along = self.segments[:, 1] - self.segments[:, 0]
        self.lengths_m = _lengths_m(self.segments)
        self.directions = along / self.lengths_m[:, np.newaxis]
        self.normals = np.column_stack([-self.directions[:, 1], self.directions[:, 0]])

    def __len__(self) -> int:
        return len(self.segments)


@dataclass(frozen=True)
class LineConfig:
    """What `match_lines` needs to know. All values chosen for rooms.

    The first rounds take walls within the wide gates around the odometry pose, as far as the
    odometry may be wrong; the verdict is about what lies within the narrow gates at the end.
    min_overlap: share of a scan line that must lie beside the wall. min_conditioning: least ratio
    of the eigenvalues of the normal matrix; 0.02 asks for two walls that differ by 8 degrees.
    min_explained: least share of the points on the scan's lines whose lines find a wall; right poses
    among furniture have 0.52 at the least of 55 scans (room_fig4).
    """

    extraction: LineExtractionConfig = field(default_factory=LineExtractionConfig)
    max_iterations: int = 30
    wide_gate_m: float = 0.5
    wide_gate_rad: float = math.radians(15.0)
    narrow_gate_m: float = 0.1
    narrow_gate_rad: float = math.radians(3.0)
    min_overlap: float = 0.7
    min_conditioning: float = 0.02
    min_explained: float = 0.5
    translation_tolerance_m: float = 1e-5
    rotation_tolerance_rad: float = 1e-5


@dataclass(frozen=True, eq=False)
class _LinePairs:
    """Scan lines, and the wall that each is taken to lie on: wall_ids (P,)."""

    lines: tuple[ScanLine, ...]
    wall_ids: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.lines)


def match_lines(beams: Beams, line_map: LineMap, T_map_base: SE2, config: LineConfig) -> ScanMatch:
    """Pose at which the scan's straight lines lie on known walls, started at the odometry pose.

    LOST when fewer than two lines that differ in direction find their walls, or too many find
    none. error_m2 is the mean squared distance of the lines' centres from their walls, pair_count
    the number of lines.
    """
    lines = extract_lines(beams, config.extraction)
    history: list[IcpStep] = []
    narrow_gates = config.narrow_gate_m, config.narrow_gate_rad
    gates = config.wide_gate_m, config.wide_gate_rad
    for _ in range(config.max_iterations):
        pairs = _related(lines, line_map, T_map_base, gates, config)
        history.append(_step(T_map_base, line_map, pairs))
        if not _fixes_the_pose(line_map, pairs, config):
            return ScanMatch.lost(history)
        T_corrected = _corrected(T_map_base, line_map, pairs)
        tolerances = config.translation_tolerance_m, config.rotation_tolerance_rad
        if T_map_base.is_near(T_corrected, *tolerances):
            if gates == narrow_gates:
                if _explained(lines, pairs) < config.min_explained:
                    return ScanMatch.lost(history)
                return ScanMatch.from_history(history, MatchStatus.MATCHED)
            gates = narrow_gates
        T_map_base = T_corrected
    return ScanMatch.from_history(history, MatchStatus.NOT_CONVERGED)


def _related(
    lines: tuple[ScanLine, ...],
    line_map: LineMap,
    T_map_base: SE2,
    gates: tuple[float, float],
    config: LineConfig,
) -> _LinePairs:
    """Each scan line with the wall nearest to it, among those within the gates."""
    related: list[tuple[ScanLine, int]] = []
    for line in lines if len(line_map) else ():
        angles_rad = _angles_left_rad(T_map_base, line_map.directions, line)
        from_start = T_map_base @ np.array([line.centre]) - line_map.segments[:, 0]
        offsets_m = np.abs(np.sum(from_start * line_map.normals, axis=1))
        along_m = np.sum(from_start * line_map.directions, axis=1)
        half_m = line.length_m / 2.0
        overlap_m = np.minimum(along_m + half_m, line_map.lengths_m)
        overlap_m = overlap_m - np.maximum(along_m - half_m, 0.0)
        fits = (offsets_m <= gates[0]) & (np.abs(angles_rad) <= gates[1])
        fits &= overlap_m >= config.min_overlap * line.length_m
        if fits.any():
            related.append((line, int(np.argmin(np.where(fits, offsets_m, np.inf)))))
    wall_ids = np.array([wall for _, wall in related], dtype=np.intp)
    return _LinePairs(tuple(line for line, _ in related), wall_ids)


def _angles_left_rad(T_map_base: SE2, directions: FloatArray, line: ScanLine) -> FloatArray:
    """How far the line must turn to lie along each wall's direction (W, 2), within half a turn."""
    walls_rad = np.arctan2(directions[:, 1], directions[:, 0])
    left_rad = walls_rad - T_map_base.theta - line.direction_rad
    return np.asarray(math.pi / 2.0 - np.mod(math.pi / 2.0 - left_rad, math.pi))


def _offsets_left_m(T_map_base: SE2, line_map: LineMap, pairs: _LinePairs) -> FloatArray:
    """How far each line's centre must move along its wall's normal to lie on the wall, (P,)."""
    centres = T_map_base @ np.array([line.centre for line in pairs.lines]).reshape(-1, 2)
    to_wall = line_map.segments[pairs.wall_ids, 0] - centres
    return np.asarray(np.sum(to_wall * line_map.normals[pairs.wall_ids], axis=1))


def _step(T_map_base: SE2, line_map: LineMap, pairs: _LinePairs) -> IcpStep:
    if len(pairs) == 0:
        return IcpStep(T_map_base, math.inf, 0)
    offsets_m = _offsets_left_m(T_map_base, line_map, pairs)
    return IcpStep(T_map_base, float(np.mean(offsets_m**2)), len(pairs))


def _offset_weights(pairs: _LinePairs) -> FloatArray:
    return np.array([line.sigma_offset_m**-2 for line in pairs.lines])


def _fixes_the_pose(line_map: LineMap, pairs: _LinePairs, config: LineConfig) -> bool:
    """True when the walls' normals span the plane: parallel walls leave a direction open."""
    if len(pairs) < 2:
        return False
    normals = line_map.normals[pairs.wall_ids]
    eigenvalues = np.linalg.eigvalsh(normals.T @ (normals * _offset_weights(pairs)[:, np.newaxis]))
    return bool(eigenvalues[0] > config.min_conditioning * eigenvalues[1])


def _explained(lines: tuple[ScanLine, ...], pairs: _LinePairs) -> float:
    """Share of the points on the scan's lines that are on lines with a wall."""
    found = sum(line.point_count for line in pairs.lines)
    return found / sum(line.point_count for line in lines)


def _corrected(T_map_base: SE2, line_map: LineMap, pairs: _LinePairs) -> SE2:
    """First the heading from the angles left, then the position from the offsets then left."""
    angles_rad = np.array(
        [
            _angles_left_rad(T_map_base, line_map.directions[[wall]], line)[0]
            for line, wall in zip(pairs.lines, pairs.wall_ids, strict=True)
        ]
    )
    weights = np.array([line.sigma_direction_rad**-2 for line in pairs.lines])
    turn_rad = float(np.average(angles_rad, weights=weights))
    turned = SE2(T_map_base.x, T_map_base.y, T_map_base.theta + turn_rad)
    normals = line_map.normals[pairs.wall_ids]
    weighted = normals * _offset_weights(pairs)[:, np.newaxis]
    offsets_m = _offsets_left_m(turned, line_map, pairs)
    shift = np.linalg.solve(normals.T @ weighted, weighted.T @ offsets_m)
    return SE2(turned.x + shift[0], turned.y + shift[1], turned.theta)


def _merged(segments: FloatArray) -> FloatArray:
    """The segments with collinear neighbours joined, longest first; every one in the direction of
    the longest of its parts."""
    left = segments[_lengths_m(segments) > 0.0]
    left = left[np.argsort(-_lengths_m(left), kind="stable")]
    walls = []
    while len(left):
        wall, left = left[0], left[1:]
        while (parts := _continuations(wall, left)).any():
            wall, left = _joined(wall, left[parts]), left[~parts]
        walls.append(wall)
    return np.array(walls).reshape(-1, 2, 2)


def _continuations(wall: FloatArray, others: FloatArray) -> NDArray[np.bool_]:
    """(S,) True for the segments (S, 2, 2) on the line of the wall that overlap or touch it."""
    along_m, across_m, length_m = _in_frame_of(wall, others)
    angles_rad = np.arctan2(np.abs(np.diff(across_m)[:, 0]), np.abs(np.diff(along_m)[:, 0]))
    on_line = (np.abs(across_m).max(axis=1) <= _MERGE_OFFSET_M) & (angles_rad <= _MERGE_ANGLE_RAD)
    begins_before_end = along_m.min(axis=1) <= length_m + _MERGE_GAP_M
    return np.asarray(on_line & begins_before_end & (along_m.max(axis=1) >= -_MERGE_GAP_M))


def _joined(wall: FloatArray, parts: FloatArray) -> FloatArray:
    """The wall made as long as it and its parts (S, 2, 2) reach together."""
    along_m, _, length_m = _in_frame_of(wall, parts)
    direction = (wall[1] - wall[0]) / length_m
    ends_m = min(0.0, along_m.min()), max(length_m, along_m.max())
    return np.asarray([wall[0] + end_m * direction for end_m in ends_m])


def _in_frame_of(wall: FloatArray, others: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """End points (S, 2) along and across the wall, seen from its start, and its length [m]."""
    length_m = float(_lengths_m(wall[np.newaxis])[0])
    direction = (wall[1] - wall[0]) / length_m
    relative = others - wall[0]
    return relative @ direction, relative @ np.array([-direction[1], direction[0]]), length_m


def _lengths_m(segments: FloatArray) -> FloatArray:
    return np.asarray(np.hypot(*(segments[:, 1] - segments[:, 0]).T))

"""Slow, obvious versions of what the kernels do fast, for the tests to compare them with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam.beams import Beams
from slam.evidence import Evidence, EvidenceConfig
from slam.laser_model import LaserModel
from slam.likelihood_grid import Candidate, LikelihoodGrid, spread
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap

FloatArray = NDArray[np.float64]


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def cast_all(
    segments: FloatArray, beams: Beams, T_map_base: SE2, range_max_m: float = np.inf
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Ranges (N,) and walls (N,) by trying all beams with all walls (S, 2, 2) from their left."""
    starts = T_map_base.inverse() @ segments[:, 0]
    along = T_map_base.inverse() @ segments[:, 1] - starts
    # origin + direction * range = start + along * share, by Cramer's rule
    to_start = starts[np.newaxis] - beams.origins_m[:, np.newaxis]
    determinant = cross(beams.directions[:, np.newaxis], along[np.newaxis])
    with np.errstate(divide="ignore", invalid="ignore"):
        ranges = cross(to_start, along[np.newaxis]) / determinant
        share = cross(to_start, beams.directions[:, np.newaxis]) / determinant
    is_hit = (determinant > 0.0) & (ranges > 0.0) & (share >= 0.0) & (share <= 1.0)
    ranges = np.where(is_hit & (ranges <= range_max_m), ranges, np.inf)
    nearest = ranges.argmin(axis=1)
    best = ranges[np.arange(len(beams)), nearest]
    return best, np.where(np.isfinite(best), nearest, -1)


def gradients(
    segment_map: SegmentMap, beams: Beams, T_map_base: SE2, step: float = 1e-6
) -> FloatArray:
    """(N, 3) change of each range by a motion (x, y, theta) of the base in its own frame."""
    columns = []
    for axis in np.eye(3):
        there, _ = segment_map.ranges(beams, T_map_base @ SE2.exp(step * axis))
        back, _ = segment_map.ranges(beams, T_map_base @ SE2.exp(-step * axis))
        with np.errstate(invalid="ignore"):
            columns.append((there - back) / (2.0 * step))
    return np.column_stack(columns)


def exhaustive_search(grid: LikelihoodGrid, points_base: FloatArray) -> list[Candidate]:
    """`LikelihoodGrid.search` by a try of every open cell with every heading."""
    config = grid.config
    points = spread(points_base, config.cell_m, config.max_points, grid.reach_m)
    if len(points) == 0:
        return []
    level = grid.levels[0].reshape(-1, grid.columns).astype(int)
    headings = grid.headings(points)
    rows, columns = grid.is_open.shape[1:]
    scores = np.zeros((rows, columns, len(headings)), dtype=int)
    for h, heading in enumerate(headings):
        c, s = np.cos(heading), np.sin(heading)
        for x, y in points:
            column = grid.pad + int(np.rint((c * x - s * y) / config.cell_m))
            row = grid.pad + int(np.rint((s * x + c * y) / config.cell_m))
            scores[:, :, h] += level[row : row + rows, column : column + columns]
    scores[~grid.is_open[0]] = -1
    # (row, column, heading) in blocks; headings that there are not fill the last group
    side = 2**config.top_level
    group = max(1, round(config.block_headings_rad * len(headings) / (2.0 * np.pi)))
    groups = -(-len(headings) // group)
    filled = np.full((rows, columns, groups * group), -1)
    filled[:, :, : len(headings)] = scores
    found = []
    for row in range(0, rows, side):
        for column in range(0, columns, side):
            for first in range(0, groups * group, group):
                block = filled[row : row + side, column : column + side, first : first + group]
                # argmax: of equals the first by row, column, heading
                r, c, h = np.unravel_index(block.argmax(), block.shape)
                x, y = grid.origin_m + (np.array([column + c, row + r]) + 0.5) * config.cell_m
                found.append((int(block.max()), x, y, first + h))
    most = max(score for score, *_ in found)
    kept = [one for one in found if one[0] >= max(1.0, config.keep * most)]
    kept.sort(key=lambda one: -one[0])  # stable: equals stay in the order of blocks
    return [
        Candidate(SE2(x, y, headings[h]), score / (255.0 * len(points)))
        for score, x, y, h in kept[: config.max_candidates]
    ]


def evidence_by_beam(
    beams: Beams,
    segment_map: SegmentMap,
    laser: LaserModel,
    T_map_base: SE2,
    config: EvidenceConfig,
) -> Evidence:
    """`evidence_of`, beam by beam, each tried with every wall."""
    hits = [_all_hits(beams, i, segment_map, T_map_base, laser) for i in range(len(beams))]
    first_m = [min((range_m for range_m, _ in of_beam), default=np.inf) for of_beam in hits]
    step = np.ptp(beams.angles_rad) / (len(beams) - 1) if len(beams) > 1 else np.inf
    weight = min(1.0, step / config.beam_rad)
    counts = {"used": 0.0, "fits": 0.0, "passed": 0.0, "short": 0.0, "missed": 0.0}
    log_likelihood = 0.0
    for i, (z, of_beam) in enumerate(zip(beams.ranges_m, hits, strict=True)):
        what, odds = _one_beam(
            i, z, of_beam, first_m, beams, segment_map, laser, T_map_base, config
        )
        if what:
            counts["used"] += weight
            counts[what] += weight
            log_likelihood += weight * min(np.log(odds), 0.0)
    used = counts.pop("used")
    return Evidence(log_likelihood, used, *(count / max(used, 1e-12) for count in counts.values()))


def _all_hits(
    beams: Beams, i: int, segment_map: SegmentMap, T_map_base: SE2, laser: LaserModel
) -> list[tuple[float, int]]:
    """Range and number of each wall along one beam."""
    one = Beams(beams.origins_m[i : i + 1], beams.angles_rad[i : i + 1], beams.ranges_m[i : i + 1])
    reach_m = 1.2 * laser.range_max_m + 1.0
    hits = []
    for wall in range(len(segment_map)):
        ranges_m, _ = cast_all(segment_map.segments[wall : wall + 1], one, T_map_base, reach_m)
        if np.isfinite(ranges_m[0]):
            hits.append((float(ranges_m[0]), wall))
    return hits


def _one_beam(
    i: int,
    z: float,
    hits: list[tuple[float, int]],
    first_m: list[float],
    beams: Beams,
    segment_map: SegmentMap,
    laser: LaserModel,
    T_map_base: SE2,
    config: EvidenceConfig,
) -> tuple[str, float]:
    """What one beam counts as, "" for none, and its odds against one that meets its wall."""
    noise_m = laser.noise.sigma_m

    def off_in_sigmas(range_m: float, wall: int) -> tuple[float, float]:
        """How far behind a wall the beam ends, across it [m], and how many sigmas make that."""
        direction = beams.directions[i : i + 1]
        direction_map = (SE2(0.0, 0.0, T_map_base.theta) @ direction)[0]
        cosine = max(abs(float(segment_map.normals[wall] @ direction_map)), 0.05)
        sine = np.sqrt(1.0 - cosine**2)
        sigma_m = np.sqrt(
            (noise_m(z) * cosine) ** 2
            + segment_map.sigma_m[wall] ** 2
            + config.blur_m**2
            + (config.blur_rad * range_m * sine) ** 2
        )
        return (z - range_m) * cosine, float(sigma_m)

    if np.isnan(z) or z == -np.inf:
        return "", 1.0
    first = first_m[i]
    if z > laser.range_max_m:
        sigma_m = noise_m(min(first, laser.range_max_m))
        is_due = laser.range_min_m < first < laser.range_max_m - 3.0 * sigma_m
        return ("missed", config.silent_odds) if is_due else ("", 1.0)
    has_passed = False
    if hits and z > first:
        behind_m, sigma_m = off_in_sigmas(*min(hits))
        has_passed = behind_m > config.thickness_m + 4.0 * sigma_m
    fit, does_fit = 0.0, False
    if hits:
        target = first if segment_map.is_exact else z
        off_m, sigma_m = off_in_sigmas(*min(hits, key=lambda hit: abs(hit[0] - target)))
        does_fit = abs(off_m) <= 4.0 * sigma_m
        fit = np.exp(-0.5 * (off_m / sigma_m) ** 2)
    other = config.behind_odds if has_passed and not does_fit else config.elsewhere_odds
    if not does_fit:
        # its light shared with a neighbour's wall, at least 2 cm nearer or farther
        margin_m = 4.0 * (noise_m(z) + config.blur_m)
        sides = [first_m[j] for j in (i - 1, i + 1) if 0 <= j < len(first_m)]
        jumps_m = [
            abs(side - first)
            for side in sides
            if np.isfinite(side)
            and abs(side - first) > 0.02
            and min(side, first) - margin_m < z < max(side, first) + margin_m
        ]
        if jumps_m:
            span_m = laser.range_max_m - laser.range_min_m
            mixed_odds = laser.mixed_ratio / (1.0 - laser.mixed_ratio)
            other += mixed_odds * config.elsewhere_odds * span_m / min(jumps_m)
    if has_passed:
        fit *= config.through_odds
    what = "passed" if has_passed else "fits" if does_fit else "short"
    return what, (fit + other) / (1.0 + config.elsewhere_odds)

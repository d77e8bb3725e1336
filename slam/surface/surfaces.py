"""The surfaces of a place: what many scans saw of it, averaged, each side of a wall for itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.beams import Beams
from slam.kernels.visibility import COUNTS, MET, MOST_PASSED, PASSED, SILENT, looks_into
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from slam.surface.surface_cells import Seen, SurfaceCells, SurfacesConfig
from slam.surface.views import View

_MOST_SILENT = 0.25
"""Chosen: of the surfaces that would go by silence alone. Simulated people make it 0.02 to 0.03, two
offices 0.02; a laser 44 % of whose beams return, 0.6."""
_BODY_M = 0.15
"""Chosen: pieces so near belong to one thing, if it is small."""
_FEWEST = 4
"""Beams that a view needs."""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Short straight pieces of surface, (S, 2, 2) [m], map frame, each seen from its left.

    sigma_m: (S,) how rough each is, across it; met, passed: (S,) scans that looked there and ended
    on it, or went through it.
    """

    segments: FloatArray
    sigma_m: FloatArray
    met: IntArray
    passed: IntArray

    def __len__(self) -> int:
        return len(self.segments)

    def points(self, spacing_m: float = 0.02) -> FloatArray:
        """(K, 2) points on the surfaces, at most so far apart [m]."""
        if len(self) == 0:
            return np.zeros((0, 2))
        along = self.segments[:, 1] - self.segments[:, 0]
        counts = np.maximum(np.ceil(np.hypot(*along.T) / spacing_m), 1.0).astype(np.int64)
        piece = np.repeat(np.arange(len(self)), counts)
        number = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)
        share = (number + 0.5) / counts[piece]
        return np.asarray(self.segments[piece, 0] + share[:, np.newaxis] * along[piece])

    def walls(self) -> SegmentMap:
        """The pieces as walls to localise by. Raises ValueError if there is none."""
        if len(self) == 0:
            raise ValueError("no surface was seen: nothing to localise by")
        return SegmentMap(self.segments, self.sigma_m, is_one_sided=True)

    def moved(self, T: SE2) -> Surfaces:
        """The same surfaces in another frame."""
        ends = T @ self.segments.reshape(-1, 2)
        return Surfaces(ends.reshape(-1, 2, 2), self.sigma_m, self.met, self.passed)

    def taken(self, chosen: BoolArray | IntArray) -> Surfaces:
        """Some of them."""
        return Surfaces(
            self.segments[chosen], self.sigma_m[chosen], self.met[chosen], self.passed[chosen]
        )


def surfaces_of(
    scans: Sequence[tuple[SE2, FloatArray, Beams]],
    glances: Sequence[Sequence[View]] = (),
    config: SurfacesConfig | None = None,
) -> Surfaces:
    """The surfaces that scans saw: T_map_base, faced points (N, 3) and beams of each, in the order in
    which they were taken.

    What others looked through, people and doors that stood open later, is left out; glances, for
    each scan those taken between it and the next, are asked for that as well, and some of them for
    what they saw. Somebody who stands
    while the robot drives by is met by each keyframe that looks there, but the scans between two of
    them saw him come or go.
    """
    config = config or SurfacesConfig()
    views, seen = list[View](), list[Seen]()
    for index, (T, faced, beams) in enumerate(scans):
        since = glances[index] if index < len(glances) else ()
        views += [View.of(T, beams), *since]
        some = since[:: math.ceil(len(since) / config.glances) or 1] if config.glances else ()
        count = 1 + len(some)
        seen.append(Seen(T, faced, beams.middle_m, count))
        for one in some:
            faced = one.faced(config.range_max_m)
            seen.append(Seen(one.T_map_base, faced, one.origin_m, count))
    segments, sigma_m, own = SurfaceCells.of(seen, config).pieces(config)
    counts = _looks(segments, views, config)
    met, passed, silent = counts[:, MET], counts[:, PASSED], counts[:, SILENT]
    surfaces = Surfaces(segments, sigma_m, met, passed)
    stays = met >= config.least_looks * (met + passed)
    fewest, share = config.seen_through
    stays &= counts[:, MOST_PASSED] < np.maximum(fewest, share * met)
    is_silent = stays & (met < config.least_returns * (met + passed + silent))
    # a laser that comes back from nowhere everywhere does not tell where nothing is
    if np.count_nonzero(is_silent) <= _MOST_SILENT * np.count_nonzero(stays):
        stays &= ~is_silent
    least, least_share = config.least_points
    is_seen = (own >= least) | (own >= least_share * met)
    return surfaces.taken(stays & is_seen & ~_is_of_what_went(surfaces, stays, is_seen))


def _is_of_what_went(surfaces: Surfaces, stays: BoolArray, is_seen: BoolArray) -> BoolArray:
    """(S,) whether most of the looks that met surfaces around one met such as went: of somebody who
    stood there all can be seen through once he is gone, but not each piece of his legs is looked at
    again. Of what was hardly seen, is_seen (S,), none counts: light mixed behind a leg that stands is
    no reason to let the leg go."""
    count = len(surfaces)
    if count == 0:
        return np.zeros(0, dtype=np.bool_)
    tree = cKDTree(surfaces.segments.mean(axis=1))
    pairs = tree.query_pairs(_BODY_M, output_type="ndarray")
    one, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    met = surfaces.met * is_seen
    left = met * stays
    all_met = met + np.bincount(one, met[other], count)
    return np.asarray(left + np.bincount(one, left[other], count) < 0.5 * all_met)


def _looks(segments: FloatArray, views: Sequence[View], config: SurfacesConfig) -> IntArray:
    """(S, 5) what views, in the order in which they were taken, say of segments (S, 2, 2)."""
    views = [view for view in views if len(view.angles_rad) >= _FEWEST]
    counts = np.zeros((len(segments), COUNTS), dtype=np.int64)
    if len(segments) == 0 or not views:
        return counts
    middles = segments.mean(axis=1)
    along = segments[:, 1] - segments[:, 0]
    normals = np.column_stack([-along[:, 1], along[:, 0]])
    length_m = np.hypot(*normals.T)
    normals /= length_m[:, np.newaxis]
    finite_m = [view.ranges_m[np.isfinite(view.ranges_m)].max(initial=0.0) for view in views]
    hardest = np.column_stack([np.zeros(len(segments)), np.ones(len(segments))])
    # once to see from how far off surfaces return beams, and once to count
    for _ in range(2):
        counts[:] = 0
        for view in views:
            looks_into(
                middles, normals, length_m / 2.0, view.T_map_base.as_array(), view.origin_m, view.angles_rad,
                view.ranges_m, config.beside_m, config.beside_share, config.coarsest_m,
                max(finite_m), hardest, counts,
            )  # fmt: skip
    return counts

"""The surfaces of a place: what many scans saw of it, averaged, each side of a wall for itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.beams import Beams
from slam.kernels.visibility import looks_into
from slam.se2 import SE2
from slam.segment_map import SegmentMap
from slam.surface_cells import SurfaceCells, SurfacesConfig
from slam.views import View

_SURE = 0.9
"""Chosen: of the farthest return of all: beyond, a laser hardly tells that nothing is there."""
_MOST_SILENT = 0.25
"""Chosen: of the surfaces that would go by silence alone. Simulated people make it 0.02 to 0.03, two
offices 0.02; a laser 44 % of whose beams return, 0.6."""
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
    glances: Sequence[View] = (),
    config: SurfacesConfig | None = None,
) -> Surfaces:
    """The surfaces that scans saw: T_map_base, faced points (N, 3) and beams of each.

    What others looked through, people and doors that stood open later, is left out; glances are
    asked for that as well. Somebody who stands while the robot drives by is met by each keyframe
    that looks there, but the scans between two of them saw him come or go.
    """
    config = config or SurfacesConfig()
    segments, sigma_m = SurfaceCells.of(scans, config).pieces(config)
    views = [View.of(T, beams) for T, _, beams in scans]
    met, passed, silent = _looks(segments, [*views, *glances], config)
    surfaces = Surfaces(segments, sigma_m, met, passed)
    stays = met >= config.least_looks * (met + passed)
    is_silent = stays & (met < config.least_returns * (met + passed + silent))
    # a laser that comes back from nowhere everywhere does not tell where nothing is
    if np.count_nonzero(is_silent) <= _MOST_SILENT * np.count_nonzero(stays):
        stays &= ~is_silent
    return surfaces.taken(stays)


def _looks(
    segments: FloatArray, views: Sequence[View], config: SurfacesConfig
) -> tuple[IntArray, IntArray, IntArray]:
    """(S,) how many views met each of segments (S, 2, 2), how many went through it, and how many
    came back from nowhere instead."""
    views = [view for view in views if len(view.angles_rad) >= _FEWEST]
    met, passed, silent = (np.zeros(len(segments), dtype=np.int64) for _ in range(3))
    if len(segments) == 0 or not views:
        return met, passed, silent
    middles = segments.mean(axis=1)
    along = segments[:, 1] - segments[:, 0]
    normals = np.column_stack([-along[:, 1], along[:, 0]])
    normals /= np.hypot(*normals.T)[:, np.newaxis]
    finite_m = [view.ranges_m[np.isfinite(view.ranges_m)].max(initial=0.0) for view in views]
    hardest = np.column_stack([np.zeros(len(segments)), np.ones(len(segments))])
    # once to see from how far off surfaces return beams, and once to count
    for _ in range(2):
        met[:], passed[:], silent[:] = 0, 0, 0
        for view in views:
            looks_into(
                middles, normals, view.T_map_base.as_array(), view.origin_m, view.angles_rad,
                view.ranges_m, config.beside_m, config.beside_share, config.coarsest_m,
                _SURE * max(finite_m), hardest, met, passed, silent,
            )  # fmt: skip
    return met, passed, silent

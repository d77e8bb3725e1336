"""The map of walls: straight segments, exact or as well known as a sigma says."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from slam.arrays import FloatArray, IntArray, frozen_array
from slam.beams import Beams
from slam.kernels.beam_likelihood import normals_into
from slam.kernels.ray_casting import cast_fan, to_base, visible_part
from slam.se2 import SE2
from slam.surface.segments import joined, simplified

_TOLERANCE_M = 1e-4
"""Chosen: a tenth of a millimetre is a fifth of what the best laser here can tell of a room."""
_MARGIN_M, _MARGIN_RAD = 0.1, 0.025
"""Chosen: how far a pose may move before other walls than those `seen_from` it come into view."""


class SegmentMap:
    """Walls as segments (S, 2, 2) [m], map frame; read-only.

    is_one_sided: each wall is seen from its left alone, going from its first to its second end;
    otherwise each is kept in both directions. sigma_m: (S,) standard deviation of where each wall
    is, across it [m]: zeros for a known map.
    Raises ValueError if the segments are not finite (S, 2, 2), or sigma_m does not fit them.
    """

    def __init__(
        self,
        segments: ArrayLike,
        sigma_m: ArrayLike | None = None,
        *,
        is_one_sided: bool = False,
    ) -> None:
        walls = frozen_array(segments, (None, 2, 2), "segments")
        if not np.isfinite(walls).all():
            raise ValueError("segments must be finite")
        sigmas = np.zeros(len(walls)) if sigma_m is None else np.asarray(sigma_m, dtype=np.float64)
        sigmas = frozen_array(sigmas, (len(walls),), "sigma_m")
        has_length = np.any(walls[:, 0] != walls[:, 1], axis=1)
        walls, sigmas = walls[has_length], sigmas[has_length]
        if not is_one_sided:
            walls = np.concatenate([walls, walls[:, ::-1]])
            sigmas = np.concatenate([sigmas, sigmas])
        self.is_one_sided = is_one_sided
        self.sigma_m = frozen_array(sigmas, (None,), "sigma_m")
        self.is_exact = not self.sigma_m.any()
        ends, node_of_end = np.unique(walls.reshape(-1, 2), axis=0, return_inverse=True)
        self.vertices: FloatArray = np.ascontiguousarray(ends)
        self.walls: IntArray = np.ascontiguousarray(node_of_end.reshape(-1, 2).astype(np.int64))
        self.normals: FloatArray = np.empty((len(walls), 2))
        normals_into(self.vertices, self.walls, self.normals)

    @staticmethod
    def known(
        segments: ArrayLike, tolerance_m: float = _TOLERANCE_M, *, is_one_sided: bool = False
    ) -> SegmentMap:
        """The map of surfaces that are exactly known, in as few walls as that tolerance allows."""
        array = frozen_array(segments, (None, 2, 2), "segments")
        if not np.isfinite(array).all():
            raise ValueError("segments must be finite")
        walls = simplified(joined(array), tolerance_m)
        return SegmentMap(walls, is_one_sided=is_one_sided)

    def __len__(self) -> int:
        return len(self.walls)

    @property
    def segments(self) -> FloatArray:
        """(S, 2, 2) both ends of each wall [m]."""
        return self.vertices[self.walls]

    def sampled(self, spacing_m: float) -> tuple[FloatArray, IntArray]:
        """Points (K, 2) along the walls, off their ends, and (K,) whose they are.

        Off the ends, where two walls meet: a point of both would belong to either by chance.
        """
        segments = self.segments
        along = segments[:, 1] - segments[:, 0]
        counts = np.maximum(np.ceil(np.hypot(*along.T) / spacing_m).astype(int), 1)
        owners = np.repeat(np.arange(len(segments)), counts)
        firsts = np.repeat(np.cumsum(counts) - counts, counts)
        share = (np.arange(counts.sum()) - firsts + 0.5) / np.repeat(counts, counts)
        return segments[owners, 0] + share[:, np.newaxis] * along[owners], owners

    def seen_from(self, beams: Beams, T_map_base: SE2, range_max_m: float) -> SegmentMap:
        """The map of those walls alone that the beams meet, or might from a pose near by.

        Near by: see `is_near_by`.
        """
        if len(beams) < 2:
            return self
        step_rad = (beams.angles_rad[-1] - beams.angles_rad[0]) / (len(beams) - 1)
        beside = math.ceil(_MARGIN_RAD / max(step_rad, 1e-6)) + 1
        part = object.__new__(SegmentMap)
        part.is_one_sided, part.is_exact = self.is_one_sided, self.is_exact
        part.vertices, part.walls, part.normals, part.sigma_m = visible_part(
            self.vertices, self.walls, self.normals, self.sigma_m, T_map_base.as_array(),
            beams.origins_m, beams.directions, beams.angles_rad, beams.middle_m, beams.spread_m,
            range_max_m, _MARGIN_M, beside,
        )  # fmt: skip
        # read-only as the whole map's: to numba that is a type, and each kernel would be compiled twice
        part.sigma_m.flags.writeable = False
        return part

    def ranges(
        self,
        beams: Beams,
        T_map_base: SE2,
        range_max_m: float = np.inf,
        targets_m: FloatArray | None = None,
    ) -> tuple[FloatArray, IntArray]:
        """(N,) distance along each beam to a wall [m], and (N,) which; inf and -1: none.

        targets_m: (N,); of all walls along a beam, that which is nearest to it. Else the first.
        """
        vertices, bearings = np.empty_like(self.vertices), np.empty_like(self.vertices)
        ranges_m, walls = np.empty(len(beams)), np.empty(len(beams), dtype=np.int64)
        targets = np.zeros(len(beams)) if targets_m is None else targets_m
        to_base(self.vertices, T_map_base.x, T_map_base.y, T_map_base.theta, vertices)
        cast_fan(
            vertices, self.walls, beams.origins_m, beams.directions, beams.angles_rad,
            beams.middle_m, beams.spread_m, range_max_m, targets, bearings, ranges_m, walls,
        )  # fmt: skip
        return ranges_m, walls


def is_near_by(T_from: SE2, T_to: SE2) -> bool:
    """Whether the walls `seen_from` one pose are those that another may see: four fifths of the
    margins, since neither distance nor turn is what moves the view alone."""
    return T_from.is_near(T_to, 0.8 * _MARGIN_M, 0.8 * _MARGIN_RAD)

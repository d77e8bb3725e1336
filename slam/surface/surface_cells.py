"""A grid of what many scans saw, and the short straight pieces of surface that run through it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.beams import POINTS_WITHIN_M
from slam.kernels.surface_map import SIDES
from slam.se2 import SE2

_ENDS = math.sqrt(3.0)
"""Standard deviations from the middle to the ends of points that are spread evenly."""
_LEAST_COSINE = math.cos(math.radians(50.0))
"""Chosen: of the angle between a piece and the side that its points are on, which are 45 degrees off
at most."""
_SAME_M = 0.03
"""Chosen: two pieces of a cell that lie no farther apart, and face nearly the same way, are one."""
_OVERLAP = 1.1
"""Pieces are this much longer than their cells, so that no beam slips between two."""


@dataclass(frozen=True)
class SurfacesConfig:
    """How `surfaces_of` averages.

    cell_m: side of the cells; a piece is fitted to the points of its cell and of those around it,
    and cut to the cell. near_m: a point measured from so far weighs half of one near by.
    prior_m, prior_points: how rough a piece is before its points say so, and as many points as that
    counts. most_sigma_m: to which a piece must be known, across itself, by its points' roughness and
    number. least_own: share of its weight that lies in the cell itself.
    least_looks: share of the scans that looked at a piece, which must have met it; seen_through: by
    so many in a row, of so many times as many that met it, it was not there then; of the walls of an
    office one in 150. A leg that ends at the height of the beams is: two of 360. least_returns:
    counting those that came back from nowhere, which a chair's leg makes one in eight. least_points:
    of a piece's own, or else as a share of the looks that met it: of what is behind an edge light
    mixed there makes one in a hundred looks; of each scan of a keyframe, where there are several.
    glances: scans between two keyframes of which the points are taken too, at most; range_max_m:
    those within it, as of keyframes. beside_m, beside_share: by which a beam must end elsewhere, and
    as a share of its length. coarsest_m: beams farther apart than this may pass thin things by.
    min_sigma_m: least standard deviation across a piece. Chosen, all of these, on twenty simulated
    drives through two rooms and a corridor.
    """

    cell_m: float = 0.05
    near_m: float = 1.0
    prior_m: float = 0.03
    prior_points: float = 2.0
    most_sigma_m: float = 0.01
    least_own: float = 0.12
    least_looks: float = 0.9
    seen_through: tuple[float, float] = (2.0, 0.01)
    least_returns: float = 0.8
    least_points: tuple[float, float] = (1.5, 0.03)
    glances: int = 4
    range_max_m: float = POINTS_WITHIN_M
    beside_m: float = 0.05
    beside_share: float = 0.02
    coarsest_m: float = 0.05
    min_sigma_m: float = 0.005


class Seen(NamedTuple):
    """A scan's faced points (N, 3), the pose whose frame they are in, and where in it they were seen
    from, (2,) [m]. scans: of its keyframe, itself among them."""

    T_map_base: SE2
    faced: FloatArray
    origin_m: FloatArray
    scans: int


@dataclass(frozen=True, eq=False)
class SurfaceCells:
    """What lies in the cells of a grid, for each of the sides that surfaces face.

    keys: (C,) sorted; at: (C, 3) column, row, side; sums: (C, 8) weight, x, y, xx, xy, yy [m] from
    the middle of all, the weights' squares, and each weight over the scans of its keyframe.
    """

    keys: IntArray
    at: IntArray
    sums: FloatArray
    origin_m: FloatArray

    @staticmethod
    def of(scans: Sequence[Seen], config: SurfacesConfig) -> SurfaceCells:
        """Of the points of scans that face anywhere, scan by scan, each in the two sides nearest to
        where its surface faces."""
        points = np.concatenate(
            [np.zeros((0, 5)), *(_weighed(scan, config) for scan in scans)], dtype=np.float64
        )
        origin_m = points[:, :2].mean(axis=0) if len(points) else np.zeros(2)
        x, y = (points[:, :2] - origin_m).T
        in_cells = _in_cells(x, y, points[:, 2], config.cell_m)
        keys = np.unique(in_cells)
        where = np.searchsorted(keys, in_cells)
        # one after the other: all at once, for both sides, they are three times as much as the points
        terms = _terms(x, y, points[:, 3], points[:, 4])
        sums = [np.bincount(where, np.tile(term, 2), len(keys)) for term in terms]
        columns: FloatArray = np.column_stack(sums)
        return SurfaceCells(keys, _at(keys), columns, origin_m)

    def _beside(self, steps: IntArray) -> IntArray:
        """(C,) the number of the cell that lies steps (C, 3) or (3,) away, -1 where there is none."""
        wanted = _keys(self.at + steps)
        found = np.minimum(np.searchsorted(self.keys, wanted), len(self.keys) - 1)
        return np.where(self.keys[found] == wanted, found, -1)

    def pieces(self, config: SurfacesConfig) -> tuple[FloatArray, FloatArray, FloatArray]:
        """A piece for each cell that a line through its points, and those around, runs through.

        (S, 2, 2) [m], (S,) how rough each is [m], and (S,) how many points lie in the cell itself, all
        of one weight, of each of the scans that a keyframe has there.
        """
        if len(self.keys) == 0:
            return np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0)
        sums = np.zeros(self.sums.shape)
        for column in (-1, 0, 1):
            for row in (-1, 0, 1):
                other = self._beside(np.array([column, row, 0]))
                sums += np.where(other[:, np.newaxis] >= 0, self.sums[other], 0.0)
        weight = sums[:, 0]
        mean = np.asarray(sums[:, 1:3] / weight[:, np.newaxis], dtype=np.float64)
        cxx, cxy, cyy = (
            sums[:, 3] / weight - mean[:, 0] ** 2,
            sums[:, 4] / weight - mean[:, 0] * mean[:, 1],
            sums[:, 5] / weight - mean[:, 1] ** 2,
        )
        half = 0.5 * (cxx + cyy)
        angle = 0.5 * np.arctan2(2.0 * cxy, cxx - cyy)
        along = np.asarray(np.column_stack([np.cos(angle), np.sin(angle)]), dtype=np.float64)
        # seen from the left
        facing = self.at[:, 2] * (2.0 * np.pi / SIDES)
        across = np.column_stack([np.sin(facing), -np.cos(facing)])
        same = np.sum(along * across, axis=1)
        along *= np.where(same < 0.0, -1.0, 1.0)[:, np.newaxis]
        # of a leg, and behind an edge, noise makes a line that runs away from the laser
        is_along_sight = np.abs(same) < _LEAST_COSINE
        along[is_along_sight] = across[is_along_sight]
        x, y = along.T
        wide_m2 = cxx * x * x + 2.0 * cxy * x * y + cyy * y * y
        rough_m = np.sqrt(np.maximum(2.0 * half - wide_m2, 0.0))
        middle = np.asarray((self.at[:, :2] + 0.5) * config.cell_m, dtype=np.float64)
        span_m: FloatArray = _ENDS * np.sqrt(np.maximum(wide_m2, 0.0))
        ends, is_cut = _cut(mean, along, middle, config.cell_m, span_m)
        scans_each = weight / sums[:, 7]
        # scans of one keyframe err together: n of them tell as the root of so many. chosen, on ten
        # drives
        count = weight**2 / sums[:, 6] / np.sqrt(scans_each)
        prior_m2 = config.prior_points * config.prior_m**2
        variance_m2 = (count * rough_m**2 + prior_m2) / (count + config.prior_points) / count
        is_one = (
            is_cut
            & (variance_m2 <= config.most_sigma_m**2)
            & (self.sums[:, 0] > config.least_own * weight)
        )
        is_one &= ~self._is_said_twice(is_one, weight, along, mean)
        sigma_m = np.maximum(rough_m[is_one], config.min_sigma_m)
        own = self.sums[is_one, 0] ** 2 / self.sums[is_one, 6] / scans_each[is_one]
        return ends[is_one] + self.origin_m, sigma_m, own

    def _is_said_twice(
        self, is_one: BoolArray, weight: FloatArray, along: FloatArray, mean: FloatArray
    ) -> BoolArray:
        """(C,) whether the next side to either hand has the same piece, of more weight."""
        twice = np.zeros(len(is_one), dtype=np.bool_)
        for step in (-1, 1):
            other = self._beside(np.array([0, 0, step]))
            turned = np.sum(along * along[other], axis=1) < np.cos(np.pi / 4)
            normal = np.column_stack([-along[:, 1], along[:, 0]])
            off_m = np.abs(np.sum((mean[other] - mean) * normal, axis=1))
            heavier = (weight[other] > weight) | ((weight[other] == weight) & (step > 0))
            twice |= (other >= 0) & is_one[other] & heavier & ~turned & (off_m < _SAME_M)
        return twice


_MIDDLE = 2**24
"""Of columns and rows: so many lie to either side."""


def _keys(at: IntArray) -> IntArray:
    """(C,) one number for each column, row and side (C, 3), the sides counted all around."""
    return np.asarray(_cell_keys(at[:, 0], at[:, 1]) + at[:, 2] % SIDES)


def _cell_keys(column: IntArray, row: IntArray) -> IntArray:
    """(C,) of the first side of each cell (C,), (C,); the others follow."""
    return ((column + _MIDDLE) * 4 * _MIDDLE + row + _MIDDLE) * SIDES


def _at(keys: IntArray) -> IntArray:
    """(C, 3) column, row and side of such numbers (C,)."""
    cells, side = np.divmod(keys, SIDES)
    column, row = np.divmod(cells, 4 * _MIDDLE)
    return np.column_stack([column - _MIDDLE, row - _MIDDLE, side])


def _in_cells(x: FloatArray, y: FloatArray, facing_rad: FloatArray, side_m: float) -> IntArray:
    """(2P,) numbers of the cells that points (P,) lie in: for one, and then for the other, of the two sides
    nearest to where their surfaces face."""
    column, row, side = (
        np.floor(place).astype(np.int64)
        for place in (x / side_m, y / side_m, facing_rad * (SIDES / (2.0 * np.pi)))
    )
    cells = _cell_keys(column, row)
    return np.concatenate([cells + side % SIDES, cells + (side + 1) % SIDES])


def _terms(
    x: FloatArray, y: FloatArray, weights: FloatArray, of_scans: FloatArray
) -> Iterator[FloatArray]:
    """What is summed up of points, (P,) each: see `SurfaceCells`."""
    yield weights
    yield x * weights
    yield y * weights
    yield x * x * weights
    yield x * y * weights
    yield y * y * weights
    yield weights * weights
    yield of_scans * weights


def _cut(
    point: FloatArray, along: FloatArray, middle: FloatArray, side_m: float, span_m: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """(C, 2, 2) the parts of lines within squares, a little longer than that; (C,) if there is one."""
    half = 0.5 * side_m * _OVERLAP
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (middle - half - point) / along, (middle + half - point) / along
    low = np.nanmax(np.minimum(one, other), axis=1)
    high = np.nanmin(np.maximum(one, other), axis=1)
    low, high = np.maximum(low, -span_m), np.minimum(high, span_m)
    is_cut = high > low + 0.2 * half
    low, high = np.where(is_cut, low, 0.0), np.where(is_cut, high, 0.0)
    ends = np.stack([point + low[:, None] * along, point + high[:, None] * along], axis=1)
    return ends, is_cut


def _weighed(scan: Seen, config: SurfacesConfig) -> FloatArray:
    """(N, 5) of faced points, those that face nowhere left out: map frame, the weight, and for how
    much of a keyframe its scan counts."""
    faced, T = scan.faced[np.isfinite(scan.faced[:, 2])], scan.T_map_base
    off_m2 = np.sum((faced[:, :2] - scan.origin_m) ** 2, axis=1)
    weights = 1.0 / (1.0 + off_m2 / config.near_m**2)
    shares = np.full(len(faced), 1.0 / scan.scans)
    return np.column_stack([T @ faced[:, :2], faced[:, 2] + T.theta, weights, shares])

"""The normal equations of a pose graph: their pattern made once, filled and solved many times."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.kernels import block_pattern as layout
from slam.kernels import pose_graph as kernels

_LEAST_WEIGHT, _FORGOTTEN_WEIGHT = 1e-5, 1e-6
"""An edge with less than the first need not be in the system, with less than the second it is left
out when the next is made: a wrong loop across the map makes its factor dense and moves nothing."""
_NEW_BELOW = 0.9
"""Chosen: a system is made anew when so few of its edges still count."""


class Equations:
    """One graph's edges, sorted, and the sparse system of its free nodes, ordered for little fill.

    Sorted, so that sums run in one order whatever the order in which the edges came: arrays of
    edges are in the order of `order` here. The pattern stays as long as the same edges count.
    """

    def __init__(
        self,
        is_fixed: BoolArray,
        ends: IntArray,
        measured: FloatArray,
        information: FloatArray,
        edge_kernels: IntArray,
    ) -> None:
        """is_fixed: (N,); ends: (E, 2); measured: (E, 3); information: (E, 3, 3); kernels: (E,)."""
        self.order = _order(ends, measured, information, edge_kernels)
        self.is_fixed = is_fixed
        self.ends = np.ascontiguousarray(ends[self.order])
        self.measured = np.ascontiguousarray(measured[self.order])
        self.information = np.ascontiguousarray(information[self.order])
        self.edge_kernels = edge_kernels[self.order]
        self.members = np.empty(0, dtype=np.int64)
        """The edges in the last system."""
        self._system: System | None = None

    def unsorted(self, values: FloatArray) -> FloatArray:
        """What belongs to the sorted edges, in the order in which they were given."""
        result = np.empty_like(values)
        result[self.order] = values
        return result

    def chi_squares(self, poses: FloatArray) -> FloatArray:
        """(E,) squared residuals, whitened."""
        chi_squares = np.empty(len(self.ends))
        kernels.chi_squares(poses, self.ends, self.measured, self.information, chi_squares)
        return chi_squares

    def system(self, poses: FloatArray, weights: FloatArray) -> System:
        """The system at the poses (N, 3) with the edges' weights (E,); good until the next one."""
        is_member = np.zeros(len(weights), dtype=np.bool_)
        is_member[self.members] = True
        counts = weights >= _LEAST_WEIGHT
        is_missing = (counts & ~is_member).any()
        is_sparser = counts.sum() < _NEW_BELOW * len(self.members)
        if self._system is None or is_missing or is_sparser:
            self.members = np.flatnonzero(self._needed(weights))
            self._system = System(self.is_fixed, self.ends[self.members])
        at = self.members
        self._system.fill(
            poses, self.ends[at], self.measured[at], self.information[at], weights[at]
        )
        return self._system

    def _needed(self, weights: FloatArray) -> BoolArray:
        is_needed = weights >= _FORGOTTEN_WEIGHT
        # nodes that only the others hold keep them all
        all_held = is_held(self.is_fixed, self.ends[is_needed]).all()
        return is_needed if all_held else np.ones(len(weights), dtype=np.bool_)


class System:
    """J^T W J and J^T W r of some edges, in CSC: the pattern is made once, the values many times."""

    def __init__(self, is_fixed: BoolArray, ends: IntArray) -> None:
        self.unknowns = np.full(len(is_fixed), -1)
        """(N,) place of each node among the unknown ones, -1 of a fixed one."""
        free = np.flatnonzero(~is_fixed)
        count = len(free)
        self.unknowns[free] = np.arange(count)
        self.unknowns[free] = _places(*layout.pattern_of(self.unknowns[ends], count))
        between = self.unknowns[ends]
        indptr, indices = layout.pattern_of(between, count)
        # a node's columns are as high as its blocks
        self._strides = np.where(self.unknowns >= 0, 3 * np.diff(indptr)[self.unknowns], 0)
        self._slots = np.empty((len(ends), 4), dtype=np.int64)
        self._diagonal_entries = np.empty(3 * count, dtype=np.int64)
        # SuperLU takes 32 bit indices only
        self._indptr = np.empty(3 * count + 1, dtype=np.int32)
        self._indices = np.empty(9 * len(indices), dtype=np.int32)
        layout.lay_out(
            between, indptr, indices, self._slots, self._diagonal_entries, self._indptr,
            self._indices,
        )  # fmt: skip
        self._values = np.zeros(9 * len(indices))
        self.pull = np.zeros(3 * count)
        self.parents = kernels.elimination_parents(indptr, indices)

    def fill(
        self,
        poses: FloatArray,
        ends: IntArray,
        measured: FloatArray,
        information: FloatArray,
        weights: FloatArray,
    ) -> None:
        """Sets the values, and `pull` (U,), for the edges of which the pattern was made."""
        kernels.normal_equations(
            poses, ends, measured, information, weights, self._slots, self._strides,
            self.unknowns, self._values, self.pull,
        )  # fmt: skip

    def factored(self, damping: float = 0.0, hold: float = 0.0) -> SuperLU:
        """The factors, the diagonal made larger by the share `damping` and by `hold` of its largest.

        Raises RuntimeError when the system is singular.
        """
        values = self._values
        if damping > 0.0 or hold > 0.0:
            diagonal = self.diagonal
            values = values.copy()
            values[self._diagonal_entries] += damping * diagonal + hold * diagonal.max()
        size = len(self.pull)
        matrix = csc_array((values, self._indices, self._indptr), shape=(size, size))
        return _factored(matrix, "NATURAL")

    def moved(self, poses: FloatArray, step: FloatArray) -> FloatArray:
        """The poses (N, 3), the free ones moved by their twists (U,)."""
        poses = poses.copy()
        kernels.move_all(poses, self.unknowns, step)
        return poses

    @property
    def diagonal(self) -> FloatArray:
        """(U,) diagonal of J^T W J."""
        result: FloatArray = self._values[self._diagonal_entries]
        return result


def is_held(is_fixed: BoolArray, ends: IntArray) -> BoolArray:
    """(N,) nodes that a chain of edges (E, 2) joins to a fixed one."""
    held = np.empty(len(is_fixed), dtype=np.bool_)
    layout.held_into(is_fixed, ends, held)
    return held


_OPEN = "the edges of the pose graph leave a direction open: its covariance has no bounds"


class Covariances:
    """Marginal covariances of a factored system: many queries, one factorisation.

    The factor is L D L^T, so the covariance of two nodes is a product of two columns of L^-1, and
    each of these is empty but for the way from its node to the root of the elimination tree.
    """

    def __init__(self, system: System) -> None:
        """Raises ValueError when the edges leave a direction open."""
        try:
            factor = system.factored()
        except RuntimeError as error:  # all that SuperLU says of a singular matrix
            raise ValueError(_OPEN) from error
        self._unknowns, self._parents = system.unknowns, system.parents
        self._position = factor.perm_c.astype(np.int64)
        lower = factor.L
        self._lower = (lower.indptr.astype(np.int64), lower.indices.astype(np.int64), lower.data)
        self._pivots = factor.U.diagonal()
        before = np.empty_like(self._pivots)
        before[self._position] = system.diagonal
        # what elimination leaves of an open direction is rounding
        if not (self._pivots > 1e-14 * before).all():
            raise ValueError(_OPEN)

    def of_pairs(self, pairs: IntArray) -> FloatArray:
        """(Q, 6, 6) joint covariances of pairs of nodes (Q, 2), in the tangents of their poses."""
        return np.asarray(
            kernels.pair_covariances(
                self._unknowns[pairs], self._parents, self._position, *self._lower, self._pivots
            )
        )

    def of_ways(self, poses: FloatArray, pairs: IntArray) -> FloatArray:
        """(Q, 3, 3) of the ways from the first to the second of each pair, in the end's tangent."""
        return np.asarray(kernels.relative_covariances(poses, pairs, self.of_pairs(pairs)))


def surprises(
    poses: FloatArray,
    ends: IntArray,
    measured: FloatArray,
    information: FloatArray,
    covariances: FloatArray,
) -> FloatArray:
    """(Q,) chi-square of measured ways that are not in a graph, by their noise and its own.

    covariances: (Q, 3, 3) of the same ways in the graph. With three degrees of freedom.
    """
    residuals = np.empty((len(ends), 3))
    kernels.residuals(poses, ends, measured, residuals)
    # (information^-1 + covariance)^-1, for information that may be singular
    joint = information @ np.linalg.inv(np.eye(3) + covariances @ information)
    return np.asarray(np.einsum("ni,nij,nj->n", residuals, joint, residuals))


def _order(
    ends: IntArray, measured: FloatArray, information: FloatArray, edge_kernels: IntArray
) -> IntArray:
    """(E,) edges by their ends, those between the same two by all else."""
    pairs = ends[:, 0] * (ends[:, 1].max(initial=0) + 1) + ends[:, 1]
    order = np.argsort(pairs, kind="stable")
    is_same = pairs[order][1:] == pairs[order][:-1]
    alike = np.append(is_same, False) | np.insert(is_same, 0, False)
    some = order[alike]
    keys = (edge_kernels[some], *information[some].reshape(-1, 9).T, *measured[some].T)
    order[alike] = some[np.lexsort((*keys, pairs[some]))]
    return order


def _places(indptr: IntArray, indices: IntArray) -> IntArray:
    """(B,) place of each block at which eliminating it fills little."""
    count = len(indptr) - 1
    heights = np.diff(indptr)
    columns = np.repeat(np.arange(count), heights)
    # any matrix of this pattern that has a factor
    values = np.where(indices == columns, 1.0 + heights[columns], -1.0)
    pattern = (values, indices.astype(np.int32), indptr.astype(np.int32))
    factor = _factored(csc_array(pattern, shape=(count, count)), "MMD_AT_PLUS_A")
    return np.asarray(factor.perm_c.astype(np.int64))


def _factored(
    matrix: csc_array[np.float64], ordering: Literal["NATURAL", "MMD_AT_PLUS_A"]
) -> SuperLU:
    # Pivots on the diagonal, as fits a positive definite matrix: rows keep the columns' order.
    return splu(matrix, permc_spec=ordering, diag_pivot_thresh=0.0, options={"SymmetricMode": True})

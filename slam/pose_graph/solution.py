"""What solving a pose graph gave: poses, how each edge fared, covariances, and whether to trust it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc

from slam.arrays import FloatArray, IntArray
from slam.pose_graph.equations import Covariances, Equations, surprises
from slam.pose_graph.robust import REJECTED_BELOW, EdgeKernel
from slam.se2 import SE2


@dataclass(frozen=True)
class GraphConsistency:
    """How well a graph's edges agree.

    rejected_loops: indices of the loops that the graph does not believe. loop_count: of all.
    chi_square: weighted, of the edges that are believed, with `degrees_of_freedom`; p_value: the
    chance of a larger one if poses and informations are right.
    worst_plain: the largest chi-square of an edge that is not a loop, with 3 degrees of freedom.
    """

    rejected_loops: IntArray
    loop_count: int
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    worst_plain: float

    @property
    def ratio(self) -> float:
        """Chi-square per degree of freedom: 1 if all is as promised; 0 where nothing is checked."""
        return self.chi_square / self.degrees_of_freedom if self.degrees_of_freedom > 0 else 0.0

    def is_failed(self, max_ratio: float = 2.0, max_rejected_share: float = 0.5) -> bool:
        """Whether the graph contradicts itself, so that its poses must not be trusted.

        max_ratio: two, since the informations of real scan matches are seldom better known.
        max_rejected_share: of the loops; where most are rejected, those left may be the wrong ones.
        """
        return self.ratio > max_ratio or len(self.rejected_loops) > (
            max_rejected_share * self.loop_count
        )


@dataclass(frozen=True, eq=False)
class PoseGraphSolution:
    """The solved graph of N nodes and E edges, in the order in which these were added.

    poses: (N, 3). chi_squares: (E,) whitened squared residuals. weights: (E,) in [0, 1], 0 for
    dropped edges. cost: the sum of the robust costs. is_converged: whether the last step was too
    small to be seen. iterations: of all runs that led here.
    """

    poses: FloatArray
    chi_squares: FloatArray
    weights: FloatArray
    cost: float
    is_converged: bool
    iterations: int
    edge_kernels: IntArray = field(repr=False)
    equations: Equations = field(repr=False)

    def pose(self, node: int) -> SE2:
        """The pose of a node."""
        return SE2.from_array(self.poses[node])

    def covariances(self, nodes: ArrayLike) -> FloatArray:
        """(M, 3, 3) marginal covariances of nodes (M,), each in the tangent of its pose.

        Of the fixed nodes: zero. Raises ValueError for a node that is not there, and if the edges
        leave a direction open, as the others do that need covariances.
        """
        nodes = self._checked(np.asarray(nodes, dtype=np.int64).reshape(-1))
        joint = self._covariances.of_pairs(np.column_stack([nodes, nodes]))
        return joint[:, :3, :3].copy()

    def relative_covariances(self, pairs: ArrayLike) -> FloatArray:
        """(Q, 3, 3) covariances of pose_i^-1 @ pose_j for pairs (Q, 2), in the tangent of its end.

        Cheapest where pairs with the same first node follow each other. Raises ValueError for a
        node that is not there.
        """
        pairs = self._checked(np.asarray(pairs, dtype=np.int64).reshape(-1, 2))
        return self._covariances.of_ways(self.poses, pairs)

    def surprises(
        self, pairs: ArrayLike, measured: ArrayLike, information: ArrayLike
    ) -> FloatArray:
        """(Q,) chi-squares of measured ways that are not edges, for gating loops before they are.

        pairs: (Q, 2); measured: (Q, 3) T_i_j; information: (Q, 3, 3). By their noise and the
        graph's own uncertainty; three degrees of freedom: 11.3 is exceeded by 1 % of right ones.
        """
        pairs = self._checked(np.asarray(pairs, dtype=np.int64).reshape(-1, 2))
        measured = np.asarray(measured, dtype=np.float64).reshape(len(pairs), 3)
        information = np.asarray(information, dtype=np.float64).reshape(len(pairs), 3, 3)
        covariances = self._covariances.of_ways(self.poses, pairs)
        return surprises(self.poses, pairs, measured, information, covariances)

    def rejected_loops(self, below: float = REJECTED_BELOW) -> IntArray:
        """Indices of the loops that weigh less; edges dropped by hand are not among them."""
        is_loop = self.edge_kernels == EdgeKernel.LOOP
        return np.flatnonzero(is_loop & (self.weights > 0.0) & (self.weights < below))

    def consistency(self) -> GraphConsistency:
        """How well the edges agree, for calling a graph failed."""
        rejected = self.rejected_loops()
        is_believed = self.weights > 0.0
        loop_count = int((is_believed & (self.edge_kernels == EdgeKernel.LOOP)).sum())
        is_believed[rejected] = False
        chi_square = float((self.weights * self.chi_squares)[is_believed].sum())
        free = int((~self.equations.is_fixed).sum())
        degrees = max(3 * (int(is_believed.sum()) - free), 0)
        is_plain = is_believed & (self.edge_kernels != EdgeKernel.LOOP)
        return GraphConsistency(
            rejected,
            loop_count,
            chi_square,
            degrees,
            float(chdtrc(degrees, chi_square)) if degrees else 1.0,
            float(self.chi_squares[is_plain].max(initial=0.0)),
        )

    @cached_property
    def _covariances(self) -> Covariances:
        equations = self.equations
        return Covariances(equations.system(self.poses, self.weights[self._kept][equations.order]))

    @property
    def _kept(self) -> IntArray:
        """The edges that are not dropped, which the equations are made of."""
        return np.flatnonzero(self.weights > 0.0)

    def _checked(self, nodes: IntArray) -> IntArray:
        wrong = nodes[(nodes < 0) | (nodes >= len(self.poses))]
        if len(wrong):
            raise ValueError(f"node {wrong[0]} is not one of the graph's {len(self.poses)}")
        return nodes

"""A pose graph that grows node by node and edge by edge, and is solved when asked."""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import Enum
from itertools import chain

import numpy as np
from numpy.typing import ArrayLike

from slam.arrays import BoolArray, FloatArray, IntArray, frozen_array, lengthened
from slam.kernels.normal_equations import lower_root_into
from slam.pose_graph.chordal import chordal_poses
from slam.pose_graph.equations import Equations, is_held
from slam.pose_graph.robust import EdgeKernel, PoseGraphConfig, best_descent, descend
from slam.pose_graph.solution import PoseGraphSolution
from slam.se2 import SE2

_UPPER = np.triu(np.ones((3, 3), np.bool_))
_PAIRS = ((0, 1), (0, 2), (1, 2))
"""Off the diagonal of a symmetric matrix."""


class Start(Enum):
    """Where solving starts.

    POSES: from the nodes' own poses, for a graph that grows and was solved before; a loop that is
    far from them is rejected. STAGES: from these too, but the loops are taken in by and by and the
    best of several runs is kept, for a whole graph with wrong loops: ten to thirty times the work.
    CHORDAL: from the edges alone, when the poses are no good and wrong loops are few.
    """

    POSES = "poses"
    STAGES = "stages"
    CHORDAL = "chordal"


class PoseGraph:
    """Nodes are poses in the plane, edges measured ways: T_i_j = measured @ exp(noise).

    The information of an edge is that of its noise, in the tangent of the measured end. The first
    node is fixed unless others are.
    """

    def __init__(self) -> None:
        self._node_count = self._edge_count = 0
        # longer than filled
        self._poses = np.empty((16, 3))
        self._is_fixed = np.zeros(16, dtype=np.bool_)
        self._ends = np.empty((16, 2), dtype=np.int64)
        self._measured = np.empty((16, 3))
        self._information = np.empty((16, 3, 3))
        self._kernels = np.empty(16, dtype=np.int64)
        self._is_dropped = np.zeros(16, dtype=np.bool_)
        self._equations: Equations | None = None
        """Of the present nodes and edges, None since they changed."""

    @property
    def node_count(self) -> int:
        """How many nodes there are."""
        return self._node_count

    @property
    def edge_count(self) -> int:
        """How many edges there are, dropped ones too."""
        return self._edge_count

    @property
    def poses(self) -> FloatArray:
        """(N, 3) poses of the nodes, from which solving starts."""
        return self._poses[: self._node_count].copy()

    def pose(self, node: int) -> SE2:
        """The pose of one node."""
        return SE2.from_array(self._poses[: self._node_count][node])

    @property
    def is_fixed(self) -> BoolArray:
        """(N,) nodes that solving does not move."""
        is_fixed = self._is_fixed[: self._node_count].copy()
        if not is_fixed.any():
            is_fixed[:1] = True
        return is_fixed

    @property
    def ends(self) -> IntArray:
        """(E, 2) nodes from and to which the edges lead."""
        return self._ends[: self._edge_count].copy()

    @property
    def measured(self) -> FloatArray:
        """(E, 3) measured ways T_i_j."""
        return self._measured[: self._edge_count].copy()

    @property
    def information(self) -> FloatArray:
        """(E, 3, 3) information of the ways, in the tangent of their ends."""
        return self._information[: self._edge_count].copy()

    @property
    def edge_kernels(self) -> IntArray:
        """(E,) `EdgeKernel` of the edges."""
        return self._kernels[: self._edge_count].copy()

    @property
    def is_dropped(self) -> BoolArray:
        """(E,) edges that take no part any more."""
        return self._is_dropped[: self._edge_count].copy()

    def add_node(self, T_map_node: SE2, is_fixed: bool = False) -> int:
        """The number of a new node, counted from 0. Raises ValueError for a pose not finite."""
        pose = T_map_node.as_array()
        if not np.isfinite(pose).all():
            raise ValueError(f"a node's pose must be finite, not {pose.tolist()}")
        if self._node_count == len(self._poses):
            self._poses, self._is_fixed = _grown(self._poses), _grown(self._is_fixed)
        self._poses[self._node_count] = pose
        self._is_fixed[self._node_count] = is_fixed
        self._node_count += 1
        self._equations = None
        return self._node_count - 1

    def add_edge(
        self,
        i: int,
        j: int,
        T_i_j: SE2,
        information: ArrayLike,
        kernel: EdgeKernel = EdgeKernel.PLAIN,
    ) -> int:
        """The number of a new edge, counted from 0.

        information: (3, 3), symmetric, no direction negative; one may be without any. Raises
        ValueError for other ones, for an edge from a node to itself or to one that is not there.
        """
        for node in (i, j):
            if not 0 <= node < self._node_count:
                raise ValueError(f"edge {i} -> {j}: there is no node {node} yet")
        if i == j:
            raise ValueError(f"edge {i} -> {j} leads from a node to itself")
        measured = T_i_j.as_array()
        matrix = frozen_array(information, (3, 3), f"information of edge {i} -> {j}")
        # plain floats: of NumPy's, each operation takes as long as all of these
        rows = matrix.tolist()
        largest = max(abs(value) for row in rows for value in row)
        if not all(map(math.isfinite, (*measured.tolist(), *chain(*rows)))):
            raise ValueError(f"edge {i} -> {j}: way and information must be finite")
        if any(abs(rows[k][m] - rows[m][k]) > 1e-6 * largest for k, m in _PAIRS):
            raise ValueError(f"edge {i} -> {j}: its information is not symmetric")
        matrix = np.where(_UPPER, matrix, matrix.T)
        # most are positive definite, which a root shows at once
        is_positive = largest > 0.0 and (
            lower_root_into(matrix, 0.0, np.empty((3, 3)))
            or np.linalg.eigvalsh(matrix)[0] >= -1e-9 * largest
        )
        if not is_positive:
            raise ValueError(f"edge {i} -> {j}: its information is not positive")
        if self._edge_count == len(self._ends):
            self._ends, self._measured = _grown(self._ends), _grown(self._measured)
            self._information = _grown(self._information)
            self._kernels, self._is_dropped = _grown(self._kernels), _grown(self._is_dropped)
        at = self._edge_count
        self._ends[at], self._measured[at] = (i, j), measured
        self._information[at], self._kernels[at] = matrix, kernel
        self._is_dropped[at] = False
        self._edge_count += 1
        self._equations = None
        return at

    def drop_edges(self, edges: Iterable[int]) -> None:
        """Takes edges out for good; the others keep their numbers. ValueError for unknown ones."""
        for edge in edges:
            if not 0 <= edge < self._edge_count:
                raise ValueError(
                    f"there is no edge {edge} to drop: the graph has {self.edge_count}"
                )
            self._is_dropped[edge] = True
        self._equations = None

    def part(self, is_kept: BoolArray) -> tuple[PoseGraph, IntArray]:
        """The graph of some nodes (N,), with the edges between these; and what numbers the edges have here, (E',)."""
        numbers = np.cumsum(is_kept) - 1
        edges = np.flatnonzero(~self.is_dropped & is_kept[self.ends].all(axis=1))
        part = PoseGraph()
        part._poses, part._is_fixed = self.poses[is_kept], self.is_fixed[is_kept]
        part._node_count, part._edge_count = len(part._poses), len(edges)
        part._ends, part._measured = numbers[self._ends[edges]], self._measured[edges]
        part._information, part._kernels = self._information[edges], self._kernels[edges]
        part._is_dropped = np.zeros(len(edges), np.bool_)
        return part, edges

    def set_poses(self, poses: ArrayLike) -> None:
        """Moves the first M nodes to poses (M, 3), as a solution has them; later ones stay."""
        array = frozen_array(poses, (None, 3), "poses")
        if len(array) > self._node_count or not np.isfinite(array).all():
            raise ValueError(f"at most {self._node_count} finite poses, not {len(array)}")
        self._poses[: len(array)] = array

    def solve(
        self, start: Start = Start.POSES, config: PoseGraphConfig | None = None
    ) -> PoseGraphSolution:
        """The most likely poses. The graph's own stay where they are: see `set_poses`.

        In a direction that the edges leave open nodes stay. Raises ValueError for a graph without
        edges, all nodes fixed, or nodes that no chain of edges joins to a fixed one.
        """
        config = PoseGraphConfig() if config is None else config
        equations = self._solvable()
        poses = self.poses
        if start is Start.STAGES:
            found = best_descent(equations, poses, config)
        elif start is Start.CHORDAL:
            poses = chordal_poses(equations, poses)
            far = equations.chi_squares(poses) / config.loop_chi_square
            found = descend(equations, poses, config, np.maximum(far, 1.0))
        else:
            found = descend(equations, poses, config)
        kept = np.flatnonzero(~self.is_dropped)
        weights, chi_squares = np.zeros(self.edge_count), np.zeros(self.edge_count)
        weights[kept] = equations.unsorted(found.weights)
        chi_squares[kept] = equations.unsorted(found.chi_squares)
        for array in (found.poses, weights, chi_squares):
            array.flags.writeable = False
        return PoseGraphSolution(
            found.poses, chi_squares, weights, found.cost, found.is_converged, found.iterations,
            self.edge_kernels, equations,
        )  # fmt: skip

    def _solvable(self) -> Equations:
        if self._equations is not None:
            return self._equations
        kept = ~self.is_dropped
        if not kept.any():
            raise ValueError(
                f"a pose graph of {self.node_count} nodes and no edges has no solution"
            )
        is_fixed, ends = self.is_fixed, self.ends[kept]
        if is_fixed.all():
            raise ValueError(f"all {self.node_count} nodes of the pose graph are fixed")
        loose = np.flatnonzero(~is_held(is_fixed, ends))
        if len(loose):
            raise ValueError(f"no edges join {_named(loose)} to a fixed node of the pose graph")
        self._equations = Equations(
            is_fixed,
            ends,
            self.measured[kept],
            self.information[kept],
            self.edge_kernels[kept],
        )
        return self._equations


def _grown(array: np.ndarray) -> np.ndarray:
    """Longer by a quarter: twice as long it would be half empty, of drives that do not end soon."""
    return lengthened(array, max(16, len(array) // 4))


def _named(nodes: IntArray) -> str:
    """Nodes in a sentence, the first few of many."""
    if len(nodes) == 1:
        return f"node {nodes[0]}"
    first = ", ".join(str(node) for node in nodes[:5])
    return f"nodes {first}" + (f" and {len(nodes) - 5} more" if len(nodes) > 5 else "")

"""Simulated pose graphs: a robot that drives the streets of a square town, with loops, some wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from slam.pose_graph import EdgeKernel, PoseGraph
from slam.se2 import SE2

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ODOMETRY_SIGMAS = (0.02, 0.02, 0.01)
"""Of a step of half a metre."""
LOOP_SIGMAS = (0.03, 0.03, 0.01)


@dataclass(frozen=True)
class Town:
    """The poses as they were, and all edges: odometry first, then right loops, then wrong ones."""

    truth: list[SE2]
    ends: list[tuple[int, int]]
    measured: list[SE2]
    information: list[FloatArray]
    right_loops: int

    @property
    def wrong(self) -> IntArray:
        return np.arange(len(self.truth) - 1 + self.right_loops, len(self.ends))

    def graph(self, with_wrong: bool = True, order: IntArray | None = None) -> PoseGraph:
        """Nodes where the odometry sees them; edges in another order if one is given."""
        graph = PoseGraph()
        T = self.truth[0]
        graph.add_node(T)
        for step in self.measured[: len(self.truth) - 1]:
            T = T @ step
            graph.add_node(T)
        count = len(self.ends) if with_wrong else len(self.ends) - len(self.wrong)
        for e in np.arange(count) if order is None else order:
            kernel = EdgeKernel.PLAIN if e < len(self.truth) - 1 else EdgeKernel.LOOP
            graph.add_edge(*self.ends[e], self.measured[e], self.information[e], kernel)
        return graph

    def position_error_m(self, poses: FloatArray) -> float:
        """RMSE; the first pose is known, so nothing is aligned."""
        truth = np.array([T.as_array() for T in self.truth])
        return float(np.sqrt(np.mean(np.sum((poses - truth)[:, :2] ** 2, axis=1))))


def town(
    seed: int,
    nodes: int,
    loops: int,
    wrong_share: float = 0.0,
    group: int = 1,
    odometry_sigmas: tuple[float, float, float] = ODOMETRY_SIGMAS,
    half_width_m: float = 8.0,
) -> Town:
    """A town. wrong_share: of all loops; group: so many wrong ones in a row agree with each other."""
    rng = np.random.default_rng(seed)
    truth = _drive(rng, nodes, half_width_m)
    ends = [(i, i + 1) for i in range(nodes - 1)]
    near = KDTree([(T.x, T.y) for T in truth]).query_pairs(1.0, output_type="ndarray")
    near = near[near[:, 1] - near[:, 0] > 20]
    near = near[np.lexsort(near.T)]
    chosen = near[np.sort(rng.choice(len(near), min(loops, len(near)), replace=False))]
    ends += [(int(i), int(j)) for i, j in chosen]
    sigmas = [odometry_sigmas] * (nodes - 1) + [LOOP_SIGMAS] * len(chosen)
    # T_i_j = measured @ exp(noise)
    measured = [
        truth[i].inverse() @ truth[j] @ SE2.exp(-rng.normal(size=3) * sigma)
        for (i, j), sigma in zip(ends, sigmas, strict=True)
    ]
    wrong = round(wrong_share / (1.0 - wrong_share) * len(chosen))
    while wrong > 0:
        i, j = sorted(rng.choice(nodes - group, 2, replace=False))
        if j - i < 20 + group:
            continue
        turn = rng.choice([0.0, 0.5, 1.0, 1.5]) * np.pi + 0.1 * rng.normal()
        # where the second place would lie if it were the first
        shift = truth[i] @ SE2(*rng.uniform(-1.0, 1.0, 2), turn) @ truth[j].inverse()
        for k in range(min(group, wrong)):
            noise = SE2.exp(rng.normal(size=3) * LOOP_SIGMAS)
            ends.append((int(i) + k, int(j) + k))
            measured.append(truth[i + k].inverse() @ shift @ truth[j + k] @ noise)
            sigmas.append(LOOP_SIGMAS)
        wrong -= group
    information = [np.diag(np.square(sigma) ** -1.0) for sigma in sigmas]
    return Town(truth, ends, measured, information, len(chosen))


def _drive(rng: np.random.Generator, nodes: int, half_width_m: float) -> list[SE2]:
    """Half a metre from node to node, streets two metres apart."""
    poses = [SE2.identity()]
    while len(poses) < nodes:
        turn = 0.0
        if len(poses) % 4 == 0:
            turn = rng.choice([0.0, 0.0, 0.5, -0.5]) * np.pi
            while _is_outside(poses[-1] @ SE2(0.0, 0.0, turn) @ SE2(2.0, 0.0, 0.0), half_width_m):
                turn = rng.choice([0.5, -0.5, 1.0]) * np.pi
        poses.append(poses[-1] @ SE2(0.0, 0.0, turn) @ SE2(0.5, 0.0, 0.0))
    return poses


def _is_outside(T: SE2, half_width_m: float) -> bool:
    return max(abs(T.x), abs(T.y)) > half_width_m

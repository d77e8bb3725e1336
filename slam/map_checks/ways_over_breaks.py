"""Ways over breaks, by the wheels and by the rest of a map.

Where scans broke off wheels may have been wrong, and count for little in the pose graph.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray
from slam.frontend.keyframes import Keyframe
from slam.frontend.told_steps import ToldStep
from slam.map_checks.wheels_borne_out import shown_noise
from slam.pose_graph import PoseGraphSolution
from slam.se2 import SE2

_LEAST_KNOWN = 1.0
"""[1/m2], [1/rad2]: of what the rest knows to less than a metre, or not at all, it bears out nothing. Chosen."""


@dataclass(frozen=True, eq=False)
class SeenWay:
    """Where the rest of a map, which knows the way to covariance (3, 3), has what came after a break, off (3,) where
    wheels lead [m, m, rad]."""

    off: FloatArray
    covariance: FloatArray

    @property
    def off_m(self) -> float:
        """How far off [m]."""
        return float(np.hypot(self.off[0], self.off[1]))

    def squared(self, sure: FloatArray) -> float:
        """Normalised error squared of wheels as sure (3, 3)."""
        return float(self.off @ np.linalg.solve(self.covariance + sure, self.off))


def sure_ways(
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
    told: Sequence[ToldStep],
    break_sigma: tuple[float, float, float],
    least_noise: float,
) -> dict[int, FloatArray]:
    """Of the keyframes at poses (K, 3) to which scans broke off, the covariance (3, 3) of the way by wheels as
    noisy as they show, by least_noise at least; of those that wheels know, and are not yet believed for.

    told: of the last keyframes, from a session's first on, the step to each by the wheels. break_sigma: (m, m, rad)
    by which these were taken for less sure over a break.
    """
    first, added = len(keyframes) - len(told), np.diag(np.square(break_sigma))
    breaks = [k for k in range(first + 1, len(keyframes)) if keyframes[k].is_break]
    noise = shown_noise(keyframes, poses, told, least_noise) if breaks else None
    if noise is None:
        return {}
    sure = {k: noise * (keyframes[k].covariance - added) for k in breaks}
    # noisy wheels are no surer than they were taken for; what was believed is as sure as it is
    return {
        k: one
        for k, one in sure.items()
        if (np.diag(one) < np.diag(added)).all() and one[0, 0] > 0.0
    }


def seen_ways(
    keyframes: Sequence[Keyframe], solution: PoseGraphSolution, breaks: Iterable[int]
) -> dict[int, SeenWay]:
    """What the rest of a graph knows of the ways over breaks, wheels apart; of those that it knows."""
    ks = list(breaks)
    try:
        known = solution.relative_covariances(np.array([(k - 1, k) for k in ks]).reshape(-1, 2))
    except ValueError:  # all that the solver says of a direction without bounds
        return {}
    found = dict[int, SeenWay]()
    for k, seen in zip(ks, known, strict=True):
        T_before, T_there = (SE2.from_array(pose) for pose in solution.poses[k - 1 : k + 1])
        step = keyframes[k]
        off = (step.T_before.inverse() @ T_before.inverse() @ T_there).log()
        information = np.linalg.inv(seen) - np.linalg.inv(step.covariance)
        if np.linalg.eigvalsh(information)[0] < _LEAST_KNOWN:
            continue
        rest = np.linalg.inv(information)
        # as the rest has it alone, where the graph was solved for with the wheels as unsure as they count
        found[k] = SeenWay(off + rest @ np.linalg.solve(step.covariance, off), rest)
    return found

"""Ways over breaks by the wheels, where the rest of the map bears them out.

Where scans broke off wheels may have been wrong, and count for little: what came before then hangs by its
scans alone, and drifts. Once loops tell where it lies, and wheels lead there, they tell better.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray
from slam.keyframe_graph import KeyframeGraph
from slam.keyframes import as_sure_as_before
from slam.odometry import place_sigma_m
from slam.se2 import SE2
from slam.strays import ToldStep
from slam.wheels_borne_out import shown_noise

_MOST_NIS = 11.3
"""Of the wheels' way against what the rest of the map knows of it: three degrees of freedom, 1 % of right ones."""
_LEAST_KNOWN = 1.0
"""[1/m2], [1/rad2]: of what the rest knows to less than a metre, or not at all, it bears out nothing. Chosen."""
_SURER = 0.5
"""Standard deviation of the wheels' place, as a share of the rest's, up to which they know better. Chosen: wheels
that slipped by 0.6 m while a laser was frozen were within what the rest knew, as sure as that, and drew right
maps 0.1 m aside."""


class BreaksBorneOut:
    """The breaks of a session over which wheels were believed, as found last; whoever asks again begins without
    them. On the map they stay as sure.

    break_sigma: (m, m, rad) by which wheels are less sure over a break.
    """

    def __init__(self, break_sigma: tuple[float, float, float]) -> None:
        self._added = np.diag(np.square(break_sigma))
        self._said = dict[int, tuple[FloatArray, FloatArray]]()

    def believe(self, graph: KeyframeGraph, told: Sequence[ToldStep]) -> None:
        """Makes the ways of a graph over breaks as sure as the wheels, where these may be right; told: of the
        last keyframes, from a session's first on, the step to each by the wheels."""
        keyframes = as_sure_as_before(graph.keyframes, self._said)
        first = len(keyframes) - len(told)
        breaks = [k for k in range(first + 1, len(keyframes)) if keyframes[k].is_break]
        if not breaks:
            return
        self._said = {}
        graph.renew(keyframes, graph.loops, graph.poses)
        noise = shown_noise(keyframes, graph.poses, told)
        if not graph.loops or noise is None:
            return
        sure = {k: noise * (keyframes[k].covariance - self._added) for k in breaks}
        # noisy wheels are no surer than they were taken for
        sure = {k: one for k, one in sure.items() if (np.diag(one) < np.diag(self._added)).all()}
        if not sure:
            return
        for k in self._borne_out(graph, sure):
            self._said[k] = sure[k], keyframes[k].covariance
            keyframes[k] = replace(keyframes[k], covariance=sure[k])
        graph.renew(keyframes, graph.loops, graph.poses)

    def _borne_out(self, graph: KeyframeGraph, sure: Mapping[int, FloatArray]) -> list[int]:
        """Breaks over which the rest of the graph may have led where wheels did; sure: (3, 3) covariances of
        these."""
        solution = graph.solve()
        breaks = np.array(list(sure))
        try:
            known = solution.relative_covariances(np.column_stack([breaks - 1, breaks]))
        except ValueError:  # all that the solver says of a direction without bounds
            return []
        found = list[int]()
        for k, seen in zip(sure, known, strict=True):
            T_before, T_there = (SE2.from_array(pose) for pose in solution.poses[k - 1 : k + 1])
            step = graph.keyframes[k]
            off = (step.T_before.inverse() @ T_before.inverse() @ T_there).log()
            information = np.linalg.inv(seen) - np.linalg.inv(step.covariance)
            if np.linalg.eigvalsh(information)[0] < _LEAST_KNOWN:
                continue
            rest = np.linalg.inv(information)
            is_surer = place_sigma_m(sure[k]) < _SURER * place_sigma_m(rest)
            if is_surer and _squared(off, rest, step.covariance, sure[k]) <= _MOST_NIS:
                found.append(k)
        return found


def _squared(off: FloatArray, rest: FloatArray, loose: FloatArray, sure: FloatArray) -> float:
    """Normalised error squared of wheels, as sure (3, 3), against the rest of a map, which knows the way to (3, 3):
    off by so much (3,) where it was solved for with the wheels as loose (3, 3)."""
    alone = off + rest @ np.linalg.solve(loose, off)
    return float(alone @ np.linalg.solve(rest + sure, alone))

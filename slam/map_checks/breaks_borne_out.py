"""Ways over breaks by the wheels, where the rest of the map bears them out.

Where scans broke off wheels may have been wrong, and count for little: what came before then hangs by its
scans alone, and drifts. Once loops tell where it lies, and wheels lead there, they tell better.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from slam.arrays import FloatArray
from slam.backend.keyframe_graph import KeyframeGraph
from slam.frontend.keyframes import as_sure_as_before, said_of
from slam.frontend.remaining import Remaining
from slam.frontend.told_steps import ToldStep
from slam.loop_closing import Loop, renumbered
from slam.map_checks.lone_loops import LEAST_NOISE, lone_loops
from slam.map_checks.ways_over_breaks import seen_ways, sure_ways
from slam.odometry import place_sigma_m

_MOST_NIS = 11.3
"""Of the wheels' way against what the rest of the map knows of it: three degrees of freedom, 1 % of right ones."""
_SURER = 0.5
"""Standard deviation of the wheels' place, as a share of the rest's, up to which they know better. Chosen: wheels
that slipped by 0.6 m while a laser was frozen were within what the rest knew, as sure as that, and drew right
maps 0.1 m aside."""
_ROUNDS = 4
"""In which loops are let go, one of each break in each. Chosen."""


class BreaksBorneOut:
    """The breaks of a session over which wheels were believed, as found last; whoever asks again begins without
    them. On the map they stay as sure.

    break_sigma: (m, m, rad) by which wheels are less sure over a break. step_sigma: as in `KeyframeGraph`. let_go:
    the loops that alone denied them.
    """

    def __init__(
        self,
        break_sigma: tuple[float, float, float],
        step_sigma: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self._break_sigma, self._step_sigma = break_sigma, step_sigma
        self._said = dict[int, tuple[FloatArray, FloatArray]]()
        self.let_go: list[Loop] = []

    def renumber(self, remaining: Remaining) -> None:
        """Keyframes were let go."""
        self._said = said_of(self._said, remaining)
        self.let_go = renumbered(self.let_go, remaining)

    def believe(self, graph: KeyframeGraph, told: Sequence[ToldStep]) -> None:
        """Makes the ways of a graph over breaks as sure as the wheels, where these may be right; told: of the
        last keyframes, from a session's first on, the step to each by the wheels."""
        keyframes = as_sure_as_before(graph.keyframes, self._said)
        if not any(keyframe.is_break for keyframe in keyframes[len(keyframes) - len(told) + 1 :]):
            return
        graph.renew(keyframes, [*graph.loops, *self.let_go], graph.poses)
        self._said, self.let_go = {}, []
        if not graph.loops:
            return
        self._let_go_lone(graph, told)
        sure = sure_ways(graph.keyframes, graph.poses, told, self._break_sigma, least_noise=1.0)
        if sure:
            self._believe(graph, {k: sure[k] for k in self._borne_out(graph, sure)})

    def sorted_loops(
        self, graph: KeyframeGraph, told: Sequence[ToldStep]
    ) -> tuple[list[Loop], list[Loop]]:
        """As `KeyframeGraph.sorted_loops`, once those are let go that alone deny the wheels over a break, and are
        denied by the others: two against one."""
        self._let_go_lone(graph, told)
        kept, rejected = graph.sorted_loops()
        return kept, [*rejected, *self.let_go]

    def leave_apart(self, first: int) -> None:
        """Forgets the loops from keyframes before the first of a session, with which it is joined no more."""
        self.let_go = [loop for loop in self.let_go if not loop.earlier < first <= loop.later]

    def _let_go_lone(self, graph: KeyframeGraph, told: Sequence[ToldStep]) -> None:
        for _ in range(_ROUNDS):
            sure = sure_ways(graph.keyframes, graph.poses, told, self._break_sigma, LEAST_NOISE)
            if not sure or not graph.loops:
                return
            kept, _rejected = graph.sorted_loops()
            lone = lone_loops(graph.keyframes, kept, graph.solve(), sure, self._step_sigma)
            lone = [one for one in lone if one.is_denied]
            if not lone:
                return
            self.let_go += [one.loop for one in lone]
            loops = [loop for loop in graph.loops if all(loop is not one.loop for one in lone)]
            graph.renew(graph.keyframes, loops, graph.poses)
            self._believe(graph, {one.keyframe: sure[one.keyframe] for one in lone})
            graph.solve()

    def _believe(self, graph: KeyframeGraph, sure: Mapping[int, FloatArray]) -> None:
        """Makes ways over breaks as sure (3, 3)."""
        keyframes = list(graph.keyframes)
        for k, covariance in sure.items():
            self._said[k] = covariance, keyframes[k].covariance
            keyframes[k] = replace(keyframes[k], covariance=covariance)
        graph.renew(keyframes, graph.loops, graph.poses)

    def _borne_out(self, graph: KeyframeGraph, sure: Mapping[int, FloatArray]) -> list[int]:
        """Breaks over which the rest of the graph may have led where wheels did; sure: (3, 3) covariances of
        these."""
        seen = seen_ways(graph.keyframes, graph.solve(), sure)
        return [
            k
            for k, one in seen.items()
            if place_sigma_m(sure[k]) < _SURER * place_sigma_m(one.covariance)
            if one.squared(sure[k]) <= _MOST_NIS
        ]

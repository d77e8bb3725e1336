"""A session of mapping: one drive, and how it is joined with the map of those before it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray
from slam.backend.keyframe_graph import KeyframeGraph
from slam.backend.session_joining import SessionJoiner, set_aside
from slam.frontend.keyframes import FrontEndStep, Keyframe
from slam.frontend.remaining import Remaining
from slam.frontend.told_steps import ToldStep
from slam.loop_closing import LoopCloser, without_ties
from slam.map_checks.map_consistency import do_contradict
from slam.map_checks.map_drift import between_m
from slam.mapper_config import MapperConfig
from slam.se2 import SE2
from slam.slam_map import SlamMap, graph_of


class MapSession:
    """The keyframes and scans of a drive among all of a map, and whether they are joined with it.

    number: of the session, from 0. first, first_step: of its keyframes and scans. start: pose of its
    first scan on the map, or in a frame of its own.
    """

    def __init__(
        self, graph: KeyframeGraph, config: MapperConfig, known: SlamMap | None = None
    ) -> None:
        """graph: of all keyframes; known: the map of the sessions before, which it holds."""
        self._graph, self._config = graph, config
        self.number = 0 if known is None else known.session_count
        self.first = 0 if known is None else len(known.keyframes)
        self.first_step = 0 if known is None else len(known.steps)
        self.start, self.is_joined = SE2.identity(), True
        self._known_poses: FloatArray = np.empty((0, 3)) if known is None else known.poses
        self._joiner: SessionJoiner | None = None
        self._is_start_unknown, self._check_at = False, math.inf

    @classmethod
    def after(
        cls,
        known: SlamMap,
        start: SE2 | None,
        graph: KeyframeGraph,
        closer: LoopCloser,
        config: MapperConfig,
    ) -> MapSession:
        """The next session on a map, from a pose there if one is known.

        Raises ValueError for a map without a wall, if it is not.
        """
        session = cls(graph, config, known)
        session.is_joined, session._is_start_unknown = False, start is None
        session.start = start or SE2.identity()
        session._joiner = SessionJoiner(
            graph.keyframes, known.poses, closer, start is not None, config.joining
        )
        return session

    @property
    def comparable(self) -> range | None:
        """The keyframes of which it is known where they lie as seen from the last one; None: all."""
        return None if self.is_joined else range(self.first, len(self._graph))

    @property
    def asked_from(self) -> int:
        """The first keyframe of which the scan may yet show where the session lies."""
        if self.is_joined or self._joiner is None:
            return len(self._graph)
        return self._joiner.asked_from

    def own(self, keyframe: Keyframe) -> Keyframe:
        """The next keyframe, as one of the map; the first of a session is seen from no other."""
        index = len(self._graph)
        if index != self.first or index == 0:
            return keyframe
        way = self._graph.pose(index - 1).inverse() @ self.start @ keyframe.T_map_base
        unknown = ToldStep.unknown()
        return replace(
            keyframe, T_before=way, covariance=unknown.covariance, is_break=True, told=unknown
        )

    def look_for_join(self, time_s: float) -> None:
        """Joins the session with the map, if its keyframes show where it lies, by as much work as there
        is time for; inf: all that it takes."""
        if self._joiner is None or self.is_joined:
            return
        graph, config = self._graph, self._config
        poses = graph.poses
        join = self._joiner.look(graph.keyframes, poses, time_s, graph.looseness.sigmas_m)
        if join is None:
            return
        graph.set_poses(join.moved(poses, self.first))
        graph.take(join.loops)
        graph.adjust(config.online_iterations)  # from now on they tell how far things are
        self.is_joined = True
        self._check_at = len(graph) - 1 + config.joining.first_check

    def check(self) -> None:
        """Takes a join back that does not hold, each time that twice as much is known."""
        index = len(self._graph) - 1
        if index >= self._check_at:
            self._check_at = index + 2 * (index - self.first)
            if not self.holds(self._config.joining.most_checked):
                self.unjoin()

    def holds(self, most_pairs: int | None = None) -> bool:
        """Whether the session's scans may have been taken where it was joined with the map."""
        if self._joiner is None or not self.is_joined:
            return True
        against = self._config.joining.against
        if most_pairs is not None:
            against = replace(against, most_pairs=most_pairs)
        return not do_contradict(self._graph.keyframes, self._graph.poses, self.first, against)

    def unjoin(self) -> None:
        """Takes back a join that was wrong: the session is a piece of its own again."""
        assert self._joiner is not None
        first = self.first
        loops = [one for one in self._graph.loops if not one.earlier < first <= one.later]
        self._graph.renew(self._graph.keyframes, loops, self._graph.poses)
        self._joiner.reject()
        self.is_joined, self._check_at = False, math.inf

    def renumber(self, remaining: Remaining) -> None:
        """Keyframes were let go."""
        self._known_poses = self._known_poses[remaining.is_kept[: self.first]]
        self.first = remaining.number(self.first)
        if not math.isinf(self._check_at):
            self._check_at = remaining.number(int(self._check_at))
        if self._joiner is not None:
            self._joiner.renumber(remaining)

    def kept_apart(self, poses: FloatArray) -> FloatArray:
        """Poses (K, 3) of all keyframes where the session was not joined: set against nothing, it moves
        nothing."""
        return np.concatenate([self._known_poses, poses[self.first :]])

    def set_beside(self, keyframes: list[Keyframe], poses: FloatArray) -> FloatArray:
        """Poses (K, 3), with a session that may be anywhere beside the map; its first keyframe, in
        place, seen from the one before as they are."""
        if not 0 < self.first < len(keyframes):
            return poses
        if not self.is_joined and self._is_start_unknown:
            poses = set_aside(keyframes, poses, self.first)
        before, after = SE2.from_array(poses[self.first - 1]), SE2.from_array(poses[self.first])
        keyframes[self.first] = replace(keyframes[self.first], T_before=before.inverse() @ after)
        return poses

    def between_m(self, slam_map: SlamMap, one: int, other: int) -> float:
        """How sure a map is of how two keyframes of the session lie [m], other after one; not at all
        where loops to those between them, or beside, contradict the others: either may be false."""
        beside = self._config.consistency.beside
        one, other = self.first + one, self.first + other
        ends = [end for loop in slam_map.rejected for end in (loop.earlier, loop.later)]
        if any(one - beside <= end <= other + beside for end in ends):
            return math.inf
        # a tie is looked for where the way that nobody measured would have led
        loops = without_ties((*slam_map.loops, *slam_map.rejected))
        graph = graph_of(slam_map.keyframes, loops, slam_map.poses, self._config.step_sigma)
        return between_m(graph, one, other)

    def objections(self, keyframes: Sequence[Keyframe], steps: Sequence[FrontEndStep]) -> list[str]:
        """In words, that nothing in it tells where it lies."""
        if self.first == len(keyframes) and len(steps) > self.first_step > 0:
            return [f"session {self.number + 1} has no scan that tells anything"]
        return []

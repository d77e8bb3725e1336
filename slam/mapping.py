"""Self-localisation and mapping (Fig. 3): scans placed one by one, loops closed, poses adjusted."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from slam.arrays import FloatArray
from slam.drive_monitor import DriveMonitor
from slam.front_end import FrontEnd
from slam.joint_adjustment import jointly_adjusted
from slam.keyframe_graph import KeyframeGraph
from slam.keyframes import FrontEndStep, Keyframe, StepStatus
from slam.loop_closing import Loop, LoopCloser, without_ties
from slam.loose_runs import smoothed
from slam.map_consistency import acquitted, do_contradict, judged
from slam.map_drift import between_m, too_far_adrift
from slam.mapper_config import MapperConfig
from slam.measurements import Measurement
from slam.odometry_jumps import OdometryJumps
from slam.open_ways import unknown_ways
from slam.rescaling import chained, rescaled
from slam.se2 import SE2, wrap_angle
from slam.session_joining import SessionJoiner, set_aside
from slam.slam_map import SlamMap, graph_of, points_seen
from slam.strays import without_strays

_ANYWHERE = np.diag(np.square([1000.0, 1000.0, 10.0]))
"""Of the way between two sessions [m, rad]: nobody knows it. chosen: wider than any building."""
_DOUBTED = np.eye(3)
"""Of a motion [m, rad] that is told, and not believed; chosen: hardly a robot goes as far from one scan
to the next."""


@dataclass(frozen=True, eq=False)
class MapperStep:
    """One scan, placed: the pose on the map as it is so far, and how it was found.

    is_joined: False while no scan has shown where on the map a second session lies. The pose is then
    what follows from the start that was given, or as seen from the session's first one.
    """

    time_s: float
    T_map_base: SE2
    status: StepStatus
    inlier_ratio: float
    loops: int
    is_joined: bool = True


class Mapper:
    """Makes a map of an unknown place, scan by scan; `T_map_base` is the robot's last pose on it."""

    def __init__(self, T_base_laser: SE2, config: MapperConfig | None = None) -> None:
        self.config = config or MapperConfig()
        self._front_end = FrontEnd(T_base_laser, self.config.front_end)
        self._closer = LoopCloser(self.config.loops, self.config.front_end.surfaces)
        self._graph = KeyframeGraph(self.config.step_sigma)
        self._steps: list[FrontEndStep] = []
        self._has_new = False
        self._session = self._first = self._first_step = 0
        self._known_poses: FloatArray = np.empty((0, 3))
        self._start = self.T_map_base = SE2.identity()
        self._joiner: SessionJoiner | None = None
        self._is_joined, self._is_start_unknown, self._check_at = True, False, math.inf
        self._jumps = OdometryJumps()
        self._monitor = DriveMonitor(
            self.config.front_end.blind_m[0], self.config.is_odometry_doubted
        )

    @classmethod
    def continued(
        cls,
        slam_map: SlamMap,
        T_base_laser: SE2,
        start: SE2 | None = None,
        config: MapperConfig | None = None,
    ) -> Mapper:
        """A mapper whose next scan begins a new session on a map, somewhere on it or beside it.

        The session is joined with the map once its scans show where; one that never is makes a map
        that is called failed. start: pose of its first scan on the map, if known, within half a metre.
        Raises ValueError for a map with a session that was never joined, or no wall to search by.
        """
        if slam_map.unjoined:
            raise ValueError(
                f"session {slam_map.unjoined[0] + 1} of the map was never joined with those before"
                " it: continue the map as it was before that one"
            )
        mapper = cls(T_base_laser, config)
        mapper._begin_session(slam_map, start)
        return mapper

    def update(self, measurement: Measurement) -> MapperStep:
        """Places one scan, and closes the loops that it shows."""
        if self._session > 0 and len(self._steps) == self._first_step:
            # a session begins with its first scan, whatever the wheels did before
            measurement = replace(
                measurement, motion=SE2.identity(), motion_covariance=np.zeros((3, 3))
            )
        told, measurement = measurement, self._jumps.doubted(measurement)
        jump = told.motion if measurement is not told else None
        told_m2 = float(measurement.motion_covariance[0, 0])
        if self.config.is_odometry_doubted:
            measurement = replace(measurement, motion_covariance=_DOUBTED)
        T_before = self._front_end.T_map_base
        step = self._front_end.update(measurement, jump)  # match with what was seen last
        self._monitor.take(measurement, T_before, step, told_m2, jump is not None)
        if step.keyframe >= 0:
            step = replace(step, keyframe=self._first + step.keyframe)
        self._steps.append(replace(step, session=self._session))
        if step.is_keyframe:
            self._add_keyframe(self._front_end.keyframes[-1])
            self._tie_last()
        self._look_for_join()
        self.T_map_base = self._start @ step.T_map_base
        if step.keyframe >= 0:
            self.T_map_base = self._graph.pose(step.keyframe) @ step.T_keyframe_base
        return MapperStep(
            step.time_s, self.T_map_base, step.status, step.inlier_ratio, len(without_ties(self._graph.loops)),
            self._is_joined,
        )  # fmt: skip

    @property
    def points(self) -> FloatArray:
        """(N, 2) what the keyframes saw, from where their poses are now [m]: the map so far."""
        return points_seen(self._graph.keyframes, self._graph.poses)

    def finish(self) -> SlamMap:
        """All loops once more from where the poses are now, and all poses adjusted to the end.

        Where it is doubtful whether the map holds together, loops may be missing: each keyframe is
        asked, and less complete matches will do. What comes of it is kept if the map holds together
        better; a map that had failed is not acquitted by such loops alone.
        """
        self._look_for_join(is_end=True)
        self._rescale()
        self._put_strays_back()
        slam_map = self._held_together()
        said = self._monitor.objections(slam_map.steps, partial(self._between_m, slam_map))
        said = said or unknown_ways(slam_map, self._front_end, self._monitor.noise_ratio)
        if slam_map.verdict.is_good and not said:  # what broke off may be anywhere, and is told so
            said = too_far_adrift(slam_map.drift_m, slam_map.poses)
        return slam_map.objected(said)

    def _between_m(self, slam_map: SlamMap, one: int, other: int) -> float:
        """How sure a map is of how two keyframes of the session lie [m], other after one; not at all
        where loops to those between them, or beside, contradict the others: either may be false."""
        one, other, beside = self._first + one, self._first + other, self.config.consistency.beside
        ends = [end for loop in slam_map.rejected for end in (loop.earlier, loop.later)]
        if any(one - beside <= end <= other + beside for end in ends):
            return math.inf
        return between_m(slam_map.graph, one, other)

    def _rescale(self) -> None:
        """Takes the steps of the session by the wheels' scale that is known at its end."""
        front_end, graph = self._front_end, self._graph
        scale = front_end.wheel_scale.scale
        keyframes, poses = rescaled(graph.keyframes, front_end.scaled_steps, scale), graph.poses
        front_end.scaled_steps = [replace(step, scale=scale) for step in front_end.scaled_steps]
        if not graph.loops:
            poses = chained(keyframes, poses, self._first)
        graph.renew(keyframes, graph.loops, poses)

    def _put_strays_back(self) -> None:
        """Looks back at keyframes of the session that lie aside of the way."""
        graph, scaled = self._graph, self._front_end.scaled_steps
        if graph.loops:
            graph.solve()
        keyframes, loops, poses, strays = without_strays(
            graph.keyframes, graph.loops, graph.poses, self._front_end.told_steps, self.config.strays,
            self.config.front_end.surfaces,
        )  # fmt: skip
        for k in strays:  # these steps are the scans' alone, whatever the wheels' scale
            for at in (k, k + 1):
                step = scaled[at - self._first]
                scaled[at - self._first] = replace(step, slope=np.zeros(3))
        if strays:
            graph.renew(keyframes, loops, poses)

    def _held_together(self) -> SlamMap:
        """The map with all loops, and with laxer ones if those make it hold together better."""
        config = self.config
        slam_map = again = self._finished(self._closer, config.loops.every)
        first = slam_map.verdict
        is_sound = first.is_good and first.bad_pairs <= config.consistency.doubtful_pairs
        if is_sound or not self._graph.loops or not self._is_joined:
            return slam_map
        before = list(self._graph.loops), self._graph.poses.copy()
        loops = replace(config.loops, least_inlier_ratio=config.patient_inlier_ratio)
        closer = LoopCloser(loops, config.front_end.surfaces)
        for _ in range(config.patient_rounds):
            again = self._finished(closer, 1)
        if again.verdict.doubt < first.doubt:
            if first.is_good:
                return again
            told = again.keyframes, again.loops, again.rejected
            return replace(again, verdict=acquitted(again.verdict, *told, config.consistency))
        self._graph.renew(self._graph.keyframes, *before)
        return slam_map

    def _finished(self, closer: LoopCloser, every: int) -> SlamMap:
        """The map with the loops that a closer finds beside those known."""
        kept, rejected = self._graph.loops, list[Loop]()
        if self._graph.loops:
            kept, rejected = self._adjusted(closer, every)
            if not self._holds():
                self._unjoin()
                if self._graph.loops:
                    kept, rejected = self._adjusted(closer, every)
                else:
                    kept, rejected = [], []
        keyframes, poses = self._graph.keyframes.copy(), self._graph.poses
        if self._is_joined:
            poses = jointly_adjusted(
                keyframes, kept, poses, self.config.adjustment, self.config.front_end.surfaces
            )
        else:  # what was not joined is set against nothing, and moves nothing
            poses = np.concatenate([self._known_poses, poses[self._first :]])
        if 0 < self._first < len(keyframes):
            if not self._is_joined and self._is_start_unknown:
                poses = set_aside(keyframes, poses, self._first)
            before, after = SE2.from_array(poses[self._first - 1]), poses[self._first]
            keyframes[self._first] = replace(
                keyframes[self._first], T_before=before.inverse() @ SE2.from_array(after)
            )
        verdict = judged(keyframes, poses, kept, rejected, self.config.consistency)
        if self._first == len(keyframes) and len(self._steps) > self._first_step > 0:
            said = f"session {self._session + 1} has no scan that tells anything"
            verdict = replace(verdict, is_good=False, reasons=(*verdict.reasons, said))
        graph = graph_of(keyframes, (*kept, *rejected), poses, self.config.step_sigma)
        runs = self._front_end.loose_runs.ended
        steps = smoothed(self._steps, runs, self._first_step, keyframes, poses)
        for k, glances in enumerate(self._front_end.glances, start=self._first):
            if not keyframes[k].is_place_alone:
                keyframes[k] = replace(keyframes[k], glances=glances.kept)
        return SlamMap(
            tuple(keyframes), poses, tuple(kept), tuple(rejected), graph, tuple(steps), verdict,
        )  # fmt: skip

    def _adjusted(self, closer: LoopCloser, every: int) -> tuple[list[Loop], list[Loop]]:
        """Loops kept and rejected once all are found that there are, and all poses adjusted."""
        self._graph.solve()
        known = {(loop.earlier, loop.later) for loop in self._graph.loops}
        # those of the sessions before were asked when these ended
        asked = [k for k in range(len(self._graph.keyframes)) if k % every == 0]
        asked = [k for k in asked if k >= self._first]
        found = [loop for k in asked for loop in self._found(closer, k)]
        self._graph.take([one for one in found if (one.earlier, one.later) not in known])
        return self._graph.sorted_loops()

    def _begin_session(self, slam_map: SlamMap, start: SE2 | None) -> None:
        """Takes over all that was mapped before."""
        self._steps = list(slam_map.steps)
        self._first, self._first_step = len(slam_map.keyframes), len(self._steps)
        self._known_poses = slam_map.poses
        self._session = slam_map.session_count
        loops = [*slam_map.loops, *slam_map.rejected]
        self._graph.renew(list(slam_map.keyframes), loops, slam_map.poses)
        if self._graph.keyframes:
            self._is_joined, self._is_start_unknown = False, start is None
            self._start = start or SE2.identity()
            self._joiner = SessionJoiner(
                self._graph.keyframes,
                slam_map.poses,
                self._closer,
                start is not None,
                self.config.joining,
            )

    def _add_keyframe(self, keyframe: Keyframe) -> None:
        """Notes where the keyframe is seen from the last one, and the loops that it closes."""
        config, index = self.config, len(self._graph)
        keyframe = self._of_session(keyframe, index)
        self._graph.add(keyframe)
        every = config.loops.every
        if index % every == 0 and (
            index % (every * config.crowd_every) == 0 or not self._is_crowded(index)
        ):
            found = self._found(self._closer, index)
            if found:
                self._graph.take(found)
                self._has_new = True
        if self._has_new and index % config.solve_every == 0:
            self._graph.solve(config.online_iterations)
            self._has_new = False
        if self._is_joined:
            self._thin_crowd(index - 2 * config.front_end.window)
        if index >= self._check_at:
            self._check_at = index + 2 * (index - self._first)
            if not self._holds(config.joining.most_checked):
                self._unjoin()

    def _tie_last(self) -> None:
        """Ties the last keyframe to the one before those that left open how far the robot went, if
        the front end did; these go with it, on the map as there."""
        front_end, graph = self._front_end, self._graph
        if not front_end.ties or front_end.ties[-1].later != len(front_end.keyframes) - 1:
            return
        tie, poses = front_end.ties[-1], graph.poses
        placed = [one.T_map_base for one in front_end.keyframes[tie.earlier :]]
        first = self._first + tie.earlier
        T_map_session = graph.pose(first) @ placed[0].inverse()
        poses[first:] = [(T_map_session @ pose).as_array() for pose in placed]
        graph.set_poses(poses)
        graph.take([replace(tie, earlier=first, later=self._first + tie.later)])
        self._has_new = True

    def _thin_crowd(self, index: int) -> None:
        """Keeps no more than the place of a keyframe, where others saw enough of what it saw."""
        if index >= self._first and self._is_crowded(index):
            self._graph.keyframes[index] = self._graph.keyframes[index].place_alone()
            self._front_end.keep_place_alone(index - self._first)

    def _is_crowded(self, index: int) -> bool:
        """Whether there are scans enough from about where a keyframe is."""
        config = self.config
        off = self._graph.poses - self._graph.pose(index).as_array()
        is_near = np.hypot(off[:, 0], off[:, 1]) < config.crowd_m
        is_near &= np.abs(wrap_angle(off[:, 2])) < config.crowd_rad
        has_scan = (not self._graph.keyframes[k].is_place_alone for k in np.flatnonzero(is_near))
        return sum(has_scan) > config.crowd

    def _of_session(self, keyframe: Keyframe, index: int) -> Keyframe:
        """The keyframe with its session; the first of one is seen from no other."""
        keyframe = replace(keyframe, session=self._session)
        if index != self._first:
            return keyframe
        back = keyframe.T_map_base.inverse()
        for at in range(self._first_step, len(self._steps)):  # scans before, which told nothing
            step = self._steps[at]
            self._steps[at] = replace(step, keyframe=index, T_keyframe_base=back @ step.T_map_base)
        if index == 0:
            return keyframe
        way = self._graph.pose(index - 1).inverse() @ self._start @ keyframe.T_map_base
        return replace(keyframe, T_before=way, covariance=_ANYWHERE, is_break=True)

    @property
    def _comparable(self) -> range | None:
        """The keyframes of which it is known where they lie as seen from the last one; None: all."""
        return None if self._is_joined else range(self._first, len(self._graph.keyframes))

    def _look_for_join(self, is_end: bool = False) -> None:
        """Joins the session with the map, if its keyframes show where it lies; is_end: no scan waits."""
        if self._joiner is None or self._is_joined:
            return
        poses = self._graph.poses
        time_s = math.inf if is_end else self._front_end.usual_interval_s
        join = self._joiner.look(self._graph.keyframes, poses, time_s)
        if join is None:
            return
        self._graph.set_poses(join.moved(poses, self._first))
        self._graph.take(join.loops)
        self._graph.solve(self.config.online_iterations)  # from now on they tell how far things are
        self._is_joined = True
        self._check_at = len(self._graph.keyframes) - 1 + self.config.joining.first_check

    def _holds(self, most_pairs: int | None = None) -> bool:
        """Whether the session's scans may have been taken where it was joined with the map."""
        if self._joiner is None or not self._is_joined:
            return True
        against = self.config.joining.against
        if most_pairs is not None:
            against = replace(against, most_pairs=most_pairs)
        return not do_contradict(self._graph.keyframes, self._graph.poses, self._first, against)

    def _unjoin(self) -> None:
        """Takes back a join that was wrong: the session is a piece of its own again."""
        assert self._joiner is not None
        first = self._first
        loops = [one for one in self._graph.loops if not one.earlier < first <= one.later]
        self._graph.renew(self._graph.keyframes, loops, self._graph.poses)
        self._joiner.reject()
        self._is_joined, self._check_at = False, math.inf

    def _found(self, closer: LoopCloser, index: int) -> list[Loop]:
        """The loops that a keyframe closes; looked for as far as it may have drifted on the way from
        each of the others, by way of the loops that are known."""
        config, graph = self.config, self._graph
        ways_m, most_m = graph.ways_m(index), config.most_drift[0]
        sigma_m = np.minimum(config.start_m + config.drift_m * ways_m, most_m)
        sigma_rad = np.minimum(config.start_rad + config.drift_rad * ways_m, config.most_drift[1])
        return closer.found(
            graph.keyframes, graph.poses, [index], (sigma_m, sigma_rad), self._comparable
        )

"""Self-localisation and mapping (Fig. 3): scans placed one by one, loops closed, poses adjusted."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np

from slam.arrays import FloatArray
from slam.backend.joint_adjustment import jointly_adjusted
from slam.backend.keyframe_graph import KeyframeGraph
from slam.backend.looseness import Looseness
from slam.backend.map_session import MapSession, objections_of_drives
from slam.backend.rescaling import chained, rescaled
from slam.frontend.front_end import FrontEnd
from slam.frontend.keyframes import FrontEndStep, Keyframe, StepStatus
from slam.frontend.loose_runs import smoothed
from slam.frontend.odometry_jumps import OdometryJumps
from slam.frontend.strays import ToldStep, may_have_strayed, told_step
from slam.loop_closing import Loop, LoopCloser
from slam.map_checks.breaks_borne_out import BreaksBorneOut
from slam.map_checks.drive_monitor import DriveMonitor
from slam.map_checks.followers import with_followers_left
from slam.map_checks.hanging_pieces import hanging_pieces
from slam.map_checks.jumped_scans import has_jumped_alone, with_jumped_put_back
from slam.map_checks.lone_loops import breaks_in_doubt
from slam.map_checks.map_consistency import acquitted, judged
from slam.map_checks.map_drift import too_far_adrift
from slam.map_checks.moved_things import moved_things
from slam.map_checks.open_ways import unknown_ways
from slam.map_checks.range_offset import said_of_ranges
from slam.map_checks.scan_places import unknown_places
from slam.map_checks.shown_jumps import shown_jumps
from slam.map_checks.stray_scans import with_scans_put_back
from slam.map_checks.there_and_back import put_strays_back
from slam.map_checks.weak_steps import WeakSteps
from slam.map_checks.wheels_borne_out import believe_where_borne_out, shown_noise, told_to_keyframes
from slam.mapper_config import MapperConfig
from slam.measurements import Measurement
from slam.records import record
from slam.se2 import SE2
from slam.slam_map import SlamMap, graph_of, points_seen

_DOUBTED = np.eye(3)
"""Of a motion [m, rad] that is told, and not believed; chosen: hardly a robot goes as far from one scan
to the next."""


@record
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
        self._session = MapSession(self._graph, self.config)
        self.T_map_base = SE2.identity()
        self._known_objections: list[str] = []
        self._told, self._weak_steps = list[ToldStep](), WeakSteps()
        self._breaks = BreaksBorneOut(self.config.front_end.break_sigma, self.config.step_sigma)
        self._jumps = OdometryJumps()
        self._monitor = DriveMonitor(self.config.front_end.blind_m[0])

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
        mapper._steps = list(slam_map.steps)
        loops = [*slam_map.loops, *slam_map.rejected]
        mapper._graph.renew(list(slam_map.keyframes), loops, slam_map.poses)
        is_open = {step.keyframe for step in slam_map.steps if step.is_keyframe and step.is_open}
        mapper._graph.looseness = Looseness(slam_map.keyframes, is_open)
        mapper._session = MapSession.after(
            slam_map, start, mapper._graph, mapper._closer, mapper.config
        )
        mapper.T_map_base = mapper._session.start
        mapper._known_objections = objections_of_drives(slam_map, mapper.config)
        return mapper

    def update(self, measurement: Measurement) -> MapperStep:
        """Places one scan, and closes the loops that it shows."""
        if self._session.number > 0 and len(self._steps) == self._session.first_step:
            # a session begins with its first scan, whatever the wheels did before
            measurement = replace(
                measurement, motion=SE2.identity(), motion_covariance=np.zeros((3, 3))
            )
        measurement = measurement.shortened(self.config.range_offset_m)
        is_blind = bool(self._steps) and self._steps[-1].status is StepStatus.CARRIED
        judged_motion = self._jumps.judged(measurement, is_blind)
        measurement, other = judged_motion.measurement, judged_motion.other
        told_m2 = float(measurement.motion_covariance[0, 0])
        told = told_step(measurement, self.config.front_end.step_sigma)
        if self.config.is_odometry_doubted:
            measurement = replace(measurement, motion_covariance=_DOUBTED)
        T_before = self._front_end.T_map_base
        step = self._front_end.update(measurement, other)  # match with what was seen last
        self._monitor.take(measurement, T_before, step, told_m2, judged_motion.has_jumped)
        if self._session.first > 0 or self._session.number > 0:
            keyframe = self._session.first + step.keyframe if step.keyframe >= 0 else step.keyframe
            step = replace(step, keyframe=keyframe, session=self._session.number)
        self._steps.append(step)
        self._told.append(told)
        if step.is_keyframe:
            self._add_keyframe(self._front_end.keyframes[-1], step.is_open)
        self._session.look_for_join(self._front_end.usual_interval_s)
        self.T_map_base = self._session.start @ step.T_map_base
        if step.keyframe >= 0:
            self.T_map_base = self._graph.pose(step.keyframe) @ step.T_keyframe_base
        return MapperStep(
            step.time_s, self.T_map_base, step.status, step.inlier_ratio, self._graph.loop_count,
            self._session.is_joined,
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
        self._session.look_for_join(math.inf)
        self._rescale()
        if self.config.is_odometry_doubted:
            own = self._steps[self._session.first_step :]
            believe_where_borne_out(self._graph, self._front_end, own, self._told)
        else:
            self._weak_steps.loosen(self._graph, self._front_end, self._steps, self._closer)
        self._put_strays_back()
        if not self._session.is_joined:
            self._breaks.leave_apart(self._session.first)
        if not self.config.is_odometry_doubted:
            self._breaks.believe(self._graph, self._front_end.told_steps)
        slam_map = self._held_together()
        first_step, poses = self._session.first_step, slam_map.poses
        has_jumped = has_jumped_alone(slam_map.steps, first_step, self._told, poses)
        # what lies beside a stray is where it belongs by now
        if self._session.is_joined and has_jumped and self._put_strays_back():
            slam_map = self._held_together()
        said = self._monitor.objections(slam_map.steps, partial(self._session.between_m, slam_map))
        own = self._steps[self._session.first_step :]
        said += self._jumps.objections(own, self.config.is_odometry_doubted)
        said = said or unknown_ways(slam_map, self._front_end, self._monitor.noise_ratio)
        said = said or shown_jumps(slam_map.keyframes, slam_map.poses, self._front_end.told_steps)
        said = said or moved_things(slam_map, self.config.front_end)
        if not said:  # what the map itself is failed for, a later session may mend, and this not
            said = unknown_places(
                slam_map, self._session.first_step, self._told, self._front_end.wheel_scale,
                self.config.is_odometry_doubted,
            )  # fmt: skip
            said = said or too_far_adrift(slam_map.drift_m, slam_map.poses)
            said = said or hanging_pieces(slam_map, self.config.front_end.break_sigma)
            if not self.config.is_odometry_doubted:
                said = said or breaks_in_doubt(slam_map, self._front_end.told_steps, self.config)
        said += said_of_ranges(slam_map.keyframes, slam_map.poses)
        return slam_map.objected([*self._known_objections, *said])

    def _rescale(self) -> None:
        """Takes the steps of the session by the wheels' scale that is known at its end."""
        front_end, graph = self._front_end, self._graph
        scale = front_end.wheel_scale.scale
        keyframes, poses = rescaled(graph.keyframes, front_end.scaled_steps, scale), graph.poses
        front_end.scaled_steps = [replace(step, scale=scale) for step in front_end.scaled_steps]
        if not graph.loops:
            poses = chained(keyframes, poses, self._session.first)
        graph.renew(keyframes, graph.loops, poses)

    def _put_strays_back(self) -> bool:
        """Looks back at keyframes of the session that lie aside of the way; whether any was put back."""
        front_end, first, config = self._front_end, self._session.first, self.config
        by_wheels = told = front_end.told_steps
        if config.is_odometry_doubted:
            by_wheels = told_to_keyframes(self._steps[self._session.first_step :], self._told)
        strays = put_strays_back(
            self._graph, told, by_wheels, config.strays, config.front_end.surfaces
        )
        self._leave_followers(strays)
        # these steps are no longer by the wheels' scale
        for at in {own for k in strays for own in (k - first, k + 1 - first)}:
            front_end.scaled_steps[at] = replace(front_end.scaled_steps[at], slope=np.zeros(3))
        return bool(strays)

    def _leave_followers(self, moved: dict[int, SE2]) -> None:
        """Has scans stay that were seen from keyframes that moved, where these alone were drawn aside."""
        if not moved:
            return
        glances, first_step = self._front_end.glances, self._session.first_step
        wheels = self._front_end.wheel_scale
        told = [replace(one, motion=wheels.scaled(one.motion)) for one in self._told]
        left = with_followers_left(self._steps, first_step, told, self._graph.poses, moved)
        for k in moved:
            ways = {
                one.T_keyframe_base: other.T_keyframe_base
                for one, other in zip(self._steps, left, strict=True)
                if one is not other and one.keyframe == k
            }
            glances[k - self._session.first].move(ways)
        self._steps = left

    def _held_together(self) -> SlamMap:
        """The map with all loops, and with laxer ones if those make it hold together better."""
        config = self.config
        slam_map = again = self._finished(self._closer, config.loops.every)
        first = slam_map.verdict
        is_sound = first.is_good and first.bad_pairs <= config.consistency.doubtful_pairs
        if is_sound or not self._graph.loops or not self._session.is_joined:
            return slam_map
        before = list(self._graph.loops), self._graph.poses.copy()
        loops = replace(config.loops, least_inlier_ratio=config.patient_inlier_ratio)
        closer = LoopCloser(loops, config.front_end.surfaces)
        closer.doubted = self._closer.doubted
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
        session, kept, rejected = self._session, self._graph.loops, list[Loop]()
        if self._graph.loops or closer.doubted:  # all of them may have been let go
            kept, rejected = self._adjusted(closer, every)
            if not self._session.holds():
                self._session.unjoin()
                self._breaks.leave_apart(self._session.first)
                if self._graph.loops:
                    kept, rejected = self._adjusted(closer, every)
                else:
                    kept, rejected = [], []
        keyframes, poses = self._graph.keyframes.copy(), self._graph.poses
        if session.is_joined:
            poses = jointly_adjusted(
                keyframes, kept, poses, self.config.adjustment, self.config.front_end.surfaces
            )
        else:
            poses = session.kept_apart(poses)
        poses = session.set_beside(keyframes, poses)
        verdict = judged(keyframes, poses, kept, rejected, self.config.consistency)
        verdict = verdict.with_reasons(session.objections(keyframes, self._steps))
        graph = graph_of(keyframes, (*kept, *rejected), poses, self.config.step_sigma)
        runs = self._front_end.loose_runs.ended
        first_step = self._session.first_step
        placed = smoothed(self._steps, runs, first_step, keyframes, poses)
        wheel_scale = self._front_end.wheel_scale
        is_doubted, told = self.config.is_odometry_doubted, self._front_end.told_steps
        noise = None if is_doubted else shown_noise(keyframes, poses, told, least=0.0)
        steps = with_scans_put_back(
            placed, first_step, self._told, wheel_scale, poses, is_doubted, noise
        )
        glances = dict(enumerate(self._front_end.glances, start=session.first))
        steps = with_jumped_put_back(
            steps, first_step, self._told, keyframes, poses,
            {k: since.kept for k, since in glances.items()}, self.config.front_end.surfaces,
            self.config.strays,
        )  # fmt: skip
        strayed = {
            one.T_keyframe_base
            for one, other in zip(placed, steps, strict=True)
            if one is not other
        }
        for k, since in glances.items():
            if not keyframes[k].is_place_alone:
                keyframes[k] = replace(keyframes[k], glances=since.kept_but(strayed))
        return SlamMap(
            tuple(keyframes), poses, tuple(kept), tuple(rejected), graph, tuple(steps), verdict,
        )  # fmt: skip

    def _adjusted(self, closer: LoopCloser, every: int) -> tuple[list[Loop], list[Loop]]:
        """Loops kept and rejected once all are found that there are, and all poses adjusted."""
        self._graph.solve()
        loops = (*self._graph.loops, *self._breaks.let_go)
        known = {(loop.earlier, loop.later) for loop in loops}
        # those of the sessions before were asked when these ended
        asked = [k for k in range(len(self._graph.keyframes)) if k % every == 0]
        asked = [k for k in asked if k >= self._session.first]
        found = [loop for k in asked for loop in self._found(closer, k)]
        self._graph.take([one for one in found if (one.earlier, one.later) not in known])
        if self.config.is_odometry_doubted:
            return self._graph.sorted_loops()
        return self._breaks.sorted_loops(self._graph, self._front_end.told_steps)

    def _add_keyframe(self, keyframe: Keyframe, is_open: bool) -> None:
        """Notes where the keyframe is seen from the last one, and the loops that it closes."""
        config, index = self.config, len(self._graph)
        if index == self._session.first:
            self._place_before(keyframe)
        self._graph.add(self._session.own(keyframe), is_open)
        self._tie_last()
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
        if self._session.is_joined:
            self._thin_crowd(index - 2 * config.front_end.window)
        self._session.check()

    def _tie_last(self) -> None:
        """Ties the last keyframe to the one before those that left open how far the robot went, if
        the front end did; these go with it, on the map as there."""
        front_end, graph = self._front_end, self._graph
        if not front_end.ties or front_end.ties[-1].later != len(front_end.keyframes) - 1:
            return
        tie, poses = front_end.ties[-1], graph.poses
        placed = [one.T_map_base for one in front_end.keyframes[tie.earlier :]]
        first = self._session.first + tie.earlier
        T_map_session = graph.pose(first) @ placed[0].inverse()
        poses[first:] = [(T_map_session @ pose).as_array() for pose in placed]
        graph.set_poses(poses)
        graph.take([replace(tie, earlier=first, later=self._session.first + tie.later)])
        self._has_new = True

    def _thin_crowd(self, index: int) -> None:
        """Keeps no more than the place of a keyframe, where others saw enough of what it saw; not of one
        that may have strayed: its scan may be asked once more."""
        graph, front_end, strays = self._graph, self._front_end, self.config.strays
        if index < self._session.first or not self._is_crowded(index):
            return
        if may_have_strayed(graph.keyframes, graph.poses, index, front_end.told_steps, strays):
            return
        graph.keyframes[index] = graph.keyframes[index].place_alone()
        front_end.keep_place_alone(index - self._session.first)

    def _is_crowded(self, index: int) -> bool:
        """Whether there are scans enough from about where a keyframe is."""
        config = self.config
        return self._graph.is_crowded(index, (config.crowd_m, config.crowd_rad), config.crowd)

    def _place_before(self, keyframe: Keyframe) -> None:
        """Has the session's scans before its first keyframe, which told nothing, seen from that."""
        back, first = keyframe.T_map_base.inverse(), self._session.first
        for at in range(self._session.first_step, len(self._steps)):
            step = self._steps[at]
            self._steps[at] = replace(step, keyframe=first, T_keyframe_base=back @ step.T_map_base)

    def _found(self, closer: LoopCloser, index: int) -> list[Loop]:
        """The loops that a keyframe closes; looked for as far as it may have drifted on the way from
        each of the others, by way of the loops that are known."""
        config, graph = self.config, self._graph
        ways_m, most_m = graph.ways_m(index), config.most_drift[0]
        sigma_m = np.minimum(config.start_m + config.drift_m * ways_m, most_m)
        sigma_rad = np.minimum(config.start_rad + config.drift_rad * ways_m, config.most_drift[1])
        return closer.found(
            graph.keyframes, graph.poses, [index], (sigma_m, sigma_rad), self._session.comparable,
            graph.looseness.sigmas_m,
        )  # fmt: skip

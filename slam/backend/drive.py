"""One drive while a map is made of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from slam.backend.keyframe_graph import KeyframeGraph
from slam.backend.looseness import Looseness
from slam.backend.map_session import MapSession
from slam.backend.second_look import SecondLook
from slam.frontend.front_end import FrontEnd
from slam.frontend.keyframes import FrontEndStep, FrontEndSteps, Keyframe
from slam.frontend.loose_runs import smooth
from slam.frontend.odometry_jumps import OdometryJumps
from slam.frontend.strays import may_have_strayed
from slam.frontend.told_steps import ToldStep, ToldSteps
from slam.loop_closing import Loop, LoopCloser
from slam.map_checks.breaks_borne_out import BreaksBorneOut
from slam.map_checks.drive_monitor import DriveMonitor
from slam.map_checks.weak_steps import WeakSteps
from slam.mapper_config import MapperConfig
from slam.packed import Seen
from slam.se2 import SE2
from slam.slam_map import SlamMap


class Drive:
    """Where a drive's scans were placed, how its keyframes lie among all of a map's, and what was
    noticed on the way.

    steps: every scan of the map, those of sessions before first; told: what wheels told of each of
    the drive's own.
    """

    def __init__(self, T_base_laser: SE2, config: MapperConfig) -> None:
        self.config = config
        self.front_end = FrontEnd(T_base_laser, config.front_end)
        self.closer = LoopCloser(config.loops, config.front_end.surfaces)
        self.graph = KeyframeGraph(config.step_sigma, config.recent)
        self.session = MapSession(self.graph, config)
        self.steps, self.told = FrontEndSteps(), ToldSteps()
        self.weak_steps = WeakSteps()
        self.breaks = BreaksBorneOut(config.front_end.break_sigma, config.step_sigma)
        self.jumps = OdometryJumps()
        self._second_look = SecondLook(config.recent, config.strays, config.front_end.surfaces)
        self.monitor = DriveMonitor(config.front_end.blind_m[0])

    def follow(self, slam_map: SlamMap, start: SE2 | None) -> None:
        """Begins on a map, before its first scan, from a pose there if one is known.

        Raises ValueError for a map without a wall, if it is not.
        """
        self.steps = FrontEndSteps(slam_map.steps)
        loops = [*slam_map.loops, *slam_map.rejected]
        self.graph.renew(list(slam_map.keyframes), loops, slam_map.poses)
        is_open = {step.keyframe for step in slam_map.steps if step.is_keyframe and step.is_open}
        self.graph.looseness = Looseness(slam_map.keyframes, is_open)
        self.session = MapSession.after(slam_map, start, self.graph, self.closer, self.config)
        self.front_end.session = self.session.number
        # the last ones, which the drive before still matched with
        first = self.session.first
        for k in range(max(first - 2 * self.config.front_end.window, 0), first):
            if self._is_crowded(k, range(k + 1)):
                self.graph.keep_place_alone(k)

    @property
    def own_steps(self) -> Sequence[FrontEndStep]:
        """The scans of the drive itself."""
        return self.steps[self.session.first_step :]

    @property
    def told_to_keyframes(self) -> Sequence[ToldStep]:
        """By the wheels to each keyframe of the drive from the one before, as they are now."""
        own = range(self.session.first, len(self.graph))
        return Seen(self.graph.keyframes, own, lambda one: one.told)

    @property
    def is_later(self) -> bool:
        """Whether a map was known before it: its scans may not have been kept."""
        return self.session.number > 0 or self.session.first > 0

    def take(self, step: FrontEndStep, told: ToldStep) -> FrontEndStep:
        """Notes a scan that the front end placed, and what wheels told of the way to it; the scan, as
        one of all of the map."""
        session = self.session
        if self.is_later:
            keyframe = session.first + step.keyframe if step.keyframe >= 0 else step.keyframe
            step = replace(step, keyframe=keyframe, session=session.number)
        self.steps.append(step)
        self.told.append(told)
        return step

    def pose_of(self, step: FrontEndStep) -> SE2:
        """Where a scan was taken, by what is known by now."""
        if step.keyframe < 0:
            return self.session.start @ step.T_map_base
        return self.graph.pose(step.keyframe) @ step.T_keyframe_base

    def add_keyframe(self, keyframe: Keyframe, is_open: bool) -> bool:
        """One keyframe more, where its step leads from the last one; is_open: it leaves open how far
        along that is. Whether something else tells of its place."""
        if len(self.graph) == self.session.first:
            self._place_before(keyframe)
        self.graph.add(self.session.own(keyframe), is_open)
        return self._tie_last()

    def loops_of(self, index: int, closer: LoopCloser) -> list[Loop]:
        """The loops that a keyframe closes; looked for as far as it may have drifted on the way from
        each of the others, by way of the loops that are known."""
        return closer.found(
            self.graph.keyframes, self.graph.poses, [index],
            self.config.drifted(self.graph.ways_m(index)), self.session.comparable,
            self.graph.looseness.sigmas_m,
        )  # fmt: skip

    def is_crowded(self, index: int) -> bool:
        """Whether there are scans enough from about where a keyframe is."""
        return self._is_crowded(index, self.session.comparable or range(len(self.graph)))

    def thin_crowd(self, index: int) -> None:
        """Keeps no more than the place of a keyframe, where others saw enough of what it saw; not of one
        that may have strayed: its scan may be asked once more."""
        graph, session = self.graph, self.session
        if not session.first <= index < session.asked_from or not self.is_crowded(index):
            return
        told, strays = self.told_to_keyframes, self.config.strays
        if not may_have_strayed(graph.keyframes, graph.poses, index, told, strays):
            self._keep_place_alone(index)

    def look_again(self) -> None:
        """Keeps no more than the place of a keyframe of long ago, if others saw enough, where it has not strayed
        though it might have."""
        graph, told = self.graph, self.told_to_keyframes
        k = self._second_look.next(graph.keyframes, graph.poses, told, self._is_needless)
        if k is not None:
            self._keep_place_alone(k)

    def _is_needless(self, index: int) -> bool:
        """Whether scans before it saw what a keyframe saw: what was seen first stays, however often it is seen
        again."""
        session = self.session
        is_asked = session.first <= index < session.asked_from
        if not (is_asked and self.graph.keyframes.has_scan(index)):
            return False
        return self._is_crowded(index, range(0 if session.is_joined else session.first, index + 1))

    def _is_crowded(self, index: int, by: range) -> bool:
        config = self.config
        near = config.crowd_m, config.crowd_rad
        return self.graph.is_crowded(index, near, config.crowd, by)

    def _keep_place_alone(self, index: int) -> None:
        self.graph.keep_place_alone(index)
        self.front_end.keep_place_alone(index - self.session.first)

    def let_go(self) -> None:
        """Lets go of keyframes of long ago, where others saw what they saw: see `OlderKeyframes`."""
        graph, session, front_end = self.graph, self.session, self.front_end
        remaining = graph.remaining({session.first + k for k in self.monitor.keyframes})
        if remaining is None:
            return
        runs = front_end.loose_runs.settled(self.steps, session.first_step, remaining)
        smooth(self.steps, runs, session.first_step, graph.keyframes, graph.poses)
        own = remaining.after(session.first)
        self.steps.renumber(remaining, graph.poses)
        graph.renumber(remaining)
        front_end.renumber(own)
        self.monitor.renumber(own)
        session.renumber(remaining)
        self.weak_steps.renumber(remaining)
        self.breaks.renumber(remaining)

    def _place_before(self, keyframe: Keyframe) -> None:
        """Has the drive's scans before its first keyframe, which told nothing, seen from that."""
        back, first = keyframe.T_map_base.inverse(), self.session.first
        for at in range(self.session.first_step, len(self.steps)):
            step = self.steps[at]
            T_keyframe_base = back @ step.T_map_base
            self.steps[at] = replace(step, keyframe=first, T_keyframe_base=T_keyframe_base)

    def _tie_last(self) -> bool:
        """Ties the last keyframe to the one before those that left open how far the robot went, if
        the front end did; these go with it, on the map as there. Whether it was."""
        front_end, graph, first = self.front_end, self.graph, self.session.first
        if not front_end.ties or front_end.ties[-1].later != len(front_end.keyframes) - 1:
            return False
        tie, poses = front_end.ties[-1], graph.poses
        placed = [one.T_map_base for one in front_end.keyframes[tie.earlier :]]
        earlier = first + tie.earlier
        T_map_session = graph.pose(earlier) @ placed[0].inverse()
        poses[earlier:] = [(T_map_session @ pose).as_array() for pose in placed]
        graph.set_poses(poses)
        graph.take([replace(tie, earlier=earlier, later=first + tie.later)])
        return True

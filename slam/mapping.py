"""Self-localisation and mapping (Fig. 3): scans placed one by one, loops closed, poses adjusted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray
from slam.backend.drive import Drive
from slam.backend.finishing import held_together
from slam.backend.hindsight import look_back, right_strays_beside
from slam.backend.objections import objections_of_drives, objections_to
from slam.frontend.keyframes import Keyframe, StepStatus
from slam.frontend.told_steps import told_step
from slam.mapper_config import MapperConfig
from slam.measurements import Measurement
from slam.records import record
from slam.se2 import SE2
from slam.slam_map import SlamMap, points_seen

_DOUBTED = np.eye(3)
"""Of a motion [m, rad] that is told, and not believed; chosen: hardly a robot goes as far from one scan
to the next."""


@record
class MapperStep:
    """One scan, placed: the pose on the map as it is so far, and how it was found. loops: among the keyframes that
    are kept by now.

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
        self._drive = Drive(T_base_laser, config or MapperConfig())
        self._has_new = False
        self.T_map_base = SE2.identity()
        self._known_objections: list[str] = []

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
        Raises ValueError for a map with a session that was never joined, with nothing on it, or no wall
        to search by.
        """
        if not slam_map.keyframes:
            raise ValueError("nothing is on the map: there is no place to continue it from")
        if slam_map.unjoined:
            raise ValueError(
                f"session {slam_map.unjoined[0] + 1} of the map was never joined with those before"
                " it: continue the map as it was before that one"
            )
        mapper = cls(T_base_laser, config)
        mapper._drive.follow(slam_map, start)
        mapper.T_map_base = mapper._drive.session.start
        mapper._known_objections = objections_of_drives(slam_map, mapper.config)
        return mapper

    @property
    def config(self) -> MapperConfig:
        """How it works."""
        return self._drive.config

    def update(self, measurement: Measurement) -> MapperStep:
        """Places one scan, and closes the loops that it shows: the steps of Fig. 3."""
        drive = self._drive
        if drive.is_later and not drive.told:
            # a session begins with its first scan, whatever the wheels did before
            measurement = replace(
                measurement, motion=SE2.identity(), motion_covariance=np.zeros((3, 3))
            )
        measurement = measurement.shortened(self.config.range_offset_m)
        is_blind = bool(drive.steps) and drive.steps[-1].status is StepStatus.CARRIED
        judged_motion = drive.jumps.judged(measurement, is_blind)  # step 1: odometry, if believed
        measurement, other = judged_motion.measurement, judged_motion.other
        told_m2 = float(measurement.motion_covariance[0, 0])
        told = told_step(measurement, self.config.front_end.step_sigma)
        if self.config.is_odometry_doubted:
            measurement = replace(measurement, motion_covariance=_DOUBTED)
        T_before = drive.front_end.T_map_base
        # steps 2 to 7: related with what was seen last, matched until settled; and a verdict on it
        step = drive.front_end.update(measurement, other)
        drive.monitor.take(measurement, T_before, step, told_m2, judged_motion.has_jumped)
        step = drive.take(step, told)
        if step.is_keyframe:  # step 8: the map, and the loops that it closes
            self._add_keyframe(drive.front_end.keyframes[-1], step.is_open)
        drive.session.look_for_join(drive.front_end.usual_interval_s)
        self.T_map_base = drive.pose_of(step)
        if step.is_keyframe:
            drive.let_go()
        return MapperStep(
            step.time_s, self.T_map_base, step.status, step.inlier_ratio, drive.graph.loop_count,
            drive.session.is_joined,
        )  # fmt: skip

    @property
    def keyframes(self) -> Sequence[Keyframe]:
        """Those that the map is made of so far, of sessions before too; of some no more than the place is kept."""
        return self._drive.graph.keyframes

    @property
    def points(self) -> FloatArray:
        """(N, 2) what the keyframes saw, from where their poses are now [m]: the map so far."""
        graph = self._drive.graph
        return points_seen(graph.keyframes, graph.poses)

    def finish(self) -> SlamMap:
        """The map: all loops once more from where the poses are now, all poses adjusted to the end, and
        what the drive says against it."""
        drive = self._drive
        drive.session.look_for_join(math.inf)
        look_back(drive)
        slam_map = held_together(drive)
        if right_strays_beside(drive, slam_map):
            slam_map = held_together(drive)
        return slam_map.objected([*self._known_objections, *objections_to(slam_map, drive)])

    def _add_keyframe(self, keyframe: Keyframe, is_open: bool) -> None:
        """Notes where the keyframe is seen from the last one, and the loops that it closes."""
        config, drive = self.config, self._drive
        self._has_new |= drive.add_keyframe(keyframe, is_open)
        index = len(drive.graph) - 1
        every = config.loops.every
        if index % every == 0 and (
            index % (every * config.crowd_every) == 0 or not drive.is_crowded(index)
        ):
            found = drive.loops_of(index, drive.closer)
            drive.graph.take(found)
            self._has_new |= bool(found)
        if self._has_new and index % config.solve_every == 0:
            drive.graph.adjust(config.online_iterations)
            self._has_new = False
        drive.thin_crowd(index - 2 * config.front_end.window)
        drive.look_again()
        drive.session.check()

"""The front end of mapping: each scan matched with the surfaces seen last, keyframe by keyframe."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray, diagonal_of
from slam.beams import Beams
from slam.frontend.constant_velocity import ConstantVelocity, coasting_covariance
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.kept_keyframes import Keyframes
from slam.frontend.keyframes import FrontEndStep, Keyframe, StepStatus
from slam.frontend.loose_runs import LooseRuns
from slam.frontend.open_matches import is_one_place
from slam.frontend.open_runs import OpenRun
from slam.frontend.people_along import PeopleAlong
from slam.frontend.placing import Placing
from slam.frontend.prediction import Prediction, is_told
from slam.frontend.remaining import Remaining
from slam.frontend.seen_before import LastSeen
from slam.frontend.strays import apart_m
from slam.frontend.told_steps import ToldStep, told_step
from slam.frontend.wheel_scale import ScaledStep, ScaledSteps, WheelScale
from slam.kernels.normal_equations import inverse_of
from slam.loop_closing import Loop
from slam.measurements import Measurement
from slam.se2 import SE2
from slam.straightening import Straightener
from slam.surface.surface_map import faced_ends
from slam.surface.surface_match import SurfaceMatch
from slam.surface.surface_window import SurfaceWindow
from slam.surface.views import Glances

_NONE = Glances()
"""Of all keyframes of which the place alone is kept: nothing is put in any more."""


class FrontEnd:
    """Follows the robot through an unknown place, and picks the keyframes; session: of which these are."""

    def __init__(self, T_base_laser: SE2, config: FrontEndConfig | None = None) -> None:
        self.config = config or FrontEndConfig()
        self.session = 0
        self.keyframes = Keyframes()
        self.glances: list[Glances] = []
        self.wheel_scale = WheelScale(self.config.wheel_scale)
        self.scaled_steps = ScaledSteps()
        self.loose_runs, self._scans = LooseRuns(), 0
        self.T_map_base = SE2.identity()
        self.ties: list[Loop] = []
        self._window = SurfaceWindow(self.config.window, self.config.surfaces)
        last = LastSeen(self._window.surfaces, self.keyframes, self.config)
        self._placing, self._people = Placing(last, self.config), PeopleAlong(last)
        self._open_run = OpenRun(self.config)
        self._straightener = Straightener(T_base_laser)
        self._P: FloatArray = np.zeros((3, 3))
        self._told = ToldStep.none()
        self._blind_m, self._elapsed_s, self._last_s = 0.0, math.inf, -math.inf
        self._open_m = 0.0
        self._velocity = ConstantVelocity()

    def update(self, measurement: Measurement, other: SE2 | None = None) -> FrontEndStep:
        """Places one scan; other: a motion that may have been in the place of the measurement's."""
        beams = self._beams(measurement)
        points = self._seen(beams)
        told = self._predicted(measurement, other)
        match, status, passed_ratio = self._placing.believed(measurement, points, beams, told)
        if match is not None and status is StepStatus.MATCHED:
            told, match = self._without_people(told, match, points, beams)
        is_open = match is not None and self._is_open(match, points, told)
        is_told = (match and not is_open) or status is StepStatus.BROKEN
        self._open_m = 0.0 if is_told else self._open_way_m(told, match)
        wheels_P, tied = self._wheels_covariance(status), None
        trust = told.noise * self.config.surely_wrong
        self.loose_runs.lead_to(told.T_map_base, told.covariance, wheels_P, trust)
        by_wheels = None if self._open_run.is_empty else self._by_wheels(told, wheels_P)
        self.T_map_base = told.T_map_base
        if match is not None:
            match = self._joined(match, status, told, is_open)
            if not told.are_people:
                self._learn_scale(told.T_map_base, match)
            if by_wheels is not None and status is StepStatus.MATCHED and not is_open:
                tied = self._open_run.tie(
                    self.keyframes, self._window, points, match, by_wheels[0], told.noise
                )
            self.T_map_base, self._P = match.T_map_base, match.covariance
        if tied is not None:
            self.T_map_base = tied[0]
            self.ties.append(tied[1])
        is_new = tied is not None or self._is_new(status, points)
        if self.keyframes and not is_new and (is_open or status is StepStatus.CARRIED):
            self.loose_runs.add(self._scans, self.T_map_base, self._P)
        else:
            self.loose_runs.end()
        self._scans += 1
        if is_new or match is not None:
            self._blind_m = 0.0
        if is_new:
            self._take(measurement.time_s, points, beams, status is StepStatus.BROKEN)
            # the way to it is told by the wheels; by scans, from before the run
            if tied is not None and by_wheels is not None:
                step, self.scaled_steps[-1] = by_wheels
                self.keyframes[-1] = replace(
                    self.keyframes[-1], T_before=step.motion, covariance=step.covariance
                )
            self._open_run.take(len(self.keyframes) - 1, is_open)
        if match is None or tied is not None:  # that moved the scan before as well
            self._velocity.stop()
            self._placing.slipped_wheels.still.forget()
        else:
            self._velocity.take(told.T_last, self.T_map_base, self._elapsed_s)
            self._placing.slipped_wheels.still.take(beams, self.T_map_base)
        T_keyframe = self.keyframes[-1].T_map_base if self.keyframes else SE2.identity()
        T_keyframe_base = T_keyframe.between(self.T_map_base)
        if match is not None and not is_new:
            self.glances[-1].take(T_keyframe_base, beams)
        return FrontEndStep(
            measurement.time_s, len(self.keyframes) - 1, T_keyframe_base, self.T_map_base, status,
            0.0 if match is None else match.inlier_ratio, is_new, is_open=is_open,
            passed_ratio=passed_ratio, is_tied=tied is not None,
        )  # fmt: skip

    def _predicted(self, measurement: Measurement, other: SE2 | None) -> Prediction:
        """Where the wheels lead; the covariance since the last keyframe grows by that."""
        self._blind_m += self._way_m(measurement)
        T_last, motion = self.T_map_base, self._motion(measurement)
        is_coasting = motion is not measurement.motion
        step, told = told_step(measurement, self.config.step_sigma), self.wheel_scale.scaled(motion)
        T_predicted = T_last @ told
        self._P = self.wheel_scale.predict(self._P, step.motion, step.covariance)
        told = self.wheel_scale.scaled(step.motion) if is_coasting else told
        self._told = self._told.then(told, step.covariance)
        held = self._P
        if is_coasting:
            way_m = apart_m(T_last, T_predicted)
            held = coasting_covariance(way_m, self._elapsed_s, float(self._P[2, 2]))
        noise, odometry = self.wheel_scale.noise, inverse_of(held)
        return Prediction(
            T_last, T_predicted, self._P, odometry, noise, is_coasting, other,
            elapsed_s=self._elapsed_s, blind_m=self._blind_m, goes_on=self._velocity,
        )  # fmt: skip

    def _without_people(
        self, told: Prediction, match: SurfaceMatch, points: FloatArray, beams: Beams
    ) -> tuple[Prediction, SurfaceMatch]:
        """A prediction and a match with faced points (N, 3) that people drew aside, who walked along since
        the last keyframe: where the wheels lead from there. They drew aside scans since as well, each by
        too little to be denied."""
        if told.is_guess or not (self.keyframes and self._people.may_be(told, match)):
            return told, match
        P = self._told.covariance
        since = told.without_people(self.keyframes[-1].T_map_base, self._told.motion, P)
        if since.is_guess or not self._people.have_drawn(points, beams, told, since, match):
            return told, match
        self._P = P
        return since, self._people.held_along(points, since, match)

    def _wheels_covariance(self, status: StepStatus) -> FloatArray:
        """(3, 3) of the step from the last keyframe by the wheels; they may have been wrong where scans broke
        off, and just where one was found by a search alone."""
        config = self.config
        if status is StepStatus.BROKEN:
            self._P = self._P + diagonal_of(config.break_sigma)
        elif status is StepStatus.SEARCHED:
            reach = config.reach_m, config.reach_m, config.reach_rad
            return self._P + diagonal_of(reach)
        return self._P

    def _by_wheels(self, told: Prediction, covariance: FloatArray) -> tuple[ToldStep, ScaledStep]:
        """The step from the last keyframe by the wheels, of a covariance (3, 3), and their scale on it."""
        T_keyframe = self.keyframes[-1].T_map_base
        return ToldStep(T_keyframe.between(told.T_map_base), covariance), self.wheel_scale.step

    def _joined(
        self, match: SurfaceMatch, status: StepStatus, told: Prediction, is_open: bool
    ) -> SurfaceMatch:
        """What a match tells together with the wheels."""
        if told.is_coasting:  # that it goes on as it did holds a search, and proves nothing
            match = replace(match, joined=match.information + inverse_of(self._P))
        if is_open and status is StepStatus.MATCHED:
            return match.held_along_open(told.T_map_base, inverse_of(self._P))
        # wheels that it contradicts tell nothing of how far along it lies
        return match.loosened_along_open(self.config.reach_m) if is_open else match

    def _motion(self, measurement: Measurement) -> SE2:
        """Since the last scan; where nothing measured it, as fast as the one before: of nine simulated
        logs of scans alone that had failed or were off, four became right by it, one worse."""
        motion = measurement.motion
        if is_told(measurement) or motion != SE2.identity():
            return motion
        return self._velocity.motion(self._elapsed_s) or motion

    def _learn_scale(self, T_predicted: SE2, match: SurfaceMatch) -> None:
        """What a scan says of the wheels' scale, by as much as scans are let pull at the pose."""
        surfaces = self.config.surfaces
        self.wheel_scale.update(
            self._P,
            T_predicted.between(match.T_map_base),
            match.information,
            match.least_facing,
            surfaces.pull / surfaces.share,
        )

    def keep_place_alone(self, index: int) -> None:
        """Lets go of the scan of a keyframe that has left the window, and of those after it."""
        self.keyframes.keep_place_alone(index)
        self.glances[index] = _NONE

    def renumber(self, remaining: Remaining) -> None:
        """Lets go of keyframes of the session that do not remain, none of which belongs to an open run that has not ended."""
        self._open_run.renumber(remaining)
        self.keyframes.renumber(remaining)
        self.glances = [self.glances[k] for k in remaining.kept.tolist()]
        self.scaled_steps = self.scaled_steps.some(remaining.kept)
        for k in remaining.ways:  # past others, it is no longer by the wheels' scale
            at = remaining.number(k)
            self.scaled_steps[at] = replace(self.scaled_steps[at], slope=np.zeros(3))
        self.ties = []

    def _seen(self, beams: Beams) -> FloatArray:
        """(N, 3) the faced points of a scan; none where the laser is blocked."""
        config = self.config
        return faced_ends(beams, config.range_max_m, config.blocked_m, config.min_points)

    def _way_m(self, measurement: Measurement) -> float:
        """Of the wheels since the last scan; 0 where it is too fast for any: odometry that jumps."""
        way_m = math.hypot(measurement.motion.x, measurement.motion.y)
        self._elapsed_s, self._last_s = measurement.time_s - self._last_s, measurement.time_s
        return way_m if way_m <= self.config.fastest_mps * self._elapsed_s else 0.0

    @property
    def usual_interval_s(self) -> float:
        """Between the last scans, in the median [s]; 0 where there were not two."""
        return self._placing.pauses.usual_interval_s

    def _beams(self, measurement: Measurement) -> Beams:
        straightener, scan = self._straightener, measurement.scan
        time_s, motion, beam_times_s = measurement.time_s, measurement.motion, scan.beam_times_s
        if beam_times_s is None:  # there is nothing to straighten by
            straightener.pass_over(time_s)
        else:
            duration_s = straightener.duration_s(time_s, motion)
            straightener.take_motion(time_s, beam_times_s, motion, duration_s)
        return straightener.beams(scan)

    def _is_open(self, match: SurfaceMatch, points: FloatArray, told: Prediction) -> bool:
        """Whether a scan leaves a direction open. Where nothing else tells of the way, surfaces across it
        tell, be they ever so few, if they fit in one place; wheels tell more than a few that fit all but as well
        where these lead, and are held to."""
        if match.is_told_by_few:
            return False
        config, is_little = self.config, match.least_facing < self.config.least_facing
        if not told.tells_no_way(match) or match.least_facing >= config.ample_facing:
            return is_little
        way_m = self._open_way_m(told, match)
        return not is_one_place(self._window.surfaces, points, match, way_m)

    def _open_way_m(self, told: Prediction, match: SurfaceMatch | None) -> float:
        """How far the robot went at most since the last scan that told its place."""
        ends = [told.T_map_base] + ([] if match is None else [match.T_map_base])
        if told.usual is not None and match is not None and told.is_denied_stand(match):
            ends.append(told.T_last @ told.usual)
        return self._open_m + max(apart_m(told.T_last, end) for end in ends)

    def _is_new(self, status: StepStatus, points: FloatArray) -> bool:
        if len(points) < self.config.min_points:
            return False
        if not self.keyframes or status is StepStatus.BROKEN:
            return True
        if status is StepStatus.CARRIED:
            return False
        return not self.keyframes[-1].T_map_base.is_near(
            self.T_map_base, self.config.keyframe_m, self.config.keyframe_rad
        )

    def _take(self, time_s: float, points: FloatArray, beams: Beams, is_break: bool) -> None:
        """Makes the scan a keyframe: its points join the surfaces, the oldest ones leave them."""
        T_map_base = self.T_map_base
        before = self.keyframes[-1].T_map_base if self.keyframes else T_map_base
        told = self._told if self.keyframes else ToldStep.unknown()
        self.keyframes.append(
            Keyframe(
                time_s,
                T_map_base,
                before.between(T_map_base),
                self._P,
                np.ascontiguousarray(points[:, :2]),
                beams,
                is_break,
                self.session,
                told=told,
            )
        )
        self.glances.append(Glances())
        self.scaled_steps.append(self.wheel_scale.begin_step())
        self._P, self._told = np.zeros((3, 3)), ToldStep.none()
        if is_break:
            self._window.forget()
        self._window.learn(T_map_base, points)

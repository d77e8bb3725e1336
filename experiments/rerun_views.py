"""What of a trial or a log is shown in Rerun: truth, odometry, estimates, their scans and words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from experiments.mapping import MappingResult
from experiments.observer import LogObserver, TrialObserver
from experiments.rerun_stream import RerunStream
from experiments.slam_files import grid_or_reason
from experiments.slam_result import SlamLog
from experiments.sources import MeasurementSource
from experiments.trials import Outcome, TrialConfig, TrialResult
from kitasap_sim.simulation import SensorFrame, Simulation
from slam.arrays import FloatArray
from slam.beams import Beams
from slam.deskew import BodyMotion, deskewed
from slam.known_map import KnownMap
from slam.localization import Estimate
from slam.mapping import Mapper, MapperStep
from slam.measurements import Measurement
from slam.readers.log import Log
from slam.se2 import SE2
from slam.trajectory import read_tum
from slam.verdict import Status

ESTIMATE = "estimate"
_GROWTH = 1.1
"""Chosen: the map so far is shown again after a tenth more scans: all times together it is then some
ten times the map, however long the drive."""


class _Way:
    """The odometry from a pose on, the time, and each scan as the robot has it, straightened."""

    def __init__(self, stream: RerunStream, T_base_laser: SE2, T_start: SE2 | None) -> None:
        self._stream, self._T_base_laser, self.T_odometry = stream, T_base_laser, T_start
        self._first_s = self._last_s = math.nan
        self.count = 0

    def scan(self, measurement: Measurement) -> FloatArray:
        """Its points (N, 2) [m], base frame; what is shown from now on is of its time."""
        time_s, scan = measurement.time_s, measurement.scan
        if math.isnan(self._first_s):
            self._first_s = time_s
        if self.T_odometry is not None:
            self.T_odometry = self.T_odometry @ measurement.motion
        self._stream.at(time_s - self._first_s, self.count)
        self._stream.robot("odometry", self.T_odometry)
        beams = Beams.of(scan, self._T_base_laser)
        if scan.beam_times_s is not None and time_s > self._last_s:
            motion = BodyMotion.over(measurement.motion, self._last_s, time_s)
            beams = deskewed(scan, self._T_base_laser, motion)
        self._last_s, self.count = time_s, self.count + 1
        return beams.points


class RerunLog(LogObserver):
    """A log, mapped or localised. Odometry is drawn from the first pose that is believed on."""

    def __init__(self, stream: RerunStream) -> None:
        self._stream, self._passes = stream, 0

    def begins(self, log: Log, known: KnownMap | None = None) -> None:
        """Shows the map, if there is one; a second pass takes off the first."""
        self._passes += 1
        if self._passes > 1:
            self._stream.clear()
            why = "by the wheels that the drive shows, or with odometry as no more than a guess"
            self._stream.says("log", "mapped again", (why,))
        self._way = _Way(self._stream, log.T_base_laser, None)
        self._map_due = 1
        if known is not None and known.grid is not None:
            self._stream.grid(known.grid)
        if known is not None:
            self._stream.walls(known.walls.segments)

    def mapped(self, measurement: Measurement, step: MapperStep, mapper: Mapper) -> None:
        """Shows where a scan was placed; now and then the map so far."""
        stream, scan_m = self._stream, self._way.scan(measurement)
        self._start_way(step.T_map_base)
        stream.robot(ESTIMATE, step.T_map_base, scan_m)
        stream.says(ESTIMATE, step.status.value)
        stream.value("inlier_ratio", step.inlier_ratio)
        stream.value("loops", step.loops)
        if self._way.count >= self._map_due:
            self._map_due = math.ceil(_GROWTH * self._way.count)
            stream.points(ESTIMATE, mapper.points)

    def localized(self, measurement: Measurement, estimate: Estimate) -> None:
        """Shows where the robot believes to be; while it is lost, where it may be."""
        scan_m = self._way.scan(measurement)
        if estimate.verdict.status is Status.TRACKING:
            self._start_way(estimate.T_map_base)
        _show(self._stream, ESTIMATE, estimate, scan_m)

    def _start_way(self, T_map_base: SE2) -> None:
        if self._way.T_odometry is None:
            self._way.T_odometry = T_map_base


def show_map(stream: RerunStream, result: SlamLog, reference: Path | None = None) -> None:
    """The finished map in place of the one so far, and how far it is to be believed.

    reference: a file of true poses; they are laid on the map where the trajectory fits them best.
    """
    slam_map, verdict = result.slam_map, result.slam_map.verdict
    grid, _ = grid_or_reason(slam_map)
    if grid is not None:
        stream.grid(grid)
    stream.points(ESTIMATE, slam_map.points)
    stream.path(ESTIMATE, result.trajectory.poses[:, :2])
    evaluation = result.evaluation
    if reference is not None and evaluation is not None and evaluation.absolute is not None:
        T_map_true = evaluation.absolute.T_true_estimated.inverse()
        stream.path("truth", T_map_true @ read_tum(reference).poses[:, :2])
    stream.says("map", "good" if verdict.is_good else "failed", verdict.reasons)


class RerunTrial(TrialObserver):
    """A trial, in the world's frame: the truth, and beside it what each method makes of the scans."""

    def __init__(self, stream: RerunStream, config: TrialConfig) -> None:
        self._stream, self._config = stream, config

    def begins(self, simulation: Simulation, T_map_base: SE2) -> None:
        """Shows the true walls."""
        assert simulation.laser is not None
        known = self._config.known_place
        self._source = MeasurementSource(simulation.laser, simulation.wheel_ticks())
        # who maps knows nothing of the world, and begins at the origin of a map of its own
        maps, start = T_map_base == SE2.identity(), SE2.from_array(simulation.truth().pose)
        self._T_world_map = start if maps else SE2.identity()
        self._way = _Way(self._stream, known.T_base_laser, self._T_world_map @ T_map_base)
        self._stream.walls(known.true_walls.segments)

    def frame(self, frame: SensorFrame, true_pose: np.ndarray) -> None:
        """Shows the truth, and the scan from there."""
        self._scan_m = self._way.scan(self._source.measurement(frame))
        self._true = true_pose
        self._stream.robot("truth", SE2.from_array(true_pose), self._scan_m)

    def estimates(self, outcomes: Mapping[str, Outcome]) -> None:
        """Shows where each method believes to be, by how much it errs, and what it says."""
        for name, outcome in outcomes.items():
            _show(self._stream, name, outcome, self._scan_m)
            self._stream.value(f"{name}/error_mm", 1e3 * float(np.hypot(*outcome.error[:2])))

    def placed(self, poses: Mapping[str, SE2]) -> None:
        """Shows where methods that map place the scan: the first one where it truly was."""
        for name, pose in poses.items():
            self._stream.robot(name, self._T_world_map @ pose, self._scan_m)

    def finish(self, result: TrialResult | MappingResult) -> None:
        """Shows the maps that were made, laid on the truth."""
        if not isinstance(result, MappingResult):
            return
        for name, outcome in result.outcomes.items():
            self._stream.points(name, outcome.points_m)
            self._stream.path(name, outcome.path_m)
            made = outcome.made.verdict
            if made is not None:
                self._stream.says(name, "good" if made.is_good else "failed", made.reasons)


def _show(stream: RerunStream, name: str, found: Estimate | Outcome, scan_m: FloatArray) -> None:
    """Where a method believes to be; where it may be, while it is lost; and what it says."""
    verdict, covariance = found.verdict, found.covariance
    is_lost = verdict.status is Status.LOST
    stream.robot(name, None if is_lost else found.T_map_base, scan_m)
    stream.places(name, [place.T_map_base for place in verdict.hypotheses])
    stream.says(name, verdict.status.value, (*verdict.reasons, *found.warnings))
    if covariance is not None and not is_lost:
        sigma_m = math.sqrt(max(covariance[0, 0] + covariance[1, 1], 0.0))
        stream.value(f"{name}/sigma_mm", 1e3 * sigma_m)

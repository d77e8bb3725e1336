"""Self-localisation: odometry predicts, the laser corrects (Section 3.2, Fig. 2)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from slam.arrays import FloatArray
from slam.beam_likelihood import covariance_of
from slam.beams import Beams
from slam.consistency import InnovationMonitor
from slam.deskew import BodyMotion, deskewed
from slam.fusion import PoseFilter, WheelPrior
from slam.matchers import Matcher
from slam.measurements import Measurement
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2

_DIMENSIONS = 3.0
"""Mean of a normalised innovation squared of as many numbers."""


@dataclass(frozen=True)
class LocalizerConfig:
    """How a `Localizer` follows the robot.

    deskew: straighten each scan by the wheels, where it has beam times. fuse: join a match that
    knows its covariance with the prediction; otherwise it replaces it. start_sigma_m,
    start_sigma_rad: how uncertain the first pose is, on each axis. max_nis: normalised innovation
    squared beyond which match and prediction contradict each other: a match that explains the scan
    is then believed alone. chosen: 30 is exceeded by chance once in a million. slip_nis: beyond it
    the prediction's variance is made to fit, since wheels do slip. match_scales: by how much the
    innovations seen may narrow and widen the matches' covariances.
    """

    deskew: bool = True
    fuse: bool = True
    start_sigma_m: float = 0.1
    start_sigma_rad: float = 0.1
    max_nis: float = 30.0
    slip_nis: float = 12.0
    match_scales: tuple[float, float] = (0.5, 10.0)
    wheels: WheelPrior = field(default_factory=WheelPrior)


@dataclass(frozen=True, eq=False)
class Estimate:
    """What the robot believes after one measurement.

    T_map_base: the pose matched, fused with the prediction where the match knows its covariance;
    or the predicted one where nothing matched. covariance: (3, 3) of its tangent (x, y, theta) in
    the base frame, or None where the method claims nothing. nis: normalised innovation squared of
    the match. warnings: what does not fit map, laser or wheels, in words.
    """

    time_s: float
    T_predicted: SE2
    T_map_base: SE2
    match: ScanMatch
    covariance: FloatArray | None = None
    nis: float | None = None
    warnings: tuple[str, ...] = ()

    @property
    def is_matched(self) -> bool:
        """False when the pose is the odometry's word alone."""
        return self.match.is_matched


class Localizer:
    """Follows a robot on a known map. `T_map_base` is its pose at the last measurement."""

    def __init__(
        self,
        matcher: Matcher,
        T_map_base: SE2,
        T_base_laser: SE2,
        config: LocalizerConfig | None = None,
    ) -> None:
        self.matcher = matcher
        self.T_base_laser = T_base_laser
        self.config = config or LocalizerConfig()
        start = np.square([self.config.start_sigma_m] * 2 + [self.config.start_sigma_rad])
        self._filter = PoseFilter(T_map_base, np.diag(start), self.config.wheels)
        self._monitor = InnovationMonitor()
        self._motion: BodyMotion | None = None
        self._last: Measurement | None = None
        self._claims_nothing = False
        self._match_scale, self._fused = 1.0, 0
        self._offset_m = 0.0

    @property
    def T_map_base(self) -> SE2:
        """The pose at the last measurement."""
        return self._filter.T_map_base

    def update(self, measurement: Measurement) -> Estimate:
        """One pass of Fig. 2. Without a match the prediction stands."""
        duration_s = self._duration_s(measurement)
        motion, noise = measurement.motion, measurement.motion_covariance
        moved = self._filter.predict(motion, duration_s, noise)  # step 1
        T_predicted = self.T_map_base
        beams = self._beams(measurement, moved, duration_s)
        if self._is_repeated(measurement):
            # the same noise twice is no second look: it would be counted as one
            match = ScanMatch(T_predicted, MatchStatus.NOT_ATTEMPTED)
        else:
            match = self.matcher(beams.shortened(self._offset_m), T_predicted)  # steps 2 to 7
        self._last = measurement
        scale = self._match_scale
        information = match.information
        if information is not None and self._motion is not None:
            information = self._motion.less_sure(information)
        nis = self._correct(replace(match, information=information))
        fit = match.fit if match.is_matched else None
        # as it would be had the matches' covariances not been widened to fit
        unscaled = None if nis is None else nis * scale
        self._monitor.take(unscaled, fit, self._filter.strain, self._offset_m)
        if self._monitor.has_offset:
            self._offset_m = self._monitor.offset_m
        covariance = None if self._claims_nothing else self._filter.covariance
        return Estimate(
            measurement.time_s, T_predicted, self.T_map_base, match, covariance, nis,
            self._monitor.warnings,
        )  # fmt: skip

    def _correct(self, match: ScanMatch) -> float | None:
        """The match made part of the pose; its normalised innovation squared, if it has one."""
        holds = match.is_matched or match.status is MatchStatus.DEGENERATE
        if match.information is None or not self.config.fuse:
            if holds:  # of a degenerate match, what it holds
                known = covariance_of(match.information) if match.information is not None else None
                self._claims_nothing = known is None
                self._filter.restart(match.T_map_base, np.zeros((3, 3)) if known is None else known)
            return None
        if not holds:
            return None
        information = match.information / self._match_scale
        nis = self._filter.innovation(match.T_map_base, information)
        if nis <= self.config.max_nis:
            if nis > self.config.slip_nis:
                self._filter.loosen(nis / _DIMENSIONS)
            self._filter.update(match.T_map_base, information)
            self._learn_scale(nis)
        elif match.is_matched:
            self._filter.restart(match.T_map_base, covariance_of(match.information))
        self._claims_nothing = False
        return nis

    def _learn_scale(self, nis: float) -> None:
        """Innovations tell how wide the matches' covariances truly are (Mehra, 1972)."""
        self._fused += 1
        share = 1.0 / min(self._fused + 20.0, 100.0)
        low, high = self.config.match_scales
        scale = self._match_scale * (1.0 + share * (min(nis, 12.0) / _DIMENSIONS - 1.0))
        self._match_scale = min(max(scale, low), high)

    def _duration_s(self, measurement: Measurement) -> float:
        """Time since the last measurement [s]; inf where stamps do not tell.

        Stamps of real logs repeat and jump back: their scans are then taken as they are.
        """
        if self._last is None or not measurement.time_s > self._last.time_s:
            return np.inf
        return measurement.time_s - self._last.time_s

    def _beams(self, measurement: Measurement, moved: SE2, duration_s: float) -> Beams:
        """The scan's beams, straightened by the wheels where it says when they fired."""
        scan = measurement.scan
        if not self.config.deskew or scan.beam_times_s is None or not np.isfinite(duration_s):
            self._motion = None
            return Beams.of(scan, self.T_base_laser)
        end_s = measurement.time_s
        self._motion = BodyMotion.over(moved, end_s - duration_s, end_s, self._motion)
        return deskewed(scan, self.T_base_laser, self._motion)

    def _is_repeated(self, measurement: Measurement) -> bool:
        """True where a laser that froze gives the last scan once more, bit for bit."""
        if self._last is None:
            return False
        now, before = measurement.scan.ranges_m, self._last.scan.ranges_m
        return bool(np.isfinite(now).any() and np.array_equal(now, before, equal_nan=True))

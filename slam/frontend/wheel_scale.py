"""The scale of wheel odometry, learnt where scans tell how far the robot went: tires are seldom as
told, and between walls that look the same all along the wheels alone say how long the way was."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from slam.arrays import FloatArray
from slam.frontend.told_steps import ToldStep, longer
from slam.kernels import wheel_scale as kernels
from slam.kernels.normal_equations import LEAST_PIVOT
from slam.packed import PackedRows
from slam.records import record
from slam.running_median import RunningMedian
from slam.se2 import SE2

_STANDING_M = 1e-3
"""Chosen: a scan up to which the wheels told of no more says nothing of their scale."""
MEDIAN_NIS, _MEDIAN_AHEAD = 2.37, 0.455
"""Of the normalised innovation squared, and of that along the way (chi2 with three degrees of freedom,
and with one)."""
_REMEMBERED = 100
"""Scans that show how noisy the wheels are. Chosen."""
_STRETCHES = 5
"""Chosen: fewer do not show around which scale wheels slip."""


@dataclass(frozen=True)
class WheelScaleConfig:
    """How the scale is learnt.

    sigma: of it before any scan; least_sigma: at which no more is believed, since tires wear and
    floors differ. least_scans: that show how noisy the wheels are, before anything is believed.
    least_facing: share of a scan across the direction that it tells least of, below which it says
    nothing of the scale: what it seems to tell is the noise of walls along the way;
    of five real logs 99 % of the scans have 0.019 and more, corridors with bare walls 0.0002.
    most_nis: normalised innovation squared of a scan that may say something; beyond, wheels slipped
    or jumped. way_m: of the wheels, of which is taken together what scans tell. Both are larger where
    wheels are noisier than told. alike: way by scans for each metre by the wheels, as a share of
    what stretches usually show, or the other way round, below which the wheels slipped on it, and
    nothing is learnt. most_late: share of the way that scans may have gone just before the wheels told
    of any; beyond, odometry comes so late or so seldom that scans are drawn along with it. Of four real
    logs it is 0.001, with a way told at each second scan, or 0.2 s late at each stop, 0.03 and more.
    Chosen, all of these.
    """

    sigma: float = 0.05
    least_sigma: float = 0.003
    least_scans: int = 10
    least_facing: float = 0.01
    most_nis: float = 20.0
    way_m: float = 0.5
    alike: float = 0.72
    most_late: float = 0.02


@record
class ScaledStep:
    """How a step depends on the scale: it was `scale` then, and with another the robot's place moves
    by slope (3,) [m, m, rad] for each unit of it, in the frame at the end of the step."""

    scale: float
    slope: FloatArray


class ScaledSteps(PackedRows[ScaledStep]):
    """How the step to each keyframe depends on the scale: 32 bytes each."""

    DTYPE: ClassVar[np.dtype[Any]] = np.dtype(
        [(name, "f8") for name in ("scale", "slope_x", "slope_y", "slope_rad")]
    )

    @staticmethod
    def packed(thing: ScaledStep) -> tuple[Any, ...]:
        """See `PackedRows`."""
        return thing.scale, *thing.slope.tolist()

    @staticmethod
    def unpacked(row: tuple[Any, ...]) -> ScaledStep:
        """See `PackedRows`."""
        return ScaledStep(row[0], np.array(row[1:]))


class WheelScale:
    """A Kalman filter of the scale beside that of the pose as seen from the last keyframe.

    Metres by scans for each metre by the wheels. The covariance between pose and scale says what a
    scan that moves the pose tells of the scale; it is kept here, the pose's own by whoever asks.
    What scans tell is taken in half a metre at a time, once it is clear that no wheel slipped there.
    """

    def __init__(self, config: WheelScaleConfig | None = None) -> None:
        self.config = config or WheelScaleConfig()
        self.scale, self.variance = 1.0, self.config.sigma**2
        self._across: FloatArray = np.zeros(3)
        self._told = SE2.identity()
        self._ahead = 1.0, 0.0
        self._noise = 1.0
        self._all_m = self._late_m = self._untold_m = 0.0
        self._squared = RunningMedian(_REMEMBERED)
        self._ahead_squared = RunningMedian(_REMEMBERED)
        self._seen = RunningMedian(_REMEMBERED)
        self._forget()

    @property
    def sigma(self) -> float:
        """Standard deviation of the scale."""
        return math.sqrt(self.variance)

    @property
    def noise(self) -> float:
        """Variance of the wheels as scans show it, as a multiple of what they were told to have; 1 at
        least."""
        return self._noise

    def scaled(self, motion: SE2) -> SE2:
        """A motion of the wheels, as far as it went by what is known."""
        return longer(motion, self.scale)

    def scaled_step(self, told: ToldStep) -> ToldStep:
        """What wheels told, the same way."""
        return told.longer(self.scale)

    @property
    def step(self) -> ScaledStep:
        """The step since the last one ended."""
        return ScaledStep(self.scale, self._across / self.variance)

    def begin_step(self) -> ScaledStep:
        """The step since the last call, that ends here: from now on the pose is seen from here."""
        ended = self.step
        self._across = np.zeros(3)
        return ended

    def predict(self, covariance: FloatArray, motion: SE2, spread: FloatArray) -> FloatArray:
        """(3, 3) the pose's covariance after a motion by the wheels, of which spread (3, 3) is."""
        self._told, after = motion, np.empty((3, 3))
        kernels.predict(
            covariance, self._across, motion.x, motion.y, motion.theta, self.scale, self.variance,
            spread, after,
        )  # fmt: skip
        return after

    def update(
        self,
        covariance: FloatArray,
        innovation: SE2,
        information: FloatArray,
        least_facing: float,
        pull: float = 1.0,
    ) -> None:
        """What a scan tells that moved the pose by an innovation.

        covariance: (3, 3) of the pose before, information: (3, 3) of the scan alone, pull: how much of
        that counts.
        """
        config = self.config
        told_m = math.hypot(self._told.x, self._told.y)
        if told_m > 0.0:
            # the innovation is in the frame at the end of the motion
            bearing_rad = math.atan2(self._told.y, self._told.x) - self._told.theta
            self._ahead = math.cos(bearing_rad), math.sin(bearing_rad)
        less, squared, ahead_m, variance_m2, before, after = kernels.update(
            covariance, self._across, innovation.x, innovation.y, innovation.theta, *self._ahead,
            information, pull,
        )  # fmt: skip
        if least_facing < config.least_facing:
            return
        # a scan at which the wheels told of no way counts as well: others told of all of it
        self._note_delay(told_m, ahead_m)
        if told_m > _STANDING_M:
            self._note_noise(squared, ahead_m, variance_m2)
        slope_m = before / self.variance
        self._has_jumped |= squared > self._noise * config.most_nis
        self._way_m += told_m
        self._moved_m += ahead_m
        self._lever_m += slope_m - after / self.variance
        if slope_m > _STANDING_M:
            self._scans += 1
            self._slopes_m += slope_m
            self._information += (1.0 / (self.variance - less) - 1.0 / self.variance) / slope_m
        if self._way_m > self._noise * config.way_m and len(self._squared) >= config.least_scans:
            self._take_in(less)

    def _note_noise(self, squared: float, ahead_m: float, variance_m2: float) -> None:
        """From the normalised innovation squared, and from the innovation along the way, of a variance: the
        variance that the wheels show, as a multiple of what they were told to have; 1 at least."""
        self._squared.take(squared)
        # wheels that are told to be exact, and odometry that nobody questions
        self._ahead_squared.take(ahead_m * ahead_m / max(variance_m2, LEAST_PIVOT))
        ahead = self._ahead_squared.median / _MEDIAN_AHEAD
        self._noise = max(1.0, ahead, self._squared.median / MEDIAN_NIS)

    def _note_delay(self, told_m: float, ahead_m: float) -> None:
        """How far scans went, by what they say ahead, just before the wheels told of any way."""
        if told_m > _STANDING_M:
            self._all_m += told_m
            self._late_m += self._untold_m
            self._untold_m = 0.0
        else:
            self._untold_m = ahead_m

    def _take_in(self, less: float) -> None:
        """Learns from the last stretch of the way, if wheels and scans tell of it alike.

        less: by which the last scan alone lessens the variance; that the pose knows of already.
        Odometry that is late, or told less often than scans, tells of too much at one scan and of too
        little at the next. What scans tell is summed up, therefore, before it is set against the
        wheels: scan by scan, those told too much of would weigh more.
        """
        way_m, seen_m = self._way_m, self.scale * self._way_m + self._moved_m
        alike = self.config.alike
        usual_m = self._usual * way_m
        is_alike = alike * usual_m < seen_m and alike * seen_m < usual_m
        self._seen.take(seen_m / way_m)
        is_late = self._late_m > self.config.most_late * self._all_m
        is_told = self._scans > 0 and self._lever_m > _STANDING_M
        if is_alike and is_told and not self._has_jumped and not is_late:
            information = self._information * self._slopes_m / self._scans / self._noise
            variance = max(1.0 / (1.0 / self.variance + information), self.config.least_sigma**2)
            self.scale += variance * information * self._moved_m / self._lever_m
            self._across *= variance / (self.variance - less)
            self.variance = variance
        self._forget()

    @property
    def _usual(self) -> float:
        """Way by scans for each metre by the wheels, in the median of the last stretches: about 1,
        noisy wheels of another scale would be believed where their noise makes up for it."""
        return 1.0 if len(self._seen) < _STRETCHES else self._seen.median

    def _forget(self) -> None:
        """Begins a stretch anew."""
        self._way_m = self._moved_m = self._lever_m = self._slopes_m = self._information = 0.0
        self._scans, self._has_jumped = 0, False

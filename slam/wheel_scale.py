"""The scale of wheel odometry, learnt where scans tell how far the robot went: tires are seldom as
told, and between walls that look the same all along the wheels alone say how long the way was."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray
from slam.kernels import wheel_scale as kernels
from slam.se2 import SE2


@dataclass(frozen=True)
class WheelScaleConfig:
    """How the scale is learnt.

    sigma: of it before any scan; least_sigma: at which no more is believed, since tires wear and
    floors differ. least_facing: share of a scan across the direction that it tells least of, below
    which it says nothing of the scale: what it seems to tell is the noise of walls along the way;
    of five real logs 99 % of the scans have 0.019 and more, corridors with bare walls 0.0002.
    most_nis: normalised innovation squared of a scan that may say something; beyond, wheels slipped
    or jumped. way_m: of the wheels, of which is taken together what scans tell; alike: way by scans
    for each metre by the wheels, or the other way round, below which the wheels slipped on it, and
    nothing is learnt. Chosen, all of these.
    """

    sigma: float = 0.05
    least_sigma: float = 0.003
    least_facing: float = 0.01
    most_nis: float = 20.0
    way_m: float = 0.5
    alike: float = 0.72


@dataclass(frozen=True, eq=False)
class ScaledStep:
    """How a step depends on the scale: it was `scale` then, and with another the robot's place moves
    by slope (3,) [m, m, rad] for each unit of it, in the frame at the end of the step."""

    scale: float
    slope: FloatArray


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
        self._way_m = self._seen_m = self._information = self._pull = 0.0

    @property
    def sigma(self) -> float:
        """Standard deviation of the scale."""
        return math.sqrt(self.variance)

    def scaled(self, motion: SE2) -> SE2:
        """A motion of the wheels, as far as it went by what is known."""
        return SE2(self.scale * motion.x, self.scale * motion.y, motion.theta)

    def begin_step(self) -> ScaledStep:
        """The step since the last call, that ends here: from now on the pose is seen from here."""
        ended = ScaledStep(self.scale, self._across / self.variance)
        self._across = np.zeros(3)
        return ended

    def predict(self, covariance: FloatArray, motion: SE2, spread: FloatArray) -> FloatArray:
        """(3, 3) the pose's covariance after a motion by the wheels, of which spread (3, 3) is."""
        self._told = motion
        return kernels.predict(
            covariance, self._across, motion.as_array(), self.scale, self.variance, spread
        )

    def update(
        self,
        covariance: FloatArray,
        innovation: FloatArray,
        information: FloatArray,
        least_facing: float,
    ) -> None:
        """What a scan tells that moved the pose by an innovation (3,).

        covariance: (3, 3) of the pose before, information: (3, 3) of the scan alone.
        """
        config = self.config
        moved, less, squared = kernels.update(covariance, self._across, innovation, information)
        if least_facing < config.least_facing or squared > config.most_nis:
            return
        told_m = math.hypot(self._told.x, self._told.y)
        if told_m > 0.0 and less > 0.0:
            # the innovation is in the frame at the end of the motion
            bearing = math.atan2(self._told.y, self._told.x) - self._told.theta
            ahead_m = innovation[0] * math.cos(bearing) + innovation[1] * math.sin(bearing)
            self._way_m += told_m
            self._seen_m += self.scale * told_m + float(ahead_m)
            told = 1.0 / (self.variance - less) - 1.0 / self.variance
            self._information += told
            self._pull += told * moved * self.variance / less
        if self._way_m > config.way_m:
            self._take_in(less)

    def _take_in(self, less: float) -> None:
        """Learns from the last stretch of the way, if wheels and scans tell of it alike.

        less: by which the last scan alone lessens the variance; that the pose knows of already.
        """
        way_m, seen_m, alike = self._way_m, self._seen_m, self.config.alike
        if alike * way_m < seen_m and alike * seen_m < way_m:
            variance = max(
                1.0 / (1.0 / self.variance + self._information), self.config.least_sigma**2
            )
            self.scale += variance * self._pull
            self._across *= variance / (self.variance - less)
            self.variance = variance
        self._way_m = self._seen_m = self._information = self._pull = 0.0

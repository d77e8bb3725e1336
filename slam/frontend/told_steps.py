"""How far the wheels went from one keyframe, or scan, to the next."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import Any, ClassVar

import numpy as np

from slam.arrays import FloatArray, diagonal_of
from slam.measurements import Measurement
from slam.odometry import compose_covariance
from slam.packed import PackedRows
from slam.records import record
from slam.se2 import SE2

GUESS_M = 0.3
"""Standard deviation of a motion beyond which nothing measured it: it leads to whatever looks like where
it ends. Chosen."""
_LITTLE = 1e-6
"""[m2], [rad2]: wheels that tell of no way at all may be off by a millimetre."""
_UNKNOWN = np.diag(np.square([1000.0, 1000.0, 10.0]))
"""[m, m, rad] of a way that nobody measured. chosen: wider than any building."""


def longer(motion: SE2, scale: float) -> SE2:
    """A motion to a place so many times as far, turned as before."""
    return SE2(scale * motion.x, scale * motion.y, motion.theta)


@record
class ToldStep:
    """How far the wheels went since the last keyframe, or scan, and the covariance (3, 3) of that."""

    motion: SE2
    covariance: FloatArray

    @staticmethod
    def none() -> ToldStep:
        """At a keyframe."""
        return ToldStep(SE2.identity(), np.zeros((3, 3)))

    def then(self, motion: SE2, covariance: FloatArray) -> ToldStep:
        """And a motion more, of a covariance (3, 3)."""
        carried = compose_covariance(self.covariance, motion, covariance)
        return ToldStep(self.motion @ motion, carried)

    @staticmethod
    def unknown() -> ToldStep:
        """Where nobody measured the way."""
        return ToldStep(SE2.identity(), _UNKNOWN)

    @staticmethod
    def of(steps: Iterable[ToldStep]) -> ToldStep:
        """One step of all of them, one after the other."""
        return reduce(
            lambda way, step: way.then(step.motion, step.covariance), steps, ToldStep.none()
        )

    def longer(self, scale: float) -> ToldStep:
        """With places so many times as far, as by wheels so many times as large."""
        return ToldStep(longer(self.motion, scale), self.covariance)

    @property
    def is_guess(self) -> bool:
        """Whether nobody measured it."""
        return bool(self.covariance[0, 0] > GUESS_M**2)

    def squared(self, T_before: SE2, T_after: SE2) -> float:
        """Normalised error squared of a step that led from one pose to another."""
        off = ((T_before @ self.motion).inverse() @ T_after).log()
        return float(off @ np.linalg.inv(self.covariance + _LITTLE * np.eye(3)) @ off)


def told_step(measurement: Measurement, step_sigma: tuple[float, float, float]) -> ToldStep:
    """The motion since the last scan, as unsure as it says and by step_sigma (m, m, rad) beside."""
    spread = measurement.motion_covariance + diagonal_of(step_sigma)
    return ToldStep(measurement.motion, spread)


class ToldSteps(PackedRows[ToldStep]):
    """How far the wheels went to each scan of a drive: 100 bytes a scan."""

    DTYPE: ClassVar[np.dtype[Any]] = np.dtype([(f"of_{k}", "f8") for k in range(12)])

    @staticmethod
    def packed(thing: ToldStep) -> tuple[Any, ...]:
        """See `PackedRows`."""
        way = thing.motion
        return way.x, way.y, way.theta, *thing.covariance.ravel().tolist()

    @staticmethod
    def unpacked(row: tuple[Any, ...]) -> ToldStep:
        """See `PackedRows`."""
        return ToldStep(SE2(*row[:3]), np.array(row[3:]).reshape(3, 3))

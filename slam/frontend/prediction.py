"""Where the wheels lead, and how surely."""

from __future__ import annotations

import math
from dataclasses import replace

from slam.arrays import FloatArray
from slam.frontend.constant_velocity import ConstantVelocity
from slam.frontend.strays import apart_m
from slam.frontend.told_steps import GUESS_M
from slam.kernels.normal_equations import inverse_of, squared_innovation
from slam.lazy import lazy
from slam.measurements import Measurement
from slam.odometry import place_sigma_m
from slam.records import record
from slam.se2 import SE2
from slam.surface.surface_match import SurfaceMatch

_GUESS_RAD = 0.3
"""As `GUESS_M`, of the heading. Chosen."""
_STANDS = 1e-6
"""[m], [rad]: odometry that tells of less tells of nothing."""
_TURNS_RAD = 0.05
"""That a scan may show of a robot that stands. Chosen."""


@record
class Prediction:
    """Where the wheels lead from the last scan's pose, and the covariance (3, 3) of that.

    odometry: (3, 3) information by which matches are held there; not the inverse of the covariance
    if is_coasting: nobody measured the motion, and the robot goes on as it did. noise: of the wheels,
    see `WheelScale`. other: a motion that may have been in its place. are_people: from the last
    keyframe, since what scans saw walked along. elapsed_s: since the last scan. blind_m: the way since one
    told anything. goes_on: how the robot went so far; None: not known.
    """

    T_last: SE2
    T_map_base: SE2
    covariance: FloatArray
    odometry: FloatArray
    noise: float
    is_coasting: bool
    other: SE2 | None = None
    are_people: bool = False
    elapsed_s: float = math.inf
    blind_m: float = 0.0
    goes_on: ConstantVelocity | None = None

    @lazy
    def is_guess(self) -> bool:
        """Whether next to nothing is known of the way since the last scan."""
        (xx, _, _), (_, yy, _), (_, _, turn) = self.covariance.tolist()
        return bool(max(xx, yy) > GUESS_M**2 or turn > _GUESS_RAD**2)

    @lazy
    def usual(self) -> SE2 | None:
        """The motion since the last scan if the robot went on as it did; None where that is not known."""
        return None if self.goes_on is None else self.goes_on.motion(self.elapsed_s)

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the place, in the direction in which it is known least."""
        return place_sigma_m(self.covariance)

    @property
    def way_m(self) -> float:
        """From there to where the wheels lead."""
        return apart_m(self.T_last, self.T_map_base)

    @property
    def others(self) -> list[SE2]:
        """Where the robot may be as well: it has stopped, or odometry jumped, or did not."""
        if not (self.is_coasting or self.is_guess):
            return []
        return [self.T_last] if self.other is None else [self.T_last, self.T_last @ self.other]

    @property
    def stands(self) -> bool:
        """Whether they tell of no way."""
        return self.T_map_base.is_near(self.T_last, _STANDS, _STANDS)

    def is_denied_stand(self, match: SurfaceMatch) -> bool:
        """Whether wheels stand, and a match has the robot turn: walls tell that, and people do not make it up."""
        return self.stands and abs(self.T_last.between(match.T_map_base).theta) > _TURNS_RAD

    def tells_no_way(self, match: SurfaceMatch) -> bool:
        """Whether nothing but a match tells how far the robot went: wheels that do not tell of all tell of nothing.
        Where odometry jumped, by as much, the place a scan was looked for from says nothing of others."""
        is_guessed = self.is_coasting or (self.is_guess and self.other is None)
        return is_guessed or self.is_denied_stand(match)

    def is_denying(self, match: SurfaceMatch, most: float) -> bool:
        """Whether the wheels, as noisy as they show, deny a match by more than so much of their normalised
        error squared. Those that stand may tell late of a way, and deny nothing."""
        return not self.stands and self.squared(match) > self.noise * most

    def squared(self, match: SurfaceMatch, information: FloatArray | None = None) -> float:
        """Normalised innovation squared of a match, by an information (3, 3); None: the odometry's."""
        told, found = self.T_map_base, match.T_map_base
        information = self.odometry if information is None else information
        result: float = squared_innovation(
            told.x, told.y, told.theta, found.x, found.y, found.theta, information
        )
        return result

    def without_people(self, T_keyframe: SE2, motion: SE2, covariance: FloatArray) -> Prediction:
        """Where the wheels lead from the last keyframe, whatever scans since then saw: by a motion and its
        covariance (3, 3)."""
        return replace(
            self,
            T_map_base=T_keyframe @ motion,
            covariance=covariance,
            odometry=inverse_of(covariance),
            are_people=True,
        )


def is_told(measurement: Measurement) -> bool:
    """Whether anything measured the way since the last scan."""
    return measurement.motion_covariance.item(0, 0) < GUESS_M**2

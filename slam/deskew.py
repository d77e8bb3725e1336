"""Scans straightened: each beam from where the robot was when it fired."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.measurements import LaserScan
from slam.se2 import SE2

_STEADY = 0.2**2
_CHANGES_AT = (0.25, 0.5, 0.75)
"""Chosen: shares of the interval after which the speed may have changed at once."""
_NO_TIME_S = 1e-6
_JITTER_MEMORY = 20
_FITS_BETTER = 0.5
"""Chosen: of a change of speed; one that is as large either way says nothing of the stamps."""
_LEAST_JITTER_S = 0.0025
"""Chosen: so much intervals differ where sweeps end between the ticks of a clock; it does no harm."""
_LEAP, _USUAL = 3.0, 0.5
"""Chosen: three times the usual interval is a leap, half of it more or less is usual."""


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """How the base moved up to a stamp: its velocity, changing evenly, seen from the base there.

    end_s: the stamp. middle_s: when velocity held. velocity: (3,) twist per second (x, y [m/s],
    theta [rad/s]); acceleration: (3,) its change per second. unsteadiness: (3,) standard deviation
    of a pose amid the interval, seen from its end [m], [rad]: a sixteenth of how far the robot goes
    astray in it by the acceleration's own change, which nothing tells before the next interval.
    change: (3,) of the velocity since the interval before. start_s: of the interval. kept_s,
    kept: until when the velocity stayed what it had been, and what that was; never by default.
    """

    end_s: float
    middle_s: float
    velocity: FloatArray
    acceleration: FloatArray
    unsteadiness: FloatArray
    change: FloatArray
    start_s: float
    kept_s: float = -np.inf
    kept: FloatArray = field(default_factory=lambda: np.zeros(3))

    @staticmethod
    def over(
        motion: SE2, start_s: float, end_s: float, before: BodyMotion | None = None
    ) -> BodyMotion:
        """The motion over an interval; from the one before it comes how the velocity changes.

        Wheels tell one mean velocity for each interval. With the last one it is a line in time: a
        robot that speeds up at 1 rad/s2 is then 1 mrad less off in the middle of 0.1 s.
        Raises ValueError unless the interval has a length.
        """
        if not end_s > start_s:
            raise ValueError(f"a motion needs a start before its end, not {start_s} and {end_s} s")
        velocity, middle_s = motion.log() / (end_s - start_s), (start_s + end_s) / 2.0
        acceleration = before_that = np.zeros(3)
        # of a robot of which nothing is known: it may just have started
        change = velocity
        if before is not None and abs(before.end_s - start_s) < 1e-9:
            acceleration = (velocity - before.velocity) / (middle_s - before.middle_s)
            before_that, change = before.acceleration, velocity - before.velocity
        astray = np.abs(acceleration - before_that) * (end_s - start_s) ** 2
        return BodyMotion(end_s, middle_s, velocity, acceleration, astray / 16.0, change, start_s)

    def ended(self, end_s: float) -> BodyMotion:
        """The same motion up to another stamp, as when a clock was set."""
        shift_s = end_s - self.end_s
        return replace(
            self,
            end_s=end_s,
            middle_s=self.middle_s + shift_s,
            start_s=self.start_s + shift_s,
            kept_s=self.kept_s + shift_s,
        )

    def lateness(self, sweep_s: float, lever_m: float) -> FloatArray:
        """(3, 3) by how much a scan is off that took up to sweep_s [s] and was not straightened.

        Its beams were fired half a sweep before the stamp on average, and a turn, which moves its
        points by lever_m [m] times the angle, bends it, by an eighth from end to middle.
        """
        late = self.velocity * sweep_s / 2.0
        bent = self.velocity[2] * sweep_s / 8.0 * np.array([lever_m, lever_m, 1.0])
        return np.asarray(np.outer(late, late) + np.diag(bent**2))

    def is_steady(self, information: FloatArray) -> bool:
        """Whether it makes no difference to a match of such information (3, 3) when speed changed.

        A change halfway takes the robot an eighth of it, times the interval, off an even one: no
        more than a fifth of a standard deviation.
        """
        bend = self.change * (self.end_s - self.start_s) / 8.0
        return float(bend @ information @ bend) < _STEADY

    def alternatives(self) -> tuple[BodyMotion, ...]:
        """The same way by other progress: at one speed, evenly faster, and changed ever later."""
        length_s = self.end_s - self.start_s
        before = self.velocity - self.change
        even = replace(self, acceleration=np.zeros(3))
        late = []
        for share in _CHANGES_AT:
            after = before + self.change / (1.0 - share)
            kept_s = self.start_s + share * length_s
            late.append(replace(even, velocity=after, kept_s=kept_s, kept=before))
        return (even, self, *late)

    def less_sure(self, information: FloatArray) -> FloatArray:
        """(3, 3) information of a match, less what its scan's straightening may have missed."""
        if not self.unsteadiness.any():
            return information
        variance = np.diag(self.unsteadiness**2)
        # (R + D)^-1 for an R that may have no inverse
        loosened = np.linalg.solve(np.eye(3) + information @ variance, information)
        return np.asarray((loosened + loosened.T) / 2.0)

    def poses_at(self, times_s: FloatArray) -> FloatArray:
        """(N, 3) pose of the base at each time (N,) in the frame of the base at the stamp."""
        moving_s = np.maximum(times_s, self.kept_s)
        leads = ((self.end_s - self.middle_s) ** 2 - (moving_s - self.middle_s) ** 2) / 2.0
        twists = np.outer(self.end_s - moving_s, self.velocity) + np.outer(leads, self.acceleration)
        twists += np.outer(moving_s - times_s, self.kept)
        return _exp_all(-twists)


class SweepClock:
    """How long each motion took, from stamps that in real logs repeat, jump and are set anew.

    A stamp that is not after the last one, or so late that the wheels' way fits the usual interval
    better, tells nothing, nor does the interval that follows it: the usual one is taken instead.
    How much intervals differ where the way does not is `jitter_s`.
    """

    def __init__(self) -> None:
        self._last_s: float | None = None
        self._usual_s = math.inf
        self._velocity: tuple[float, ...] | None = None
        self._is_doubtful = False
        self._jitter_s2, self._intervals = 0.0, 0
        self.is_told = True
        """Whether the last stamp was one to believe."""

    def duration_s(self, time_s: float, motion: SE2) -> float:
        """Of the motion up to a stamp [s]; inf while no interval is known."""
        told_s = math.inf if self._last_s is None else time_s - self._last_s
        self._last_s = time_s
        usual_s = self._usual_s
        self.is_told = True
        if math.isinf(told_s):
            return math.inf
        is_usual = abs(told_s - usual_s) < _USUAL * usual_s
        # stamps that repeat do so up to rounding
        way: tuple[float, ...] = tuple(motion.log().tolist())
        is_bad = told_s <= _NO_TIME_S or self._is_leap(told_s, way)
        if is_bad or (self._is_doubtful and not is_usual):
            self._is_doubtful, self.is_told = is_bad, False
            return usual_s
        self._is_doubtful = False
        self._take_jitter(told_s, way)
        self._usual_s = told_s
        self._velocity = _per_second(way, told_s)
        return told_s

    def pass_over(self, time_s: float) -> None:
        """Notes a stamp: the next motion began there."""
        self._last_s = time_s

    @property
    def jitter_s(self) -> float:
        """Standard deviation of the intervals told, as far as the wheels went another way [s]."""
        return math.sqrt(self._jitter_s2)

    def _take_jitter(self, told_s: float, way: tuple[float, ...]) -> None:
        """Learns from an interval: it was not that one if the way fits the usual one better."""
        if self._velocity is None or math.isinf(self._usual_s) or not any(way):
            return
        off_s = 0.0
        off_by_s = told_s - self._usual_s
        if abs(off_by_s) > _LEAST_JITTER_S:
            usual, told = self._changes(way, told_s)
            if usual < _FITS_BETTER * told:
                off_s = off_by_s
        # between two intervals that differ by chance lies twice the variance of one
        self._intervals += 1
        share = 1.0 / min(self._intervals, _JITTER_MEMORY)
        self._jitter_s2 += share * (off_s**2 / 2.0 - self._jitter_s2)

    def _is_leap(self, told_s: float, way: tuple[float, ...]) -> bool:
        if self._velocity is None or told_s < _LEAP * self._usual_s:
            return False
        usual, told = self._changes(way, told_s)
        return usual < told

    def _changes(self, way: tuple[float, ...], told_s: float) -> tuple[float, float]:
        """By how much the velocity changed, had the way taken the usual time, and that told."""
        assert self._velocity is not None
        return (
            math.dist(_per_second(way, self._usual_s), self._velocity),
            math.dist(_per_second(way, told_s), self._velocity),
        )


def _per_second(way: tuple[float, ...], duration_s: float) -> tuple[float, ...]:
    return tuple(part / duration_s for part in way)


def deskewed(scan: LaserScan, T_base_laser: SE2, motion: BodyMotion) -> Beams:
    """The beams of a scan as seen from the base at the end of the motion.

    Raises ValueError if the scan has no beam times.
    """
    if scan.beam_times_s is None:
        raise ValueError("a scan without beam_times_s cannot be deskewed")
    poses = motion.poses_at(scan.beam_times_s)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, 0] + c * T_base_laser.x - s * T_base_laser.y
    y = poses[:, 1] + s * T_base_laser.x + c * T_base_laser.y
    angles_rad = scan.angles_rad + T_base_laser.theta + poses[:, 2]
    # interlaced beams of a turning robot may overtake their neighbours
    order = np.argsort(angles_rad, kind="stable")
    return Beams(np.column_stack([x, y])[order], angles_rad[order], scan.ranges_m[order])


def _exp_all(twists: FloatArray) -> FloatArray:
    """(N, 3) `SE2.exp` of each twist (N, 3), angles not wrapped."""
    omega = twists[:, 2]
    is_small = np.abs(omega) < 1e-4
    safe = np.where(is_small, 1.0, omega)
    sine = np.where(is_small, 1.0 - omega**2 / 6.0, np.sin(safe) / safe)
    cosine = np.where(is_small, omega / 2.0, (1.0 - np.cos(safe)) / safe)
    x = sine * twists[:, 0] - cosine * twists[:, 1]
    y = cosine * twists[:, 0] + sine * twists[:, 1]
    return np.column_stack([x, y, omega])

"""Odometry that tells of a way as the robot has not gone before, much faster or backwards: a jump."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from statistics import fmean

import numpy as np

from slam.frontend.keyframes import FrontEndStep
from slam.measurements import Measurement
from slam.running_median import RunningMedian
from slam.se2 import SE2

_FAR_M, _FAR_BACK_M = 0.5, 0.3
"""Chosen: shorter jumps, ahead and backwards, are as a slip of wheels, which scans bear."""
_FASTER = 2.0
"""Chosen: of the fastest of the steps remembered."""
_STEPS, _LEAST = 50, 5
"""Remembered, and needed to say how the robot drives. Chosen."""
_MOVES_M = 0.02
_AGAIN = 3
"""Chosen: so many such steps in a row are how it drives now."""
_TURN_RAD = 0.3
"""Chosen: by which the heading may be off after a jump."""
_LITTLE_BACK_M = 0.15
"""Chosen: a robot that has gone back so little, off its dock, has not gone back."""
_LATE = 2.0
"""Times the last interval, beyond which nobody knows that it went on. Chosen."""
_BRIEF = 0.5
"""Of the usual interval; chosen: a stamp that is nearer to the one before tells no speed."""
_MADE_UP = 0.3
"""Share of a way by which it may differ from the one that the robot would have gone since odometry last
told of any, to make up for that. Chosen."""
_TURNS_RAD = 0.02
"""Chosen: odometry that tells of such a turn on the spot, and of no way, is not silent."""
_MOST_SILENT = 8.0
"""Times the interval between records; chosen: whoever is silent for longer has stood."""


@dataclass(frozen=True, eq=False)
class _Step:
    """A motion, when it was told [s], and how long it took."""

    time_s: float
    elapsed_s: float
    motion: SE2

    @property
    def way_m(self) -> float:
        return math.hypot(self.motion.x, self.motion.y)

    @property
    def speed_mps(self) -> float:
        return self.way_m / self.elapsed_s

    @property
    def back_m(self) -> float:
        """How far back it led, as seen from its beginning and from its end: who turned round within it and
        drove on, or the other way, did not go back."""
        c, s = math.cos(self.motion.theta), math.sin(self.motion.theta)
        return -max(self.motion.x, c * self.motion.x + s * self.motion.y)

    @property
    def is_long(self) -> bool:
        """Whether it may be a jump at all."""
        return self.way_m > _FAR_M or self.back_m > _FAR_BACK_M

    @property
    def velocity_mps(self) -> tuple[float, float]:
        """Ahead and to the left."""
        return self.motion.x / self.elapsed_s, self.motion.y / self.elapsed_s

    def as_never_before(self, fastest_mps: float, farthest_back_m: float) -> tuple[bool, bool]:
        """Whether it is much faster than a robot drove that went so far, and back for the first time."""
        is_far = self.way_m > _FAR_M
        is_back = self.back_m > _FAR_BACK_M and farthest_back_m <= _LITTLE_BACK_M
        return is_far and self.speed_mps > _FASTER * fastest_mps, is_back


@dataclass(frozen=True, eq=False)
class JudgedMotion:
    """A measurement whose motion is to be believed, as far as it says itself; other: where the robot
    may have gone as well, where odometry has jumped, or it has not. has_jumped: it is known to have,
    now or, where it told of a way back and then of one ahead, the time before; or may have, while scans
    told nothing."""

    measurement: Measurement
    other: SE2 | None = None
    has_jumped: bool = False


class _Intervals:
    """Between records [s]: how short the stamps of two may be apart and tell a speed, of records that come
    evenly or some at once."""

    def __init__(self) -> None:
        self._last_s: deque[float] = deque(maxlen=_LEAST)
        self._means_s = RunningMedian(_STEPS - _LEAST + 1)

    def take(self, interval_s: float) -> None:
        self._last_s.append(interval_s)
        if len(self._last_s) == _LEAST:
            self._means_s.take(fmean(self._last_s))

    @property
    def least_s(self) -> float:
        """Inf where no interval is known."""
        if self._means_s:
            return _BRIEF * self._means_s.median
        return _BRIEF * fmean(self._last_s) if self._last_s else math.inf


class OdometryJumps:
    """Knows how fast the robot goes, and which way. Much faster it goes on as it did, turning as it is
    told; that, and a way back for the first time, is as unsure as the two are apart: then its scans say
    where it is."""

    def __init__(self) -> None:
        self._steps: deque[_Step] = deque(maxlen=_STEPS)
        self._intervals = _Intervals()
        self._last_s, self._in_a_row = math.inf, 0
        self._driven_s, self._told_s = math.inf, math.inf
        self._velocity_mps, self._interval_s = (0.0, 0.0), math.inf
        self._was_back = False
        self._begun: list[_Step] = []

    def judged(self, measurement: Measurement, is_blind: bool = False) -> JudgedMotion:
        """The measurement; where odometry may have jumped, one whose motion tells next to nothing.

        is_blind: the last scan told nothing. Odometry that comes late is told of then by nobody else;
        scans that see have shown already most of what it makes up for.
        """
        time_s, motion = measurement.time_s, measurement.motion
        late_s = _LATE * self._interval_s
        is_timed = self._take_time(time_s)
        step, silent_s = _Step(time_s, self._interval_s, motion), time_s - self._told_s
        if step.way_m >= _MOVES_M or abs(motion.theta) > _TURNS_RAD:
            self._told_s = time_s
        if step.way_m < _MOVES_M:
            if time_s - self._driven_s > _MOST_SILENT * step.elapsed_s:
                self._velocity_mps = 0.0, 0.0
            return JudgedMotion(measurement)
        self._driven_s = time_s
        # it may have jumped all the same: where walls look the same, nobody would notice
        is_late = is_blind and self._makes_up(step, silent_s)
        step = replace(step, elapsed_s=silent_s) if is_late else step
        is_fast, is_back = self._as_never_before(step)
        # many short ways since the last scan, and none of them a jump
        is_fast &= measurement.longest_step_m > _FAR_M
        is_back &= measurement.longest_step_m > _FAR_BACK_M
        # who backs up goes on backwards
        has_jumped = is_fast or is_late or (self._was_back and step.back_m < 0.0)
        self._was_back = is_back and not is_fast
        if is_fast or is_back:
            self._in_a_row += 1
            x, y = (min(step.elapsed_s, late_s) * one for one in self._velocity_mps)
            usual = SE2(x, y, motion.theta)
            apart_m = math.hypot(motion.x - x, motion.y - y)
            doubt = np.diag(np.square([apart_m, apart_m, _TURN_RAD]))
            believed, other = (usual, motion) if is_fast else (motion, usual)
            covariance = measurement.motion_covariance + doubt
            measurement = replace(measurement, motion=believed, motion_covariance=covariance)
            return JudgedMotion(measurement, other, has_jumped)
        self._in_a_row = 0
        if is_timed:
            self._remember(step)
        return JudgedMotion(measurement, has_jumped=has_jumped)

    def _take_time(self, time_s: float) -> bool:
        """Whether a record's stamp tells how long after the one before it came; of one that stands, goes
        back, or comes with that, it is as long as before."""
        elapsed_s, self._last_s = time_s - self._last_s, time_s
        if elapsed_s <= 0.0:
            return False
        self._intervals.take(elapsed_s)
        is_timed = elapsed_s >= self._intervals.least_s
        if is_timed:
            self._interval_s = elapsed_s
        return is_timed

    def _makes_up(self, step: _Step, silent_s: float) -> bool:
        """Whether odometry that has told of none for so long tells late of the way driven meanwhile."""
        is_late = step.elapsed_s < silent_s <= _MOST_SILENT * step.elapsed_s
        if not is_late or len(self._steps) < _LEAST:
            return False
        # steps of a hiccup are short and long by turns
        steps = list(self._steps)[-_LEAST:]
        x, y = silent_s * np.median([one.velocity_mps for one in steps], axis=0)
        off_m = math.hypot(step.motion.x - x, step.motion.y - y)
        return off_m < _MADE_UP * step.way_m

    def _remember(self, step: _Step) -> None:
        """How the robot drives."""
        self._velocity_mps = step.velocity_mps
        self._steps.append(step)
        if len(self._begun) < 2 * _LEAST:
            self._begun.append(step)

    @property
    def begun_with_s(self) -> float | None:
        """When one of the first steps was a jump [s], by how the robot drove after it: that was believed,
        since nobody knew yet; None if none was."""
        intervals = _Intervals()
        for step in self._begun:
            intervals.take(step.elapsed_s)
        begun = _timed(self._begun, intervals.least_s)
        for at, step in enumerate(begun[:_LEAST]):
            others = begun[:at] + begun[at + 1 :]
            if len(others) < _LEAST:
                return None
            if any(step.as_never_before(*_most_of(others))):
                return step.time_s
        return None

    def objections(self, steps: Sequence[FrontEndStep], is_doubted: bool) -> list[str]:
        """In words, that odometry jumped as the drive of such steps began; who doubts it does not go by it,
        but where a scan leaves the way open."""
        time_s = self.begun_with_s
        step = next((one for one in steps if one.time_s == time_s), None)
        if step is None or (is_doubted and not step.is_open):
            return []
        return [
            f"at {step.time_s:.2f} s odometry jumped, before it could be known how the robot drives:"
            " what was mapped until then may lie elsewhere"
        ]

    def _as_never_before(self, step: _Step) -> tuple[bool, bool]:
        """Whether a step is much faster than those remembered, and back for the first time; one of these
        may have been a jump that nobody noticed."""
        if not step.is_long:
            return False, False
        steps = _timed(self._steps, self._intervals.least_s)
        if len(steps) < _LEAST or self._in_a_row >= _AGAIN - 1:
            return False, False
        return step.as_never_before(*_most_of(steps, left_out=1))


def _timed(steps: Iterable[_Step], least_s: float) -> list[_Step]:
    """Steps but those that took less: how long one usually takes is not known at the first."""
    return [one for one in steps if one.elapsed_s >= least_s]


def _most_of(steps: Iterable[_Step], left_out: int = 0) -> tuple[float, float]:
    """How fast [m/s], and how far back [m], steps were at most, each but for so many."""
    speeds_mps, backs_m = zip(*((one.speed_mps, one.back_m) for one in steps), strict=True)
    return sorted(speeds_mps)[-1 - left_out], sorted(backs_m)[-1 - left_out]

"""Odometry told by a record or a few too late or too early: it stands and leaps by turns, as no robot drives."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from slam.readers.log_record import LogRecord
from slam.readers.record_clock import BRIEF, RecordClock
from slam.readers.record_dropouts import NOTHING
from slam.se2 import SE2

_SPEEDS_UP_MPS2 = 4.0
"""No robot on wheels does by more, nor brakes: that of mines-exp2 does by 3.4, as its encoders' ticks tell."""
_OFF_M = 0.08
"""By which the ways told are off before they are told anew, or doubted: scans bear less."""
_STEPS, _SLOW_MPS = 5, 0.2
"""From which it is known how fast the robot goes; slower, it may do anything."""
_UNEVEN, _MADE_UP = 0.5, 0.25
"""Of a usual step: by which one is uneven, and by which those may be off that made up for each other."""
_ALIKE, _ANEW = 0.2, 3
"""So many steps in a row that differ by that share at most are a pace of their own."""
_LONG_S, _MOST = 1.5, 256
"""For which, and how many, records wait at most: by then the robot goes otherwise than before."""
_SIGMA = 0.1
"""Of the way that is told anew, by which the robot may have driven unevenly. Chosen, all of them."""


@dataclass(frozen=True)
class _Step:
    """How far ahead of the one before a record is by its own word [m], and what that took by the stamps and as
    usual [s]."""

    way_m: float
    since_s: float
    usual_s: float

    def ahead_m(self, before: _Step) -> tuple[float, float]:
        """How much farther than in another the robot went, by either clock."""
        by_stamps_m = self.way_m - before.way_m / before.since_s * self.since_s
        return by_stamps_m, self.way_m - before.way_m / before.usual_s * self.usual_s


class _Pace:
    """How fast a robot goes, by the stamps of its records and by a clock that goes evenly."""

    def __init__(self) -> None:
        self._by_stamps, self._as_usual = _Speeds(), _Speeds()
        self.last: _Step | None = None

    def take(self, step: _Step) -> None:
        """Notes one."""
        self.last = step
        self._by_stamps.take(step.way_m / step.since_s)
        self._as_usual.take(step.way_m / step.usual_s)

    def ahead_m(self, step: _Step) -> tuple[float, float]:
        """How much farther than at its pace the robot went, by either clock."""
        by_stamps_m = step.way_m - self._by_stamps.pace_mps * step.since_s
        return by_stamps_m, step.way_m - self._as_usual.pace_mps * step.usual_s

    @property
    def direction(self) -> float:
        """1 for a robot that goes ahead, -1 for one that goes backwards."""
        return math.copysign(1.0, self._as_usual.pace_mps)

    def usual_m(self, step: _Step) -> float:
        """How far it goes in a record; 0 where it is too slow to tell of it, or goes unevenly."""
        slower_mps = min(abs(one.pace_mps) for one in (self._by_stamps, self._as_usual))
        return slower_mps * step.usual_s if slower_mps >= _SLOW_MPS else 0.0

    def is_uneven(self, step: _Step) -> bool:
        """Whether a step is much shorter than that by both clocks, or much longer, and than the one before."""
        least_m = _UNEVEN * self.usual_m(step)
        if least_m == 0.0 or _off_m(self.ahead_m(step)) <= least_m:
            return False
        return self.last is not None and _off_m(step.ahead_m(self.last)) > least_m


class _Speeds:
    """Those of the last steps, by one clock. pace_mps: what they have in common; 0 where they do not."""

    def __init__(self) -> None:
        self._mps = deque[float](maxlen=_STEPS)
        self.pace_mps = 0.0

    def take(self, speed_mps: float) -> None:
        """Notes one."""
        self._mps.append(speed_mps)
        if len(self._mps) == _STEPS:
            _, low, middle, high, _ = sorted(self._mps)
            self.pace_mps = middle if high - low <= _UNEVEN * abs(middle) else 0.0


class _Run:
    """Records from an uneven step on, and those steps."""

    def __init__(self) -> None:
        self.records: list[LogRecord] = []
        self.steps: list[_Step] = []
        self.is_made_up = self._is_impossible = self._is_back = False
        self._doubts_m: list[float] = []
        self._elapsed_s = self._by_stamps_m = self._as_usual_m = 0.0

    def take(self, record: LogRecord, step: _Step, pace: _Pace, trembles_s: float) -> None:
        """The next step, and the record that tells of it."""
        usual_m, ahead_m = pace.usual_m(step), pace.ahead_m(step)
        self._elapsed_s += step.since_s
        self._by_stamps_m += ahead_m[0]
        self._as_usual_m += ahead_m[1]
        all_ahead_m = self._by_stamps_m, self._as_usual_m
        most_m = max(_OFF_M, _SPEEDS_UP_MPS2 * self._elapsed_s**2 / 2.0)
        self._is_impossible |= _off_m(all_ahead_m) > most_m
        self.is_made_up = max(map(abs, all_ahead_m)) < _MADE_UP * usual_m
        # who is set elsewhere for a moment comes back: that is no way
        self._is_back |= step.way_m * pace.direction < -_MADE_UP * usual_m
        before = self.steps[-1] if self.steps else pace.last
        off_m = min(_off_m(ahead_m), _off_m(step.ahead_m(before))) if before else 0.0
        robots_m = max(_OFF_M, _SPEEDS_UP_MPS2 * step.since_s**2)
        stamps_m = usual_m / step.usual_s * trembles_s
        self.steps.append(step)
        self.add(record, max(off_m - robots_m - stamps_m, 0.0))

    @property
    def was_even(self) -> bool:
        """Whether the robot went evenly, and odometry told of it unevenly."""
        return self._is_impossible and self.is_made_up and not self._is_back

    def add(self, record: LogRecord, doubt_m: float = 0.0) -> None:
        """A record, by how much more it tells of than any robot does."""
        self.records.append(record)
        self._doubts_m.append(doubt_m)

    @property
    def is_over(self) -> bool:
        """Whether the robot goes otherwise than before."""
        if self._elapsed_s > _LONG_S or len(self.records) > _MOST:
            return True
        ways_m = [step.way_m for step in self.steps[-_ANEW:]]
        mean_m = abs(sum(ways_m)) / _ANEW
        return len(ways_m) == _ANEW and max(ways_m) - min(ways_m) < _ALIKE * mean_m

    def evenly_from(self, before: LogRecord) -> Iterator[LogRecord]:
        """The records, each as far on the way that they tell of as its time is."""
        poses = [before.T_odom_base, *(one.T_odom_base for one in self.records)]
        tangents = [(one.inverse() @ other).log() for one, other in pairwise(poses)]
        gone_m = np.cumsum([0.0, *(math.hypot(tangent[0], tangent[1]) for tangent in tangents)])
        elapsed_s = np.array([0.0, *(one.time_s - before.time_s for one in self.records)])
        shares = elapsed_s / elapsed_s[-1]
        places = np.interp(shares * gone_m[-1], gone_m, np.arange(len(poses))).tolist()
        sigmas_m = (_SIGMA * gone_m[-1] * np.sqrt(np.diff(shares))).tolist()
        for one, place, sigma_m in zip(self.records, places[1:-1], sigmas_m, strict=False):
            at = min(int(place), len(tangents) - 1)
            T_odom_base = poses[at] @ SE2.exp((place - at) * tangents[at])
            yield _doubted(replace(one, T_odom_base=T_odom_base), sigma_m)
        yield _doubted(self.records[-1], sigmas_m[-1])

    def as_told(self) -> list[LogRecord]:
        """The records as they are, as unsure as they tell of more than any robot does."""
        return [
            _doubted(one, doubt_m)
            for one, doubt_m in zip(self.records, self._doubts_m, strict=True)
        ]


class UnevenOdometry:
    """Told of the records of a log one by one, it gives them with ways that were told unevenly told in time.

    From a step that is much shorter or longer than those before, records wait until the robot goes on as before:
    if the steps made up for each other, though no robot speeds up and brakes like that, be it by the stamps or by a
    clock that goes evenly, it went the same way at its pace. If none made up for it, and a robot goes otherwise from
    then on, the step is unsure. Stamps that tremble are no such steps, nor is a robot that brakes.
    """

    def __init__(self) -> None:
        self._clock, self._pace, self._run = RecordClock(), _Pace(), _Run()
        self._before: LogRecord | None = None

    def take(self, record: LogRecord) -> list[LogRecord]:
        """Notes the next record; of those that waited and itself, all that need wait no more."""
        self._clock.take(record.time_s)
        waiting = self._run.records
        last = waiting[-1] if waiting else self._before
        since_s, usual_s = self._clock.since_s, self._clock.usual_s
        if last is None or since_s < 0.0 or not usual_s > 0.0:  # a clock set back tells nothing
            return [*self.rest(), self._gone_on(record)]
        motion = last.T_odom_base.inverse() @ record.T_odom_base
        if self._clock.is_brief and motion.is_near(SE2.identity(), NOTHING, NOTHING):
            if not waiting:
                return [self._gone_on(record)]
            self._run.add(record)
            return self.rest() if self._run.is_over else []
        step = _Step(motion.x, max(since_s, BRIEF * usual_s), usual_s)
        if not self._pace.is_uneven(step) and (not waiting or self._run.is_made_up):
            self._pace.take(step)
            return [*self.rest(), self._gone_on(record)]
        self._run.take(record, step, self._pace, self._clock.trembles_s)
        if not self._run.is_over:
            return []
        for one in self._run.steps:
            self._pace.take(one)
        return self.rest()

    def rest(self) -> list[LogRecord]:
        """Those that still wait."""
        run, before = self._run, self._before
        if not run.records or before is None:
            return []
        has_time = run.records[-1].time_s > before.time_s  # stamps may stand
        told = list(run.evenly_from(before)) if run.was_even and has_time else run.as_told()
        self._before, self._run = told[-1], _Run()
        return told

    def _gone_on(self, record: LogRecord) -> LogRecord:
        """A record that need not wait: the next may begin to."""
        self._before = record
        return record


def _off_m(ahead_m: tuple[float, float]) -> float:
    """By how much a way is too long by both clocks, or too short; 0 where it is the one by one and the other by
    the other."""
    one_m, other_m = ahead_m
    return min(abs(one_m), abs(other_m)) if one_m * other_m > 0.0 else 0.0


def _doubted(record: LogRecord, sigma_m: float) -> LogRecord:
    """A record that is as unsure along the way in addition."""
    if sigma_m == 0.0:
        return record
    along_m, heading_rad = record.late_sigma
    return replace(record, late_sigma=(math.hypot(along_m, sigma_m), heading_rad))

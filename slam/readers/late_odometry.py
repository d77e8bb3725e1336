"""Odometry that is told late: it stands while the robot drives on, and makes up for it in one record."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from itertools import takewhile

from slam.readers.log_record import LogRecord
from slam.readers.pace import FASTEST, Pace, UsualSpeed
from slam.readers.record_clock import RecordClock
from slam.readers.record_dropouts import LIKE, NOTHING
from slam.se2 import SE2

_WAITS_S, _WAITING = 10.0, 2048
"""Before so long, or so many records, it is believed to have stood. Chosen."""
_STANDS_S, _LONG_S = 1.0, 2.0
"""For which drivers tell the same several times, and for which no robot stands whose log has one scan of it: those
that record none while they stand have none, and others have some. Chosen."""
_HERE = 0.02, 0.01
"""[m], [rad] of odometry between two scans of one place: these look alike."""
_TOO_FAST, _TOO_FAST_RADPS = 2.0, 2.0
"""Usual speeds, and a turn, that a record makes up by: robots that merely drive on go slower, of 100 records of
aces all but six."""
_ENOUGH, _ENOUGH_RADPS, _DROVE = 0.25, 0.25, 0.5
"""Of the usual speed, and a turn, since odometry stood, that a record must make up for, if that is all of the way; and
of the usual speed, slower than which a robot may have turned on the spot. Chosen: with less, encoders of aces that had
dropped out for 8 s before a fast record made maps that were wrong and good, 0.14 to 0.38 m off (RMS)."""
_TURNS_RADPS = 0.75
"""That any robot may."""
_UNEVEN_PER_S2, _UNEVEN = 0.025, 0.35
"""Share of a way by which a robot is off in the middle of it that is taken to drive evenly: it speeds up and brakes,
and in some seconds may do anything."""
_WINDS_RAD = 0.25
"""It may turn to and fro by, at least. Chosen, all of them."""


class LateOdometry:
    """Told of the records of a log one by one, it gives them with the ways that were told late told in time.

    Records of odometry that stands wait until a scan shows that the robot does, or until odometry moves, each ten
    seconds at most; if it then tells of more than a robot goes in a record, and of about as much as it goes since it stood,
    the robot went there evenly. That is told only where a scan lies between: all others see the way as a whole.
    """

    def __init__(self) -> None:
        self._clock, self._usual = RecordClock(), UsualSpeed()
        self._along, self._turning = Pace(), Pace()
        self._last: LogRecord | None = None
        self._seen: LogRecord | None = None
        self._waiting = deque[LogRecord]()
        self._pace_mps = 0.0
        self._has_stood = False

    def take(self, record: LogRecord) -> list[LogRecord]:
        """Notes the next record; of those that waited and itself, all that need wait no more."""
        self._clock.take(record.time_s)
        last = self._waiting[-1] if self._waiting else self._last
        if last is None:
            return [self._gone_on(record)]
        if record.T_odom_base.is_near(last.T_odom_base, NOTHING, NOTHING):
            return self._standing(record)
        return self._moving(record, last.T_odom_base.inverse() @ record.T_odom_base)

    def rest(self) -> list[LogRecord]:
        """Those that still waited at the end."""
        return self._let_go()

    def _gone_on(self, record: LogRecord) -> LogRecord:
        """A record that need not wait: the next may begin to."""
        self._last = record
        if record.scan is not None:
            self._seen = record
        return record

    def _let_go(self) -> list[LogRecord]:
        """Those that waited, as they are, or that the robot did not stand as they tell."""
        return self._first_let_go(len(self._waiting), self._is_denied())

    def _let_go_old(self) -> list[LogRecord]:
        """Those of them that have waited long enough."""
        first_s, last_s = self._waiting[0].time_s, self._waiting[-1].time_s
        if last_s < first_s:  # a clock that was set back tells not for how long
            return self._let_go()
        old = max(
            len(self._waiting) - _WAITING,
            sum(1 for _ in takewhile(lambda one: one.time_s < last_s - _WAITS_S, self._waiting)),
        )
        let_go = self._first_let_go(old, self._is_denied()) if old > 0 else []
        # somebody may have stood before the laser as the robot stopped
        self._seen = next((one for one in reversed(let_go) if one.scan is not None), self._seen)
        return let_go

    def _first_let_go(self, count: int, is_denied: bool) -> list[LogRecord]:
        let_go = [self._waiting.popleft() for _ in range(count)]
        if let_go:
            self._last = let_go[-1]
        return [replace(one, is_denied=True) for one in let_go] if is_denied else let_go

    def _standing(self, record: LogRecord) -> list[LogRecord]:
        """A record that says the same as the last one."""
        if not self._waiting and self._clock.is_brief:
            return [self._gone_on(record)]
        self._waiting.append(record)
        if record.scan is not None and self._stands_still(record):
            return self._let_go()
        return self._let_go_old()

    def _stands_still(self, record: LogRecord) -> bool:
        """Whether a scan shows that the robot does as odometry says; if it shows that it does not, that is noted."""
        seen = self._seen
        if seen is None or not record.T_odom_base.is_near(seen.T_odom_base, *_HERE):
            self._seen = record
            return False
        assert record.scan is not None
        assert seen.scan is not None
        self._has_stood = record.scan.likeness(seen.scan) >= LIKE
        return self._has_stood

    def _moving(self, record: LogRecord, motion: SE2) -> list[LogRecord]:
        """A record that tells of a motion since the last one."""
        way_m, turn_rad = math.hypot(motion.x, motion.y), abs(motion.theta)
        elapsed_s, told = self._clock.elapsed_s, list(self._waiting)
        if told and self._is_late(record, way_m, turn_rad):
            elapsed_s = record.time_s - self._before.time_s
            *told, record = self._told_in_time(record, motion)
        elif told and self._is_denied(record.time_s - self._before.time_s):
            told = [replace(one, is_denied=True) for one in told]
        self._waiting.clear()
        if way_m <= FASTEST[0] * elapsed_s and turn_rad <= FASTEST[1] * elapsed_s:
            self._along.take(way_m / elapsed_s)
            self._turning.take(turn_rad / elapsed_s)
            self._pace_mps = way_m / elapsed_s
            self._usual.take(self._pace_mps)
        self._has_stood = False
        return [*told, self._gone_on(record)]

    def _is_denied(self, stood_s: float = 0.0) -> bool:
        """Whether the first and the last scan of those that wait deny that the robot stands, or one alone says that
        it stood for so long."""
        scans = [one for one in self._waiting if one.scan is not None]
        if self._has_stood or not scans:
            return False
        first, last = scans[0], scans[-1]
        if first is last:
            return stood_s > _LONG_S
        assert first.scan is not None
        assert last.scan is not None
        return last.time_s - first.time_s >= _STANDS_S and last.scan.likeness(first.scan) < LIKE

    @property
    def _before(self) -> LogRecord:
        """The one that the first of those that wait says the same as."""
        assert self._last is not None
        return self._last

    def _is_late(self, record: LogRecord, way_m: float, turn_rad: float) -> bool:
        """Whether a way may be all that was driven while odometry stood, and no record's."""
        elapsed_s, since_s = self._clock.elapsed_s, record.time_s - self._before.time_s
        usual_mps = self._usual.mps
        if self._has_stood or not since_s > elapsed_s or usual_mps is None:
            return False
        if all(one.scan is None for one in self._waiting):
            return False
        is_way = way_m > usual_mps * max(_TOO_FAST * elapsed_s, _ENOUGH * since_s)
        is_turn = turn_rad > max(_TOO_FAST_RADPS * elapsed_s, _ENOUGH_RADPS * since_s)
        # who drove on, and does not tell of it, has lost it: encoders dropped out, and jumped
        is_turn &= self._pace_mps < _DROVE * usual_mps
        most_m = self._along.most_in(since_s, 0.0, 0.0)
        most_rad = self._turning.most_in(since_s, 0.0, _TURNS_RADPS)
        return (is_way or is_turn) and way_m <= most_m and turn_rad <= most_rad

    def _told_in_time(self, late: LogRecord, motion: SE2) -> Iterator[LogRecord]:
        """Those that waited, evenly on the arc of a motion, and the one that told of it, each as unsure as its
        share of the time."""
        before = self._before
        since_s, tangent = late.time_s - before.time_s, motion.log()
        way_m, turn_rad = math.hypot(motion.x, motion.y), abs(motion.theta)
        # steps that are each as far off by themselves are twice as far off at the end as in the middle of ways
        # of which the ends are known
        uneven = 2.0 * min(_UNEVEN_PER_S2 * since_s**2, _UNEVEN)
        sigma_m = uneven * way_m * (1.0 + turn_rad / 4.0)
        sigma_rad = uneven * max(turn_rad, _WINDS_RAD)
        share = 0.0
        for one in (*self._waiting, late):
            then, share = share, min(max((one.time_s - before.time_s) / since_s, share), 1.0)
            part = math.sqrt(share - then)
            T_odom_base = before.T_odom_base @ SE2.exp(share * tangent)
            yield replace(
                one, T_odom_base=late.T_odom_base if one is late else T_odom_base,
                late_sigma=(part * sigma_m, part * sigma_rad),
            )  # fmt: skip

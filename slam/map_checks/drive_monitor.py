"""What a drive itself says against its map: long ways blind, scans that turn against the wheels."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from slam.frontend.keyframes import FrontEndStep, StepStatus
from slam.frontend.remaining import Remaining
from slam.map_checks.compared_ways import ComparedWays
from slam.measurements import Measurement
from slam.se2 import SE2

_MIRRORED = -0.5
"""Turns by scans per turn by the wheels: 1 where both are right, -1 where one of them counts the
other way round. Chosen, as the turns [rad] that it takes to say so."""
_TURNED = 2.0 * math.pi
_KNOWN_M = 0.3
"""Of a step's own standard deviation; chosen: more, and nothing measured it."""
_SILENT = 1e-6
"""[m], [rad]: wheels that tell of less tell of nothing."""
_STANDS = 0.05, 0.012
"""[m], [rad]: what a scan may show of a robot that stands. Chosen."""
_TURNED_UNTOLD = 0.1
"""[rad] Chosen: less is no turn of which it could be said that wheels told it later."""
_MADE_UP, _MADE_UP_M = 1.0 / 3.0, 0.15
"""Share of a turn that they did not tell, by which wheels that tell it later may be off, and how much more or less of a
way they may tell than scans had shown [m]. Chosen: those of mit-csail told 86 degrees where scans had shown 53 and, at last,
16; by a fan of 90 degrees three of its scans were half a metre off meanwhile, and the way 0.2 m."""
_BRIEF_S = 0.5
"""Between two scans that see where the robot is: how far it went meanwhile these tell. Chosen."""
_SEEN = 3
"""Scans in a row that see where the robot is, after which it is known: one of a hundred between bare walls
seems to, and where nothing measured the way that one may lie anywhere. Chosen: with one of 240 drives
without wheels between bare walls and pillars that look the same 27 were wrong and good."""
_TIED_M = 0.5
"""Standard deviation of the way between two keyframes that loops tell well enough. Chosen: of 20
stretches of simulated logs loops told 2 to 0.3 m and less, and 18 to 1.4 m and more."""


@dataclass(frozen=True)
class _Stretch:
    """Of the way, along what its scans leave open: from when to when [s], between which keyframes of
    the session, and the variance of what the wheels tell of it; is_torn: odometry jumped there."""

    from_s: float
    to_s: float
    first: int
    last: int
    variance_m2: float
    is_torn: bool = False


class DriveMonitor:
    """Follows what scans and wheels of one session tell, scan by scan.

    A step that the wheels deny, where the scan leaves a direction open, may have been far longer.

    most_blind_m: by the wheels alone; after more, nobody knows how far these were off.
    """

    def __init__(self, most_blind_m: float) -> None:
        self._most_blind_m = most_blind_m
        self._turned_together = self._turned_by_wheels = 0.0
        self._ways = ComparedWays()
        self._unknown_m2 = 0.0
        self._open = _Stretch(0.0, 0.0, 0, 0, 0.0)
        self._seen, self._seen_from = 0, 0
        self._long: list[_Stretch] = []
        self._denials = _Denials()
        self._has_jumped = False

    def take(
        self,
        measurement: Measurement,
        T_before: SE2,
        step: FrontEndStep,
        told_m2: float,
        has_jumped: bool = False,
    ) -> None:
        """Notes a scan; T_before: where the front end had placed the one before it; told_m2: variance
        of the motion as it was told, whether it is believed or not; has_jumped: odometry did."""
        variance_m2 = float(measurement.motion_covariance[0, 0])
        self._unknown_m2 = 0.0 if _tells(step) else self._unknown_m2 + variance_m2
        self._take_along(step, variance_m2, has_jumped)
        is_matched = step.is_seen and not step.is_tied
        is_measured = told_m2 < _KNOWN_M**2
        if not (is_matched and is_measured):
            self._ways.interrupt()
        if is_matched:
            moved = T_before.between(step.T_map_base)
            if is_measured:
                self._denials.take(measurement.motion, moved, step)
                self._ways.take(measurement.motion, variance_m2, moved, step)
            self._turned_together += math.copysign(1.0, measurement.motion.theta) * moved.theta
            self._turned_by_wheels += abs(measurement.motion.theta)

    @property
    def keyframes(self) -> set[int]:
        """Of the session, those at the ends of what it remembers."""
        stretches = (*self._long, self._open)
        ends = (k for one in stretches for k in (one.first, one.last))
        return {k for k in (*ends, self._seen_from) if k >= 0}

    def renumber(self, remaining: Remaining) -> None:
        """Keyframes of the session were let go, none of which is one of `keyframes`."""

        def moved(one: _Stretch) -> _Stretch:
            return replace(one, first=number(one.first), last=number(one.last))

        def number(k: int) -> int:
            return remaining.number(k) if k >= 0 else k

        self._long, self._open = [moved(one) for one in self._long], moved(self._open)
        self._seen_from = number(self._seen_from)

    def _is_unknown(self, stretch: _Stretch) -> bool:
        """Whether neither scans nor wheels tell how far the robot went."""
        return stretch.is_torn or stretch.variance_m2 > self._most_blind_m**2

    @property
    def noise_ratio(self) -> float | None:
        """See `ComparedWays`."""
        return self._ways.noise_ratio

    def _take_along(self, step: FrontEndStep, variance_m2: float, has_jumped: bool) -> None:
        """How far nobody knows the robot went along what its scans leave open. Those that tell
        nothing are another matter: the next one that does says where the robot is."""
        self._has_jumped |= has_jumped
        if not _tells(step):
            return
        has_jumped, self._has_jumped = self._has_jumped, False
        if step.is_open:
            self._seen = 0
            self._open = replace(
                self._open,
                to_s=step.time_s,
                last=step.keyframe,
                variance_m2=self._open.variance_m2 + variance_m2,
                is_torn=self._open.is_torn or has_jumped,
            )
            return
        if has_jumped and self._open.variance_m2 > 0.0:
            self._open = replace(self._open, is_torn=True)
        self._seen_from = step.keyframe if self._seen == 0 else self._seen_from
        self._seen += 1
        is_guess = variance_m2 > _KNOWN_M**2
        if is_guess and self._open.variance_m2 > 0.0 and self._seen < _SEEN:
            return
        if self._is_unknown(self._open):  # up to the scan that sees again
            self._long.append(replace(self._open, last=self._seen_from))
        self._open = _Stretch(step.time_s, step.time_s, step.keyframe, step.keyframe, 0.0)

    def objections(
        self, steps: Sequence[FrontEndStep], between_m: Callable[[int, int], float]
    ) -> list[str]:
        """In words, why the map of all these scans, of this session and those before, is no good.

        between_m: how sure it is of where one keyframe of the session lies as seen from another [m],
        by loops as well: what neither scans nor wheels told on the way, these may tell later.
        """
        said = blind_stretches(steps, self._most_blind_m)
        long = [*self._long, self._open]
        long = [one for one in long if self._is_unknown(one)]
        # scans that seem to stand, all of one keyframe, no loop ties; and where odometry jumped, loops to
        # what looks the same tied two of a hundred logs wrongly, by as much as it had jumped
        loose = [
            one
            for one in long
            if one.first == one.last or one.is_torn or between_m(one.first, one.last) > _TIED_M
        ]
        if self._unknown_m2 > self._most_blind_m**2:
            said.append("neither scans nor wheels tell where the robot is at the end")
        elif loose:
            worst = max(loose, key=lambda one: one.variance_m2)
            said.append(
                f"from {worst.from_s:.2f} to {worst.to_s:.2f} s neither scans nor wheels tell how far"
                " the robot went: walls along its way look the same all along"
            )
        if self._denials.first_s is not None:
            said.append(
                f"at {self._denials.first_s:.2f} s the wheels stood still, and the robot did not: how far"
                " it went along walls that look the same nobody knows"
            )
        is_mirrored = self._turned_together < _MIRRORED * self._turned_by_wheels
        if is_mirrored and self._turned_by_wheels > _TURNED:
            said.append(
                "the scans turn the other way round than the wheels: the map may be mirrored"
                " (is the laser mounted upside down, or a wheel's sign wrong?)"
            )
        return said + self._ways.objections()


def blind_stretches(steps: Sequence[FrontEndStep], most_blind_m: float) -> list[str]:
    """In words, where sessions began or ended blind for more than so far: the wheels alone say where
    the robot went. Between two scans that tell something the front end breaks off by itself."""
    said = []
    if not any(step.is_keyframe for step in steps):
        said.append("no scan tells anything: there is nothing on the map")
    first = 0
    for _, of_session in groupby(steps, lambda step: step.session):
        tells = bytes(_tells(step) for step in of_session)
        own, first = steps[first : first + len(tells)], first + len(tells)
        parts = [own]
        if any(tells):
            parts = [own[: tells.index(True) + 1], own[tells.rindex(True) :]]
        for part in parts:
            told = ((step.T_map_base.x, step.T_map_base.y) for step in part)
            places = np.fromiter(told, np.dtype((np.float64, 2)), len(part))
            way_m = float(np.hypot(*np.diff(places, axis=0).T).sum())
            if way_m > most_blind_m:
                said.append(told_by_wheels_alone(part[0].time_s, part[-1].time_s, way_m))
    return said


def told_by_wheels_alone(from_s: float, to_s: float, way_m: float) -> str:
    """That no scan says where the robot was, in words."""
    return (
        f"from {from_s:.2f} to {to_s:.2f} s, over {way_m:.0f} m, no scan tells where the robot is:"
        " these poses are the wheels' alone"
    )


class _Denials:
    """Steps of a robot that stood by its wheels, and moved by scans that leave open how far. Not those
    of odometry that lags: its next motion tells the turn that the scans had shown already; nor those
    just before and after which scans see where the robot is."""

    def __init__(self) -> None:
        self._seen_s = -math.inf
        self._sure_s: float | None = None
        self._doubted_s: float | None = None
        self._T_untold = SE2.identity()
        self._untold_rad = 0.0

    @property
    def first_s(self) -> float | None:
        """When the first of them was [s], None where there was none."""
        return self._doubted_s if self._sure_s is None else self._sure_s

    def take(self, by_wheels: SE2, by_scan: SE2, step: FrontEndStep) -> None:
        """Notes the motion since the last scan, by the wheels and by a scan that was matched."""
        self._judge(by_wheels, by_scan, step)
        if not step.is_open:
            if step.time_s - self._seen_s < _BRIEF_S:
                self._doubted_s = self._before(self._doubted_s)
                self._sure_s = self._before(self._sure_s)
            self._seen_s = step.time_s

    def _before(self, time_s: float | None) -> float | None:
        """A time, if it was before a scan last saw where the robot is."""
        return None if time_s is None or time_s > self._seen_s else time_s

    def _judge(self, by_wheels: SE2, by_scan: SE2, step: FrontEndStep) -> None:
        if max(abs(by_wheels.x), abs(by_wheels.y), abs(by_wheels.theta)) < _SILENT:
            self._untold_rad += by_scan.theta
            self._T_untold = self._T_untold @ by_scan
            is_denied = step.is_open and not by_scan.is_near(SE2.identity(), *_STANDS)
            if is_denied and self._doubted_s is None:
                self._doubted_s = step.time_s
            return
        rest_rad = by_wheels.theta - by_scan.theta - self._untold_rad
        rest_m = _way_m(by_wheels) - _way_m(self._T_untold @ by_scan)
        is_made_up = abs(rest_rad) < _MADE_UP * abs(self._untold_rad) and abs(rest_m) < _MADE_UP_M
        if self._sure_s is None and not (is_made_up and abs(self._untold_rad) > _TURNED_UNTOLD):
            self._sure_s = self._doubted_s
        self._doubted_s, self._untold_rad, self._T_untold = None, 0.0, SE2.identity()


def _way_m(motion: SE2) -> float:
    return math.hypot(motion.x, motion.y)


def _tells(step: FrontEndStep) -> bool:
    return step.is_keyframe or step.status is not StepStatus.CARRIED

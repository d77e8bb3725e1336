"""The way by wheels and by scans, where these leave nothing open: whether both are of one drive, and
how noisy the wheels are, which a log of poses does not say."""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass

from slam.frontend.keyframes import FrontEndStep
from slam.se2 import SE2

_SILENT_M = 1e-6
"""Wheels that tell of less tell of nothing."""
_STEP_M = 0.01
"""Standard deviation of each scan's place beside that of the wheels: see `FrontEndConfig`."""
_MOST_NIS = 20.0
"""Normalised innovation squared of a piece of the way that counts at most: beyond, wheels slipped or
jumped. Chosen."""
_ALIKE = 0.72
"""Way by scans per way by wheels, or the other way round, below which units are not those that were
told. Chosen: ranges halved give 0.69, since the wheels hold against them; wheels are seldom wrong by
a quarter."""
_LEAST_USUAL = 0.2
"""Way by scans for each metre by the wheels, below which it is no scale of theirs. Chosen: with a cart pushed ahead
between bare walls from the first scan on, scans went nowhere, which was taken for what they usually tell; with 0.5 right maps of short logs whose wheels tell
of 2.5 times the way failed."""
_FAR_M = 20.0
"""Of the wheels, that it takes to say so."""
_LEVER_M = 0.5
"""How far from the middle between the wheels a robot's pose may be that is told: for each radian of a turn it swings by as
much, where the laser stands ahead and nobody said so. Chosen."""
_JUMP_M = 2.0
"""Of one step; chosen: farther, odometry has jumped, or scans are too far apart."""
_PIECE_M = 1.0
"""Of the wheels, over which their way is compared with that of the scans. Chosen."""
_SHORT, _SHORT_M = 0.3, 1.0
"""Share of the wheels' way, beyond what the two usually differ by, and what adds up beyond that [m],
by which scans may fall short of them. Chosen: over a metre each, four real logs differ by a quarter
at most; with somebody walking ahead between bare walls, scans go nowhere."""
_LEAST_PIECES = 8
"""Chosen: fewer do not show by how much the two usually differ."""


@dataclass(frozen=True)
class _Piece:
    """Of a way: how far by the wheels and by the scans [m], variance of the first as it was told, how far
    these turned from its start to its end [rad], and when it began and ended [s]."""

    by_wheels_m: float
    by_scans_m: float
    variance_m2: float
    turn_rad: float
    from_s: float
    to_s: float

    @property
    def swing_m(self) -> float:
        """By how much the way by the wheels may be that of a turn."""
        return _LEVER_M * abs(self.turn_rad)


class ComparedWays:
    """Compares the two over a metre at a time: wheels that tell of a way a few scans late are right."""

    def __init__(self) -> None:
        self._pieces: list[_Piece] = []
        self._ahead: tuple[float, float] | None = None
        self._is_after_gap = False
        self._begin()

    def interrupt(self) -> None:
        """Notes a scan that does not tell how far the robot went."""
        self._begin()
        self._is_after_gap = True

    def _begin(self) -> None:
        self._by_wheels_m = self._by_scans_m = self._variance_m2 = self._turn_rad = 0.0
        self._from_s: float | None = None

    def take(self, by_wheels: SE2, variance_m2: float, by_scan: SE2, step: FrontEndStep) -> None:
        """Notes the motion since the last scan, by the wheels and by a scan that was matched. Wheels
        that tell of none may tell of it later: what scans see until then is of the same way."""
        way_m = math.hypot(by_wheels.x, by_wheels.y)
        is_silent = way_m <= _SILENT_M
        if not is_silent:
            self._ahead = by_wheels.x / way_m, by_wheels.y / way_m
        if step.is_open or way_m >= _JUMP_M:
            self.interrupt()
            return
        # the first scan that tells the way again shows what the wheels had been off until then
        is_after_gap, self._is_after_gap = self._is_after_gap, False
        if is_after_gap or self._ahead is None:
            return
        if self._from_s is None:
            self._from_s = step.time_s
        self._by_wheels_m += way_m
        self._turn_rad += by_wheels.theta
        self._variance_m2 += 0.0 if is_silent else variance_m2 + _STEP_M**2
        self._by_scans_m += by_scan.x * self._ahead[0] + by_scan.y * self._ahead[1]
        if self._by_wheels_m > _PIECE_M and not is_silent:
            self._pieces.append(
                _Piece(
                    self._by_wheels_m,
                    self._by_scans_m,
                    self._variance_m2,
                    self._turn_rad,
                    self._from_s,
                    step.time_s,
                )
            )
            self._begin()

    @property
    def _usual(self) -> float:
        """By scans for each metre by the wheels, in the median; 1 where that is not known."""
        if len(self._pieces) < _LEAST_PIECES:
            return 1.0
        median = statistics.median(one.by_scans_m / one.by_wheels_m for one in self._pieces)
        return max(median, _LEAST_USUAL)

    @property
    def noise_ratio(self) -> float | None:
        """Standard deviation along the way that the wheels show, but for their scale, as a share of
        what they were told to have; None where it is not known."""
        if len(self._pieces) < _LEAST_PIECES:
            return None
        usual = self._usual
        squares_m2 = sum(
            min((one.by_scans_m - usual * one.by_wheels_m) ** 2, _MOST_NIS * one.variance_m2)
            for one in self._pieces
        )
        return math.sqrt(squares_m2 / sum(one.variance_m2 for one in self._pieces))

    def objections(self) -> list[str]:
        """In words, that the two are in other units, or that the scans left out some of the way."""
        straight = [one for one in self._pieces if one.swing_m < _SHORT * one.by_wheels_m]
        by_wheels_m = sum(piece.by_wheels_m for piece in straight)
        by_scans_m = sum(piece.by_scans_m for piece in straight)
        if by_wheels_m > _FAR_M and not (
            by_wheels_m * _ALIKE < by_scans_m and by_scans_m * _ALIKE < by_wheels_m
        ):
            return [
                f"where the wheels went {by_wheels_m:.0f} m the scans went {by_scans_m:.0f} m: one of"
                " them may be in other units (ranges and poses are metres, angles radians)"
            ]
        return self._left_out()

    def _left_out(self) -> list[str]:
        """The stretch along which scans fell short of the wheels most: a cumulative sum (Page, 1954)."""
        usual = self._usual
        worst_m, worst = 0.0, (0, 0)
        short_m, first = 0.0, 0
        for k, piece in enumerate(self._pieces):
            expected_m = usual * piece.by_wheels_m
            short_m += (1.0 - _SHORT) * expected_m - piece.swing_m - piece.by_scans_m
            if short_m <= 0.0:
                short_m, first = 0.0, k + 1
            elif short_m > worst_m:
                worst_m, worst = short_m, (first, k)
        if worst_m < _SHORT_M:
            return []
        pieces = self._pieces[worst[0] : worst[1] + 1]
        by_wheels_m = sum(piece.by_wheels_m for piece in pieces)
        by_scans_m = sum(piece.by_scans_m for piece in pieces)
        return [
            f"from {pieces[0].from_s:.2f} to {pieces[-1].to_s:.2f} s the wheels went"
            f" {by_wheels_m:.1f} m and the scans {by_scans_m:.1f} m: the wheels spun, or somebody"
            " walked ahead between walls that look the same"
        ]

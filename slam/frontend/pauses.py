"""Pauses between scans in which a robot may have been carried off."""

from __future__ import annotations

import math
import statistics
from collections import deque
from dataclasses import dataclass

from slam.se2 import SE2

_INTERVALS = 21
"""Between scans, of which the median is the usual one. Chosen."""
_DRIVES = 0.02
"""[m], [rad]: wheels that tell of less tell nothing of how fast the robot is. Chosen."""


@dataclass(frozen=True)
class PauseConfig:
    """intervals: after so many usual ones, and least_s at least, beyond what the way itself takes, a
    robot that has not moved most_m by its wheels may have been carried off. Chosen."""

    intervals: float = 5.0
    least_s: float = 2.0
    most_m: float = 0.8


class Pauses:
    """Knows how long a robot's scans usually are apart, and how fast it usually is: a log that keeps
    a scan each so many metres has none for a while without any pause."""

    def __init__(self, config: PauseConfig | None = None) -> None:
        self.config = config or PauseConfig()
        self._intervals_s: deque[float] = deque(maxlen=_INTERVALS)
        self._paces = tuple(deque[float](maxlen=_INTERVALS) for _ in range(2))

    @property
    def usual_interval_s(self) -> float:
        """Between the last scans, in the median [s]; 0 where there were not two."""
        return statistics.median(self._intervals_s) if self._intervals_s else 0.0

    def take(self, elapsed_s: float, motion: SE2) -> bool:
        """Notes the time since the last scan [s], inf where there is none, and the motion by the
        wheels; whether that was a pause."""
        config, intervals_s = self.config, self._intervals_s
        amounts = math.hypot(motion.x, motion.y), abs(motion.theta)
        is_pause = (
            elapsed_s > config.least_s
            and amounts[0] < config.most_m
            and elapsed_s - self._takes_s(amounts)
            > max(config.least_s, config.intervals * self._known_s)
        )
        if math.isfinite(elapsed_s):
            intervals_s.append(elapsed_s)
            if elapsed_s > 0.0:
                for amount, paces in zip(amounts, self._paces, strict=True):
                    if amount > _DRIVES:
                        paces.append(elapsed_s / amount)
        return is_pause

    @property
    def _known_s(self) -> float:
        """The usual interval, once enough were seen; else inf."""
        return self.usual_interval_s if len(self._intervals_s) == _INTERVALS else math.inf

    def _takes_s(self, amounts: tuple[float, float]) -> float:
        """How long a way [m] and a turn [rad] usually take."""
        return max(
            amount * statistics.median(paces) if paces else 0.0
            for amount, paces in zip(amounts, self._paces, strict=True)
        )

"""The stamps of a log's records: how long each took, as far as they tell."""

from __future__ import annotations

import math
from collections import deque

_INTERVALS = 21
"""Chosen: between records, of which the mean is the usual one. Records may come some at once."""

BRIEF = 0.5
"""Usual intervals, within which a record comes at once with the one before. Chosen."""


class RecordClock:
    """Told the stamp of each record. since_s: from the one before; nan at the first, and of those that stand or
    go back none above 0."""

    def __init__(self) -> None:
        self._last_s = self.since_s = math.nan
        self._intervals_s: deque[float] = deque(maxlen=_INTERVALS)

    def take(self, time_s: float) -> None:
        """The next stamp."""
        self.since_s, self._last_s = time_s - self._last_s, time_s
        if self.since_s > 0.0:
            self._intervals_s.append(self.since_s)

    @property
    def is_known(self) -> bool:
        """Whether the usual interval is."""
        return len(self._intervals_s) == _INTERVALS

    @property
    def usual_s(self) -> float:
        """Between two records lately; 0 where none is known."""
        return sum(self._intervals_s) / max(len(self._intervals_s), 1)

    @property
    def is_brief(self) -> bool:
        """Whether the last record came at once with the one before: it may say again where odometry was."""
        return not self.since_s > BRIEF * self.usual_s

    @property
    def trembles_s(self) -> float:
        """Standard deviation of the intervals lately: a stamp may be off by as much."""
        usual_s = self.usual_s
        squares = sum((one_s - usual_s) ** 2 for one_s in self._intervals_s)
        return math.sqrt(squares / max(len(self._intervals_s), 1))

    @property
    def elapsed_s(self) -> float:
        """What the last record took: as long as usual, where it came at once with another."""
        return max(self.since_s, self.usual_s)

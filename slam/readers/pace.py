"""How fast a robot was told to go, one way of going apart from the other."""

from __future__ import annotations

from slam.running_median import RunningMedian

FASTEST = 4.0, 4.0
"""[m/s], [rad/s] that any robot may go; mit-csail's odometry, which comes late at times, tells of 3.9."""
_FASTER, _LEFT_OUT = 1.5, 2
"""Of the fastest that the robot went before, but for so many: these may have been told late. Chosen, all of them."""
_SPEEDS, _LEAST, _SLOW_MPS = 201, 20, 0.02
"""Remembered, and needed to say how fast the robot usually goes; slower, it stands. Chosen."""


class Pace:
    """How fast a robot went, along or turning."""

    def __init__(self) -> None:
        self._fastest = [0.0] * (1 + _LEFT_OUT)

    def most_in(self, elapsed_s: float, late_s: float, floor: float) -> float:
        """As far it may go in a record, as fast as a floor at least, and in a time before: there no faster than
        ever."""
        fastest = self._fastest[0]
        return max(floor, _FASTER * fastest) * elapsed_s + fastest * late_s

    def take(self, speed: float) -> None:
        """Notes one that may be its own."""
        if speed > self._fastest[0]:
            self._fastest = sorted([*self._fastest[1:], speed])


class UsualSpeed:
    """How fast a robot goes that does not stand."""

    def __init__(self) -> None:
        self._speeds_mps = RunningMedian(_SPEEDS)

    def take(self, speed_mps: float) -> None:
        """Notes one."""
        if speed_mps > _SLOW_MPS:
            self._speeds_mps.take(speed_mps)

    @property
    def mps(self) -> float | None:
        """In the median of the last ones; None where they are too few."""
        return None if len(self._speeds_mps) < _LEAST else self._speeds_mps.median

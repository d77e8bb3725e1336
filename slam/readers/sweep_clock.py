"""When a laser that turns evenly had done its sweeps, though the stamps of its scans jitter."""

from __future__ import annotations

import numpy as np

from slam.arrays import FloatArray

_FEWEST = 20
"""Chosen: of fewer stamps no rhythm is read."""
_GAIN = 0.05
"""Chosen: share of a stamp's lateness by which the sweeps are taken to be late."""
_ROUNDS = 3
"""Chosen: stamps counted by a turn that is 2 % off tell one that is right."""
_OFF_RHYTHM = 0.2
"""Chosen: standard deviation of stamps that follow no rhythm, in turns: even chance has 0.29."""
_NEAR = 0.1
"""Chosen: share by which a laser's turn may differ from what its maker says."""


def rhythm(stamps_s: FloatArray, turn_s: float) -> tuple[float, FloatArray]:
    """How long a turn of the laser took [s], and when the sweeps (N,) were done that were read at
    stamps (N,) [s].

    turn_s: as its maker says. Who reads a laser is now early, now late, and may read a sweep twice
    or miss some; the laser goes on evenly. The times lie on a line, on average at the stamps. Where
    the stamps follow no such rhythm, they are what they are.
    """
    none = turn_s, stamps_s
    if len(stamps_s) < _FEWEST:
        return none
    told_s = float(np.median(np.diff(stamps_s)))
    for _ in range(_ROUNDS):
        if not abs(told_s / turn_s - 1.0) < _NEAR:
            return none
        sweeps = _counted(stamps_s, told_s)
        told_s, start_s = (float(value) for value in np.polyfit(sweeps, stamps_s - stamps_s[0], 1))
    times_s = np.asarray(stamps_s[0] + start_s + told_s * sweeps)
    follows = float(np.std(stamps_s - times_s)) < _OFF_RHYTHM * told_s
    return (told_s, times_s) if follows else none


def _counted(stamps_s: FloatArray, turn_s: float) -> FloatArray:
    """(N,) the number of the sweep of each stamp, as a loop locked to them counts."""
    counts = np.zeros(len(stamps_s))
    due_s = float(stamps_s[0])
    for k in range(1, len(stamps_s)):
        turns = max(round((stamps_s[k] - due_s) / turn_s), 0)
        late_s = stamps_s[k] - due_s - turns * turn_s
        due_s += turns * turn_s + _GAIN * late_s
        counts[k] = counts[k - 1] + turns
    return counts

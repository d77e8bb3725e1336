"""Scans that look as one shortly before did: the robot stands, or what it drives along looks the same."""

from __future__ import annotations

import numpy as np

from slam.arrays import FloatArray, read_only
from slam.beams import Beams
from slam.frontend.strays import apart_m
from slam.kernels.beam_points import same_into
from slam.measurements import BEAM_NOISE
from slam.se2 import SE2

_SAME, _AS_MUCH = 0.9, 0.02
"""Share of the beams of either scan that must measure the same, and by which the oldest one may fall short of
the one that is most the same: what wheels that spun led to looks so as well. Chosen: people pass by."""
_KEPT, _NEW, _LONG_M = 16, (0.05, 0.02), 1.0
"""Scans, the motion [m], [rad] after which one is kept, and how far back. Chosen: all of a longer way along a
corridor looks the same."""

_HERE = 0.15, 0.05
"""[m], [rad] about the last pose within which the robot stood; else it may be driving along what looks the same each
half a metre. Chosen: pillars so far apart put back one of three drives whose wheels were right."""


class StillScans:
    """The last scans, and where they were taken."""

    def __init__(self) -> None:
        # twice the room, so that they move up once in so many scans, and stand in their order
        self._ranges_m: FloatArray = np.empty((2 * _KEPT, 0))
        self._end = 0
        self._places: list[SE2] = []

    def place(self, beams: Beams, T_last: SE2, way_m: float) -> SE2 | None:
        """Where the first of those was taken that a scan looks like, near the last pose. Farther off, if all
        since then looked like it, and the wheels tell of a short way since the last: way_m."""
        count = len(self._places)
        if count == 0 or self._ranges_m.shape[1] != len(beams):
            return None
        shares = np.empty(count)
        kept = read_only(self._ranges_m[self._end - count : self._end])
        if same_into(kept, beams.ranges_m, *BEAM_NOISE, shares) < _SAME:
            return None
        is_near = np.array([apart_m(place, T_last) <= _LONG_M for place in self._places])
        if not (shares[is_near] >= _SAME).any():
            return None
        as_same = is_near & (shares >= shares[is_near].max() - _AS_MUCH)
        first = int(np.argmax(as_same))
        place = self._places[first]
        if not place.is_near(T_last, *_HERE):
            is_all_along = way_m <= _HERE[0] and bool((shares[first:] >= _SAME).all())
            return place if is_all_along else None
        return place

    def take(self, beams: Beams, T_map_base: SE2) -> None:
        """Notes where a scan was taken."""
        if self._ranges_m.shape[1] != len(beams):
            self._ranges_m, self._end, self._places = np.empty((2 * _KEPT, len(beams))), 0, []
        if self._places and T_map_base.is_near(self._places[-1], *_NEW):
            return
        if len(self._places) == _KEPT:
            del self._places[0]
        if self._end == len(self._ranges_m):
            count = len(self._places)
            self._ranges_m[:count] = self._ranges_m[self._end - count :]
            self._end = count
        self._ranges_m[self._end] = beams.ranges_m
        self._end += 1
        self._places.append(T_map_base)

    def forget(self) -> None:
        """Of poses that are no more what they were."""
        self._places = []

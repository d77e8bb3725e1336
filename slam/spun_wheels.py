"""Wheels that spun while the robot stood: where they led, its scans lead back to where it is."""

from __future__ import annotations

import math

from slam.arrays import FloatArray
from slam.se2 import SE2
from slam.surface_map import SurfaceMap, SurfaceMatch
from slam.things_across import without_one_thing

_STANDS, _SAME = (0.15, 0.1), (0.05, 0.02)
"""[m], [rad] within which scans have a robot stand, and within which matches are one."""
_SPUN_M = 1.0
"""Of the wheels meanwhile, after which it is asked: see `ComparedWays`."""
_FITS = 0.95
"""Share of a scan on surfaces. Chosen, all of them."""


class SpunWheels:
    """Follows how far wheels lead a robot that stands by its scans.

    Somebody who walks ahead between bare walls has scans say that as well. From where the wheels led, a scan
    without the one thing that says most of it then fits there; of a robot that stood it leads back. And a laser that
    froze has it jump, once it sees again; a robot that stood goes on from there.
    """

    def __init__(self, surfaces: SurfaceMap) -> None:
        self._surfaces = surfaces
        self._T_stands: SE2 | None = None
        self._T_last = self._by_wheels = SE2.identity()
        self._since_s, self._leads_back = math.nan, False

    def interrupt(self) -> None:
        """Notes a scan that does not tell how far the robot went."""
        self._T_stands = None

    def take(
        self, time_s: float, points: FloatArray, match: SurfaceMatch, motion: SE2
    ) -> float | None:
        """Of a scan with which the robot goes on: since when [s] it had stood whatever the wheels told, if that
        is shown; None if not.

        points: (N, 3) of the scan, faced; motion: by the wheels, since the scan before.
        """
        T_map_base, T_led = match.T_map_base, self._T_last @ motion
        self._T_last = T_map_base
        if self._T_stands is None or not T_map_base.is_near(self._T_stands, *_STANDS):
            is_shown = self._leads_back and self._T_stands is not None
            has_stood = is_shown and T_map_base.is_near(T_led, *_STANDS)
            since_s, self._since_s, self._leads_back = self._since_s, time_s, False
            self._T_stands, self._by_wheels = T_map_base, SE2.identity()
            return since_s if has_stood else None
        self._by_wheels = self._by_wheels @ motion
        if not self._leads_back and math.hypot(self._by_wheels.x, self._by_wheels.y) > _SPUN_M:
            T_there = self._T_stands @ self._by_wheels
            self._leads_back = self._is_led_back(points, T_map_base, T_there)
        return None

    def _is_led_back(self, points: FloatArray, T_here: SE2, T_there: SE2) -> bool:
        """Whether a scan without its one thing fits where it was matched, from where the wheels led as well."""
        off = T_here.inverse() @ T_there
        rest = without_one_thing(self._surfaces, points, math.atan2(off.y, off.x))
        if rest is None:
            return False
        for T_start in (T_here, T_there):
            found = self._surfaces.match_alone(rest, T_start)
            if min(found.inlier_ratio, found.seen_ratio) < _FITS:
                return False
            if not found.T_map_base.is_near(T_here, *_SAME):
                return False
        return True

"""A laser that says nothing, or that something sits on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap

_FEWEST = 3
_TOO_CLOSE_M = 0.1
"""Chosen: what is said to be too close to measure is taken to be so far."""


@dataclass(frozen=True)
class LaserFaultConfig:
    """When a laser is at fault.

    min_hits: a scan of fewer says nothing; of a laser of few beams, half of them are enough, but three
    at least, for the three numbers of a pose. blocked_m, blocked_share: a laser of which that share of
    the beams ends so near, where the map has nothing, is blocked; blocked_all: wherever it is, since
    where a robot can stand, some beams go farther than that. Of something that comes along with the
    robot along_share of the beams see no farther than along_m, where the map has nothing, and within
    along_same_m the same after a way or a turn. Chosen, all of these.
    """

    min_hits: int = 20
    blocked_m: float = 0.2
    blocked_share: float = 0.15
    blocked_all: float = 0.8
    along_share: float = 0.05
    along_m: float = 0.5
    along_same_m: float = 0.02
    along_way_m: float = 0.2
    along_turn_rad: float = math.radians(30.0)


def says_nothing(beams: Beams, beam_count: int, config: LaserFaultConfig) -> str:
    """Why a scan says nothing at all, in words; empty where it may.

    beam_count: of the laser, as far as its scans have told.
    """
    hits = int(np.count_nonzero(beams.is_hit))
    needed = min(config.min_hits, max(_FEWEST, math.ceil(beam_count / 2)))
    if hits >= needed:
        return ""
    if len(beams) >= needed:
        return f"{hits} of {len(beams)} beams came back: no laser, or nothing in its reach"
    had = f" where there were {beam_count} before" if beam_count > len(beams) else ""
    beams_it_has = {0: "no beams", 1: "1 beam"}.get(len(beams), f"{len(beams)} beams")
    return f"the scan has {beams_it_has}{had}; it takes {needed} to tell of a place"


def blocked(
    beams: Beams, T_map_base: SE2, segment_map: SegmentMap, config: LaserFaultConfig
) -> str:
    """That beams end near by where the map has nothing, in words; empty where few do."""
    with np.errstate(invalid="ignore"):
        is_near = beams.ranges_m < config.blocked_m  # -inf, too close, is near as well
    enough = config.blocked_share * len(beams)
    if np.count_nonzero(is_near) <= enough:
        return ""
    walls_m, _ = segment_map.ranges(beams, T_map_base, 2.0 * config.blocked_m)
    near = int(np.count_nonzero(is_near & (walls_m > 1.5 * config.blocked_m)))
    if near <= enough:
        return ""
    return f"{near} of {len(beams)} beams end within {config.blocked_m} m: laser blocked"


def is_covered(beams: Beams, config: LaserFaultConfig) -> bool:
    """Whether so many beams end near by that the laser is blocked, wherever it is."""
    with np.errstate(invalid="ignore"):
        return bool(np.mean(beams.ranges_m < config.blocked_m) > config.blocked_all)


class CompanionMonitor:
    """Something that comes along with the robot in its laser's view: a part of it, or somebody."""

    def __init__(self, config: LaserFaultConfig) -> None:
        self._config = config
        self._then: tuple[SE2, FloatArray] | None = None
        self._said = ""

    def take(self, beams: Beams, T_map_base: SE2, segment_map: SegmentMap) -> str:
        """Notes a scan and where it was taken; what comes along, in words, empty where nothing does."""
        config, then = self._config, self._then
        near_m = self._near_m(beams, T_map_base, segment_map)
        if near_m is None or then is None or len(then[1]) != len(near_m):
            self._then, self._said = (None if near_m is None else (T_map_base, near_m)), ""
        elif not T_map_base.is_near(then[0], config.along_way_m, config.along_turn_rad):
            same = int(np.count_nonzero(np.abs(near_m - then[1]) < config.along_same_m))
            is_along = same > config.along_share * len(beams)
            self._then, self._said = (T_map_base, near_m), ""
            if is_along:
                self._said = (
                    f"{same} of {len(beams)} beams end within {config.along_m} m at what moves along:"
                    " a part of the robot, or somebody beside it"
                )
        return self._said

    def _near_m(self, beams: Beams, T_map_base: SE2, segment_map: SegmentMap) -> FloatArray | None:
        """(N,) ranges that end near by where the map has nothing, nan for the others; None: too few."""
        config = self._config
        ranges_m = np.maximum(beams.ranges_m, _TOO_CLOSE_M)  # -inf, too close, is near as well
        with np.errstate(invalid="ignore"):
            is_near = ranges_m < config.along_m
        enough = config.along_share * len(beams)
        if np.count_nonzero(is_near) <= enough:
            return None
        walls_m, _ = segment_map.ranges(beams, T_map_base, 2.0 * config.along_m)
        near_m = np.where(is_near & (walls_m > 1.5 * ranges_m), ranges_m, np.nan)
        return near_m if np.count_nonzero(np.isfinite(near_m)) > enough else None

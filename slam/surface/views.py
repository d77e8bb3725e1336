"""What single scans say of a map, and the scans between keyframes, kept as small as they can be."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray
from slam.beams import Beams, narrowed
from slam.se2 import SE2
from slam.surface.surface_map import faced

_MOST = 16
"""Chosen: scans kept for each keyframe, so that memory grows with the map and not with the time."""


class View(NamedTuple):
    """A scan on the map: its pose, and in its frame where its beams start, (2,) [m], their
    directions (B,) [rad], increasing, and ranges (B,) [m] as in `LaserScan`."""

    T_map_base: SE2
    origin_m: FloatArray
    angles_rad: FloatArray
    ranges_m: FloatArray

    @staticmethod
    def of(T_map_base: SE2, beams: Beams) -> View:
        """That of beams, where they end as seen from the middle of where they start."""
        return View(T_map_base, beams.middle_m, *beams.from_middle())

    @property
    def beams(self) -> Beams:
        """Its beams, in its frame."""
        origins_m = np.broadcast_to(self.origin_m, (len(self.angles_rad), 2))
        return Beams(origins_m, self.angles_rad, self.ranges_m)

    def faced(self, range_m: float) -> FloatArray:
        """(N, 3) where its beams ended, in its frame, if less than a range away [m], and where the
        surfaces face: see `slam.surface.surface_map`."""
        return faced(self.beams.points_within(range_m), self.origin_m)


class Glance(NamedTuple):
    """A scan as seen from the keyframe before it, otherwise as `View`."""

    T_keyframe_base: SE2
    origin_m: FloatArray
    angles_rad: NDArray[np.float32]
    ranges_m: NDArray[np.float32]

    def view(self, T_map_keyframe: SE2) -> View:
        """Where the keyframe is at a pose."""
        angles_rad, ranges_m = self.angles_rad.astype(np.float64), self.ranges_m.astype(np.float64)
        # read-only as those of beams: to numba that is a type, and kernels would be compiled twice
        angles_rad.flags.writeable = ranges_m.flags.writeable = False
        T_map_base = T_map_keyframe @ self.T_keyframe_base
        return View(T_map_base, self.origin_m, angles_rad, ranges_m)


class Glances:
    """Scans that were taken since a keyframe, evenly over the time until the next."""

    def __init__(self) -> None:
        self._kept: list[Glance] = []
        self._every, self._count = 1, 0

    def take(self, T_keyframe_base: SE2, beams: Beams) -> None:
        """Notes the next scan, if its turn has come."""
        if self._count % self._every == 0 and len(self._kept) == _MOST:
            self._kept = self._kept[::2]
            self._every *= 2
        if self._count % self._every == 0:
            angles_rad, ranges_m = beams.from_middle()
            # scans whose beams start in one place share theirs
            is_own = angles_rad is not beams.angles_rad
            narrow_rad = narrowed(angles_rad) if is_own else beams.narrow_angles_rad
            glance = Glance(T_keyframe_base, beams.middle_m, narrow_rad, narrowed(ranges_m))
            self._kept.append(glance)
        self._count += 1

    @property
    def kept(self) -> tuple[Glance, ...]:
        """Those kept, at most 16."""
        return tuple(self._kept)

    def move(self, ways: Mapping[SE2, SE2]) -> None:
        """Has those that were taken elsewhere than it seemed lie where they were: by their ways from the keyframe."""
        self._kept = [
            one._replace(T_keyframe_base=ways.get(one.T_keyframe_base, one.T_keyframe_base))
            for one in self._kept
        ]

    def kept_but(self, strayed: Set[SE2]) -> tuple[Glance, ...]:
        """Those kept, but for such as were not taken where they seemed to be."""
        return tuple(one for one in self._kept if one.T_keyframe_base not in strayed)

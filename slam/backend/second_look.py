"""Keyframes that may have strayed, asked whether they did before they are as old as those that are let go."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from slam.arrays import FloatArray
from slam.frontend.keyframes import Keyframe
from slam.frontend.strays import StrayConfig, StraySearch
from slam.frontend.told_steps import ToldStep
from slam.surface.surface_map import SurfaceMap, SurfaceMapConfig


class SecondLook:
    """Goes through a drive's keyframes a while after they were taken, one with each new one.

    Where scans alone tell the way, it is taken for an even one, and each that comes to a corner may have strayed from
    that: of those that could be put back the scan is kept until the end, of the others it need not be.
    """

    def __init__(self, recent: int, config: StrayConfig, surfaces: SurfaceMapConfig) -> None:
        """recent: keyframes that are never let go."""
        self._config, self._surfaces = config, SurfaceMap(surfaces)
        self._beside = config.half + max(config.runs)
        self._age = recent - 2 * self._beside
        self._has_strayed = deque[bool](maxlen=2 * self._beside + 1)

    def next(
        self, keyframes: Sequence[Keyframe], poses: FloatArray, told: Sequence[ToldStep]
    ) -> int | None:
        """The number of the next keyframe of which it is known that neither it nor any of those that are looked at
        with it has strayed, if it is one; asked with each new one. poses (K, 3) [m, rad] of the keyframes; told: of
        the last of them, those of the drive, what the wheels say of the way to each."""
        asked, first = len(keyframes) - self._age, len(keyframes) - len(told)
        if self._age < self._beside or asked <= first:
            return None
        search = StraySearch(keyframes, told, self._config, self._surfaces)
        runs = (run for run in set(self._config.runs) if asked + run < len(keyframes))
        self._has_strayed.append(
            any(search.on_the_way(poses, asked, run) is not None for run in runs)
        )
        is_known = len(self._has_strayed) == self._has_strayed.maxlen
        return None if any(self._has_strayed) or not is_known else asked - self._beside

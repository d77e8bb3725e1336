"""Keyframes that may have strayed, asked whether they did before they are as old as those that are let go."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from slam.arrays import FloatArray
from slam.frontend.keyframes import Keyframe
from slam.frontend.strays import StrayConfig, StraySearch
from slam.frontend.told_steps import ToldStep
from slam.surface.surface_map import SurfaceMap, SurfaceMapConfig


class SecondLook:
    """Goes through a drive's keyframes a while after they were taken, one with each new one.

    Where scans alone tell the way, it is taken for an even one, and each that comes to a corner may have strayed from
    that: of those that can be put back, and of those beside them, the scans are kept until the end.
    """

    def __init__(self, recent: int, config: StrayConfig, surfaces: SurfaceMapConfig) -> None:
        """recent: keyframes that are never let go."""
        self._config, self._surfaces = config, SurfaceMap(surfaces)
        self._beside = config.half + max(config.runs)
        self._age = recent - 2 * self._beside
        window = 2 * self._beside + 1
        self._strayed, self._is_needless = deque[bool](maxlen=window), deque[bool](maxlen=window)

    def next(
        self,
        keyframes: Sequence[Keyframe],
        poses: FloatArray,
        told: Sequence[ToldStep],
        is_needless: Callable[[int], bool],
    ) -> int | None:
        """The number of the next keyframe whose scan is needless, and of which it is known that neither it nor any of
        those that are looked at with it has strayed, if it is one; to be called with each new one.

        poses: (K, 3) [m, rad] of the keyframes; told: of the last of them, those of the drive, what the wheels say of
        the way to each. is_needless: whether others saw what one of them saw; asked once of each.
        """
        asked, first = len(keyframes) - self._age, len(keyframes) - len(told)
        if self._age <= self._beside or asked <= first:
            return None
        self._is_needless.append(is_needless(asked + self._beside))
        # of who is beside none that is needless, nobody asks it
        has_strayed = any(self._is_needless) and self._has_strayed(keyframes, poses, told, asked)
        self._strayed.append(has_strayed)
        is_known = len(self._strayed) == self._strayed.maxlen
        if not is_known or any(self._strayed) or not self._is_needless[0]:
            return None
        return asked - self._beside

    def _has_strayed(
        self, keyframes: Sequence[Keyframe], poses: FloatArray, told: Sequence[ToldStep], k: int
    ) -> bool:
        search = StraySearch(keyframes, told, self._config, self._surfaces)
        runs = (run for run in set(self._config.runs) if k + run < len(keyframes))
        return any(search.on_the_way(poses, k, run) is not None for run in runs)

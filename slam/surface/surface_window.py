"""The surfaces that the last keyframes saw: those of each leave again with it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from slam.arrays import FloatArray
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMap, SurfaceMapConfig, moved


class SurfaceWindow:
    """Surfaces of a number of keyframes, with those of new ones in the place of the oldest."""

    def __init__(self, keyframes: int, config: SurfaceMapConfig | None = None) -> None:
        self.surfaces = SurfaceMap(config)
        self._most, self._learnt = keyframes, deque[FloatArray]()

    def __len__(self) -> int:
        return len(self._learnt)

    def learn(self, T_map_base: SE2, points: FloatArray) -> None:
        """Takes up what a keyframe shows in faced points (N, 3), base frame."""
        points_map = moved(T_map_base, self.surfaces.thinned(points))
        self.surfaces.add(points_map)
        self._learnt.append(points_map)
        if len(self._learnt) > self._most:
            self.surfaces.remove(self._learnt.popleft())

    def forget(self) -> None:
        """Lets go of all that was seen."""
        while self._learnt:
            self.surfaces.remove(self._learnt.popleft())

    def leave_out_last(self, count: int) -> None:
        """Lets go of what the last keyframes saw; fewer than there are."""
        for _ in range(count):
            self.surfaces.remove(self._learnt.pop())

    def learn_all(self, seen: Iterable[tuple[SE2, FloatArray]]) -> None:
        """Takes up what several keyframes saw, one after the other."""
        for T_map_base, points in seen:
            self.learn(T_map_base, points)

"""What stands along a bare way before and after a stretch over which wheels alone tell how far the robot went.

If scans after it show what those before it showed, and all of it farther on or back, then the wheels spun or told
late of a way, or somebody moved what stood there. Nobody can tell, and the map is as wrong as it was moved.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slam.contradictions import passed
from slam.front_end_config import FrontEndConfig
from slam.keyframes import FrontEndStep, Keyframe
from slam.se2 import SE2
from slam.slam_map import SlamMap
from slam.surface_map import SurfaceMap, moved

_BEFORE, _AFTER, _LEAST = 8, 5, 3
"""Keyframes on either side of the stretch that are asked, and that must say so. Chosen: who walks is elsewhere in
each of them."""
_LONG_M = 4.0
"""Chosen: after a longer stretch little is in view of what was before it."""
_ALIKE_M = 0.1
"""Within which scans say by how much it is off. Chosen: of wheels that spin by 0.6 to 1 m while somebody hides all
ahead, they agree to 2 mm."""
_FEW, _LEFT = 3, 0.2
"""Points that two scans look through of one another where the map has them, and share of these that are left where
the one fits. Chosen."""


def moved_things(
    slam_map: SlamMap, first_step: int, config: FrontEndConfig | None = None
) -> list[str]:
    """In words, that what stands along a bare way is not where it was; first_step: with which the last session
    begins."""
    config = config or FrontEndConfig()
    steps = [step for step in slam_map.steps[first_step:] if step.is_keyframe]
    for first, last in _open_stretches(steps):
        ways_m = np.hypot(*np.diff(slam_map.poses[first - 1 : last + 1, :2], axis=0).T)
        if ways_m.sum() > _LONG_M:
            continue
        before = _placed(slam_map, max(steps[0].keyframe, first - _BEFORE), first)
        off_m = _off_m(before, _placed(slam_map, last + 1, last + 1 + _AFTER), config)
        if off_m is not None:
            from_s, to_s = (slam_map.keyframes[k].time_s for k in (first - 1, last + 1))
            return [
                f"what stood along a bare way until {from_s:.2f} s stands {off_m:.2f} m off from {to_s:.2f} s on:"
                " wheels spun or told late of the way, or somebody moved it"
            ]
    return []


def _placed(slam_map: SlamMap, start: int, stop: int) -> list[tuple[Keyframe, SE2]]:
    """Keyframes of a map and their poses, but for those of which no more than the place is kept."""
    rows = slice(start, stop)
    return [
        (one, SE2.from_array(pose))
        for one, pose in zip(slam_map.keyframes[rows], slam_map.poses[rows], strict=True)
        if not one.is_place_alone
    ]


def _open_stretches(steps: Sequence[FrontEndStep]) -> list[tuple[int, int]]:
    """First and last of keyframes in a row whose scans leave open how far the robot went to them; not the first
    of all."""
    stretches: list[tuple[int, int]] = []
    for step in steps[1:]:
        if step.is_open:
            goes_on = bool(stretches) and stretches[-1][1] == step.keyframe - 1
            first = stretches.pop()[0] if goes_on else step.keyframe
            stretches.append((first, step.keyframe))
    return stretches


def _off_m(
    before: Sequence[tuple[Keyframe, SE2]],
    after: Sequence[tuple[Keyframe, SE2]],
    config: FrontEndConfig,
) -> float | None:
    """By how much things are off after a stretch [m], if enough scans say so, and the same."""
    if min(len(before), len(after)) < _LEAST:
        return None
    surfaces = SurfaceMap(config.surfaces)
    for one, T in before:
        surfaces.add(moved(T, one.faced))
    offs = [_off(surfaces, before, one, T, config) for one, T in after]
    told = np.array([(off.x, off.y) for off in offs if off is not None])
    if len(told) == 0:
        return None
    middle = np.median(told, axis=0)
    is_alike = np.hypot(*(told - middle).T) < _ALIKE_M
    return float(np.hypot(*middle)) if is_alike.sum() >= _LEAST else None


def _off(
    surfaces: SurfaceMap,
    before: Sequence[tuple[Keyframe, SE2]],
    keyframe: Keyframe,
    T_map_keyframe: SE2,
    config: FrontEndConfig,
) -> SE2 | None:
    """Where a keyframe fits among what others saw before, as seen from where it lies; None if these do not deny
    that it lies there, or if they deny that it is elsewhere."""
    found = surfaces.match_alone(keyframe.faced, T_map_keyframe)
    here, there = (
        [passed(one, keyframe, at.inverse() @ T, config.denial.margins)[1] for one, T in before]
        for at in (T_map_keyframe, found.T_map_base)
    )
    is_denied = sum(count >= _FEW for count in here) >= _LEAST
    is_denied &= sum(there) <= _LEFT * sum(here)
    return T_map_keyframe.inverse() @ found.T_map_base if is_denied else None

"""What stands along a bare way before and after a stretch over which wheels alone tell how far the robot went.

If scans after it show what those before it showed, and all of it farther on or back, then the wheels spun or told
late of a way, or somebody moved what stood there. Nobody can tell, and the map is as wrong as it was moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from slam.frontend.contradictions import passed
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.keyframes import FrontEndStep, Keyframe
from slam.loop_closing import without_ties
from slam.map_checks.map_drift import sigmas_m
from slam.se2 import SE2
from slam.slam_map import SlamMap, graph_of
from slam.surface.surface_map import SurfaceMap, moved

_SAID = "what stood along a bare way"
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
_KNOWN = 1.0 / 3.0
"""Share of how far things are off, to which loops tell how far the robot went (standard deviation), so that they were
moved. Chosen."""


def moved_things(slam_map: SlamMap, config: FrontEndConfig | None = None) -> list[str]:
    """In words, that what stands along a bare way is not where it was, and no loops tell what became of the robot."""
    config, offs_m = config or FrontEndConfig(), dict[tuple[int, int], float]()
    of_keyframes = [step for step in slam_map.steps if step.is_keyframe]
    for first, last in _open_stretches(of_keyframes, slam_map.keyframes):
        ways_m = np.hypot(*np.diff(slam_map.poses[first - 1 : last + 1, :2], axis=0).T)
        if ways_m.sum() > _LONG_M:
            continue
        off_m = _off_m(*_beside(slam_map, first, last), config)
        if off_m is not None:
            offs_m[first, last] = off_m
    times_s = [one.time_s for one in slam_map.keyframes]
    return [
        f"{_SAID} until {times_s[first - 1]:.2f} s stands {off_m:.2f} m off from {times_s[last + 1]:.2f} s on:"
        " wheels spun or told late of the way, or somebody moved it"
        for (first, last), off_m in _untold_by_loops(slam_map, offs_m).items()
    ]


def is_all_that_is_said(reasons: Sequence[str]) -> bool:
    """Whether that is why a map failed: without its wheels the things would say where the robot went, and somebody
    may have moved them."""
    return bool(reasons) and all(reason.startswith(_SAID) for reason in reasons)


def _beside(
    slam_map: SlamMap, first: int, last: int
) -> tuple[list[tuple[Keyframe, SE2]], list[tuple[Keyframe, SE2]]]:
    """Keyframes before and after a stretch, and their poses: of its session and next to it, but for those of which no more
    than the place is kept."""
    keyframes, session = slam_map.keyframes, slam_map.keyframes[first].session

    def is_next(k: int, after: int) -> bool:
        return keyframes[k].session == session and not keyframes[after].is_after_gap

    start, stop = first, last + 1
    while start > max(first - _BEFORE, 0) and is_next(start - 1, start):
        start -= 1
    while stop < min(last + 1 + _AFTER, len(keyframes)) and is_next(stop, stop):
        stop += 1
    before, after = (
        [
            (one, SE2.from_array(pose))
            for one, pose in zip(keyframes[rows], slam_map.poses[rows], strict=True)
            if not one.is_place_alone
        ]
        for rows in (slice(start, first), slice(last + 1, stop))
    )
    return before, after


def _open_stretches(
    steps: Sequence[FrontEndStep], keyframes: Sequence[Keyframe]
) -> list[tuple[int, int]]:
    """First and last of keyframes in a row whose scans leave open how far the robot went to them; not the first
    of a session, and none past others that were let go. steps: of the keyframes."""
    stretches: list[tuple[int, int]] = []
    for before, step in pairwise(steps):
        is_next = step.session == before.session and not keyframes[step.keyframe].is_after_gap
        if step.is_open and is_next:
            goes_on = bool(stretches) and stretches[-1][1] == before.keyframe
            first = stretches.pop()[0] if goes_on else step.keyframe
            stretches.append((first, step.keyframe))
    return stretches


def _untold_by_loops(
    slam_map: SlamMap, offs_m: dict[tuple[int, int], float]
) -> dict[tuple[int, int], float]:
    """Stretches of which loops do not say how far the robot went, be the wheels wrong by so much on all of them: there
    and back they may be so by as much."""
    if not offs_m:
        return {}
    keyframes = list(slam_map.keyframes)
    for (first, last), off_m in offs_m.items():
        loose = np.diag([off_m**2, off_m**2, 0.0])
        for k in range(first, last + 2):
            keyframes[k] = replace(keyframes[k], covariance=keyframes[k].covariance + loose)
    graph = graph_of(keyframes, without_ties(slam_map.loops), slam_map.poses)
    known_m = sigmas_m(graph.solve(), np.array([(first - 1, last + 1) for first, last in offs_m]))
    return {
        stretch: off_m
        for (stretch, off_m), sigma_m in zip(offs_m.items(), known_m, strict=True)
        if sigma_m >= _KNOWN * off_m
    }


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

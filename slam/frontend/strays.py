"""Keyframes that lie aside of the way between those before and after them, and fit on it as well.

Somebody who stood in view once more draws a scan along a wall: beside him, half a metre off, it fits
better than where it was taken. The next scan shows it, but the front end does not look back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from slam.arrays import FloatArray
from slam.frontend.keyframes import Keyframe
from slam.frontend.told_steps import ToldStep
from slam.frontend.witnesses import Witnesses
from slam.loop_closing import Loop
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMap, SurfaceMapConfig, moved
from slam.surface.surface_match import SurfaceMatch


@dataclass(frozen=True)
class StrayConfig:
    """Which keyframes are looked at once more, and what is believed then.

    least_m: off the way; nearer ones are as good as they are. runs: so many keyframes in a row may
    have strayed together, tried in this order. half: keyframes to either side whose surfaces are
    looked at. reach_m, reach_rad: around the way. nearer: share of what it was off, within which a
    scan that fits as well, and alone agrees better with the wheels if there are any, lies on the way.
    torn: of the wheels' normalised error squared on from it, from which it does not lie there alone.
    least_facing: of what it sees there, as in `FrontEndConfig`: where a scan leaves its place open,
    wheels know better. better: cost by which it must fit better where wheels lead back to it, which did
    not lead there, but if it slides there by itself. margins, aside_m: see `Witnesses`.
    standing: share of a scan that stands, of which what looks through the rest is believed. Chosen, all of these.
    """

    least_m: float = 0.2
    runs: tuple[int, ...] = (1, 2, 1)
    half: int = 8
    reach_m: float = 0.4
    reach_rad: float = 0.3
    nearer: float = 0.5
    torn: float = 40.0
    least_facing: float = 0.003
    better: float = 0.03
    margins: tuple[float, float] = (0.25, 0.03)
    aside_m: float = 0.1
    standing: float = 0.75


def without_strays(
    keyframes: Sequence[Keyframe],
    loops: Sequence[Loop],
    poses: FloatArray,
    told: Sequence[ToldStep],
    config: StrayConfig | None = None,
    surfaces: SurfaceMapConfig | None = None,
) -> tuple[list[Keyframe], list[Loop], FloatArray, list[int]]:
    """Keyframes at poses (K, 3) [m, rad], those of them that had strayed put back on the way.

    told: of the last keyframes, what the wheels say of the way to each; those before stay. Also the
    loops, without those to a keyframe that was not where it was thought to be; the poses; and which
    keyframes were put back.
    """
    config = config or StrayConfig()
    search, stays = StraySearch(keyframes, told, config, SurfaceMap(surfaces)), set[int]()
    while True:
        found, moved_poses, strays = _put_back(keyframes, poses, search, stays, config)
        alone = {k for k in strays if k + 1 not in strays and search.is_torn(poses, moved_poses, k)}
        if not alone:
            break
        stays |= alone  # what followed did not come back to the way as well
    kept = [loop for loop in loops if loop.earlier not in strays and loop.later not in strays]
    return found, kept, moved_poses, sorted(strays)


def _put_back(
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
    search: StraySearch,
    stays: Set[int],
    config: StrayConfig,
) -> tuple[list[Keyframe], FloatArray, set[int]]:
    """Keyframes at poses (K, 3) put back on the way, those poses, and which they are; not those that stay."""
    found, moved_poses, strays = list(keyframes), poses.copy(), set[int]()
    for run in config.runs:
        for k in range(search.first + 1, len(keyframes) - run):
            match = None if k in stays else search.on_the_way(moved_poses, k, run)
            if match is not None:
                moved_poses[k] = match.T_map_base.as_array()
                strays.add(k)
                for at in (k, k + 1):
                    start, end = (SE2.from_array(pose) for pose in moved_poses[at - 1 : at + 1])
                    # over a break nobody knows the way better than before
                    known = found[at].covariance if found[at].is_break else match.covariance
                    found[at] = replace(found[at], T_before=start.inverse() @ end, covariance=known)
    return found, moved_poses, strays


def may_have_strayed(
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
    index: int,
    told: Sequence[ToldStep],
    config: StrayConfig | None = None,
) -> bool:
    """Whether a keyframe, or one of those about it that are looked at with it, lies aside of the way
    between those before and after it, or of two that do so together. told: see `without_strays`."""
    config, first = config or StrayConfig(), len(keyframes) - len(told)
    start = index - config.half - max(config.runs) + 1
    about = range(max(start, first + 1), min(index + config.half + 1, len(keyframes)))
    ways = (
        (k, _way(keyframes, poses, k, (k - 1, k + run), told[k - first]))
        for k in about
        for run in set(config.runs)
        if k + run < len(keyframes)
    )
    return any(apart_m(way, SE2.from_array(poses[k])) >= config.least_m for k, way in ways)


class StraySearch:
    """Looks for keyframes on the way between their neighbours. told: see `without_strays`."""

    def __init__(
        self,
        keyframes: Sequence[Keyframe],
        told: Sequence[ToldStep],
        config: StrayConfig,
        surfaces: SurfaceMap,
    ) -> None:
        self._keyframes, self._config, self._surfaces = keyframes, config, surfaces
        self._told, self.first = told, len(keyframes) - len(told)

    def is_torn(self, poses: FloatArray, moved_poses: FloatArray, k: int) -> bool:
        """Whether wheels that led on from a keyframe at poses (K, 3) to the next one do so no more at others."""
        on = self._told[k + 1 - self.first]
        if on.is_guess or self._keyframes[k + 1].is_break:
            return False
        before, now = (
            on.squared(*(SE2.from_array(pose) for pose in of[k : k + 2]))
            for of in (poses, moved_poses)
        )
        return now > self._config.torn > before

    def on_the_way(self, poses: FloatArray, k: int, run: int) -> SurfaceMatch | None:
        """Where a keyframe, the first of a run that may have strayed, fits on the way; None where it
        is near that, or belongs where it is."""
        keyframes, before, after = self._keyframes, k - 1, k + run
        # those that come back to the way may fit nothing that the strays saw
        if any(one.is_break for one in keyframes[k:after]) or keyframes[k].is_place_alone:
            return None
        if any(one.is_after_gap for one in keyframes[k : after + 1]):
            return None
        T_now = SE2.from_array(poses[k])
        T_way = _way(keyframes, poses, k, (before, after), self._told[k - self.first])
        best, stays = self._matched(poses, (before, k, after), T_way)
        if best is not None and (
            run > 1 or self._squared(poses, k, best.T_map_base) < self._squared(poses, k, T_now)
        ):
            return best
        on = self._told[after - self.first]
        if run > 1 or on.is_guess or keyframes[after].is_break:
            return None
        # odometry that jumped on the way to it led it aside, and on from it tells the way back
        T_back = SE2.from_array(poses[after]) @ on.motion.inverse()
        best, stays = self._matched(poses, (before, k, after), T_back)
        if best is None or stays is None:
            return None
        has_slid = apart_m(stays.T_map_base, best.T_map_base) < 0.5 * self._config.least_m
        return best if has_slid or best.cost < stays.cost - self._config.better else None

    def _matched(
        self, poses: FloatArray, at: tuple[int, int, int], T_way: SE2
    ) -> tuple[SurfaceMatch | None, SurfaceMatch | None]:
        """Where a keyframe fits near a pose on the way, at least as well as where it is, if it lies
        aside of that; and the match from where it is. at: the one before, it, the one after."""
        before, k, after = at
        config, one = self._config, self._keyframes[k]
        T_now = SE2.from_array(poses[k])
        off_m = apart_m(T_way, T_now)
        if off_m < config.least_m:
            return None, None
        ends = before, after
        surfaces_beside(self._surfaces, self._keyframes, poses, ends, config)
        points = one.faced
        if self._told[k - self.first].is_guess:  # who drew it aside is no part of the place
            points = standing_on_way(one, T_way, self._keyframes, poses, ends, config)
        starts = [T_way, *self._surfaces.searched(points, T_way, config.reach_m, config.reach_rad)]
        stays = self._surfaces.match_alone(points, T_now)
        matches = [stays, *(self._surfaces.match_alone(points, start) for start in starts)]
        self._surfaces.clear()
        best = min(
            (one for one in matches if apart_m(T_way, one.T_map_base) < config.nearer * off_m),
            key=lambda one: one.cost,
            default=None,
        )
        if best is None or best.cost > stays.cost or best.least_facing < config.least_facing:
            return None, stays
        return best, stays

    def _squared(self, poses: FloatArray, k: int, T_map_base: SE2) -> float:
        """Normalised error squared of the wheels, to a keyframe at a pose and on from it."""
        T_before, T_after = SE2.from_array(poses[k - 1]), SE2.from_array(poses[k + 1])
        to, on = self._told[k - self.first], self._told[k + 1 - self.first]
        return to.squared(T_before, T_map_base) + on.squared(T_map_base, T_after)


def surfaces_beside(
    surfaces: SurfaceMap,
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
    ends: tuple[int, int],
    config: StrayConfig,
) -> None:
    """Adds the surfaces that keyframes at poses (K, 3) saw up to one and from another on, as far as they stand."""
    before, after = ends
    first, last = max(before - config.half + 1, 0), min(after + config.half, len(keyframes))
    first = max((k for k in range(first, after) if not keyframes[k].goes_on), default=first)
    last = min((k for k in range(after + 1, last) if not keyframes[k].goes_on), default=last)
    witnesses = Witnesses(keyframes[first:last], poses[first:last], config.margins, config.aside_m)
    for k in (*range(first, before + 1), *range(after, last)):
        standing = keyframes[k].faced[witnesses.stands(k - first)]
        surfaces.add(moved(SE2.from_array(poses[k]), surfaces.thinned(standing)))


def standing_on_way(
    one: Keyframe,
    T_way: SE2,
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
    ends: tuple[int, int],
    config: StrayConfig,
) -> FloatArray:
    """(N, 3) faced points of a scan, without those that keyframes up to one and from another on look through if it
    was taken at a pose on the way; all of them where too few stand: then it was not."""
    before, after = ends
    earlier = range(max(before + 1 - config.half, 0), before + 1)
    later = range(after, min(after + config.half, len(keyframes)))
    witnesses = Witnesses(
        [*(keyframes[k] for k in earlier), one, *(keyframes[k] for k in later)],
        np.concatenate([poses[earlier], [T_way.as_array()], poses[later]]),
        config.margins,
        config.aside_m,
    )
    is_standing = witnesses.stands(len(earlier))
    standing: FloatArray = one.faced[is_standing]
    return standing if is_standing.mean() >= config.standing else one.faced


def _way(
    keyframes: Sequence[Keyframe], poses: FloatArray, k: int, ends: tuple[int, int], told: ToldStep
) -> SE2:
    """Where a keyframe would be by the wheels, or on an even way between two others."""
    before, after = ends
    T_start = SE2.from_array(poses[before])
    if not told.is_guess:
        return T_start @ told.motion
    start_s, end_s = keyframes[before].time_s, keyframes[after].time_s
    share = 1.0 / (after - before)
    if end_s > start_s:
        share = min(max((keyframes[k].time_s - start_s) / (end_s - start_s), 0.0), 1.0)
    way = (T_start.inverse() @ SE2.from_array(poses[after])).log()
    return T_start @ SE2.exp(share * way)


def apart_m(one: SE2, other: SE2) -> float:
    """Between two places [m], however the poses are turned."""
    return math.hypot(other.x - one.x, other.y - one.y)

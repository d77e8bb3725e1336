"""Where a new session lies on the map of those before: searched for, followed, and verified."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slam.arrays import FloatArray
from slam.frontend.kept_keyframes import has_scan
from slam.frontend.keyframes import Keyframe
from slam.frontend.remaining import Remaining
from slam.guard.look import Look
from slam.guard.verdict_limits import VerdictLimits
from slam.in_steps import Steps, all_at_once
from slam.known_map import KnownMap, laser_seen
from slam.loop_closing import Loop, LoopCloser, renumbered
from slam.lost import Guard
from slam.map_checks.map_consistency import ConsistencyConfig
from slam.pose_arrays import composed
from slam.se2 import SE2
from slam.slam_map import surfaces_seen
from slam.verdict import Status

_LOOPS = 5
"""What it costs to ask a keyframe for the loops that it closes: see `Steps`."""
_ASIDE_M = 10.0
"""Between the map and a session that was never joined with it; chosen: to be seen as such."""


@dataclass(frozen=True)
class JoiningConfig:
    """When a session is joined with the map of those before it.

    least_loops: keyframes, least_way_m apart at least, that see the map where one and the same place
    of the session lets them, within near (m, rad). back: keyframes before the one at which a place
    was found that are asked as well, at_a_time of them with each keyframe; tried: of one of which the search is not
    sure. patience: keyframes after
    which a place that did not hold is given up. sigma: (m, rad) of a place that was found,
    start_sigma: of a start that was given. eager: keyframes looked for one by one, and burst: of as
    many later ones, where searching would cost too much. work: between two scans, in looks at one
    scan for one pose, of which a search takes 100 to 500; these take some 60 ms. unhurried: as many
    times that where scans come more than a second apart. against: the session's scans against those
    before; what it lets pass is twice what a map may have, since things move between sessions;
    first_check: keyframes after which they are set against each other first, and most_checked pairs.
    Chosen, all of these.
    """

    least_loops: int = 3
    least_way_m: float = 0.8
    near: tuple[float, float] = (0.3, math.radians(5.0))
    back: int = 8
    at_a_time: int = 2
    tried: int = 5
    patience: int = 12
    sigma: tuple[float, float] = (0.15, 0.05)
    start_sigma: tuple[float, float] = (0.5, 0.2)
    eager: int = 60
    burst: int = 15
    work: float = 100.0
    unhurried: float = 6.0
    first_check: int = 25
    most_checked: int = 300
    against: ConsistencyConfig = field(
        default_factory=lambda: ConsistencyConfig(most_passed=0.12, most_bad_pairs=0.1)
    )


@dataclass(frozen=True, eq=False)
class Join:
    """The frame of a session as seen from the map, and the loops that say so."""

    T_map_session: SE2
    loops: tuple[Loop, ...]

    def moved(self, poses: FloatArray, first: int) -> FloatArray:
        """Poses (K, 3), those from the session's first on moved to where they are on the map."""
        return _moved(poses, first, self.T_map_session)


class SessionJoiner:
    """Looks for the place of one session, keyframe by keyframe."""

    def __init__(
        self,
        keyframes: Sequence[Keyframe],
        poses: FloatArray,
        closer: LoopCloser,
        is_start_known: bool = False,
        config: JoiningConfig | None = None,
    ) -> None:
        """keyframes: of the sessions before, at poses (K, 3). is_start_known: those of the new one
        are where they are told to be, more or less.

        Raises ValueError for a map without a wall, if the start is not known.
        """
        self.config = config or JoiningConfig()
        self._closer, self._first = closer, len(keyframes)
        self._is_start_known = is_start_known
        self._place = SE2.identity() if is_start_known else None
        self._known: KnownMap | None = None
        if not is_start_known:
            laser = laser_seen([keyframe.beams for keyframe in keyframes])
            self._known = KnownMap.of_surfaces(surfaces_seen(keyframes, poses), laser)
            self._guard = Guard(self._known.relocalizer)
            # now rather than within the first update: what is usual for the laser of the map
            widest = max((keyframe.beams for keyframe in keyframes), key=len)
            VerdictLimits.usual_for(self._known.relocalizer, widest.cut(laser.range_max_m))
        self._task: Steps[Join | None] | None = None
        self._found: Join | None = None
        self._announced, self._next = 0, len(keyframes)
        self._keyframes, self._poses = keyframes, poses
        self._loose_m: FloatArray | None = None
        self._backlog: list[int] = []
        self._looks = self._tries = 0
        self._T_last: SE2 | None = None
        self._loops: list[Loop] = []

    @property
    def asked_from(self) -> int:
        """The first keyframe that may yet be looked at."""
        return min([self._next - 1 - max(self.config.back, self.config.tried), *self._backlog])

    def look(
        self,
        keyframes: Sequence[Keyframe],
        poses: FloatArray,
        time_s: float = 0.0,
        loose_m: FloatArray | None = None,
    ) -> Join | None:
        """What the keyframes add that were not looked at yet, one by one, by as much work as there is
        time for until the next scan; the join as soon as it is sure.

        poses: (K, 3) of all keyframes, those of the session in its own frame. time_s: usual between
        two scans; inf: none comes any more. loose_m: (K,) see `Looseness`.
        """
        self._keyframes, self._poses, self._loose_m = keyframes, poses, loose_m
        if self._found is not None:
            join, self._found = self._found, None
            return join
        config = self.config
        most = config.work * (1.0 if time_s <= 1.0 else config.unhurried)
        left = (math.inf if math.isinf(time_s) else most) - self._announced
        while self._task is not None or self._next < len(keyframes):
            if self._task is None:
                self._task, self._next = self._looked_at(self._next), self._next + 1
            try:
                self._announced = next(self._task)
            except StopIteration as end:
                self._task, self._announced = None, 0
                found: Join | None = end.value
                if found is not None:
                    return found
                continue
            left -= self._announced
            if left < 0.0:
                break
        return None

    def __getstate__(self) -> dict[str, Any]:
        """For a copy, here or in another process: what was begun is done first, all at once."""
        if self._task is not None:
            self._found, self._task, self._announced = all_at_once(self._task), None, 0
        return self.__dict__.copy()

    def renumber(self, remaining: Remaining) -> None:
        """Keyframes were let go, none of those from `asked_from` on: those looked at next have other numbers."""
        if self._task is not None:  # begun by the numbers before
            self._task, self._announced, self._next = None, 0, self._next - 1
        self._first, self._next = remaining.number(self._first), remaining.number(self._next)
        self._loops = renumbered(self._loops, remaining)
        self._backlog = [remaining.number(k) for k in self._backlog if remaining.is_kept[k]]

    def reject(self) -> None:
        """Takes back the last join, which turned out wrong."""
        if not self._is_start_known:
            self._give_up()
        self._loops = []

    def _looked_at(self, index: int) -> Steps[Join | None]:
        """What one keyframe adds, a piece at a time."""
        config = self.config
        # thinned out while the session seemed to be joined
        if not has_scan(self._keyframes, index):
            return None
        if self._place is None:
            place, is_sure = yield from self._searched(index)
            if place is None:
                return None
            if not is_sure:  # loops say so at once, or not at all
                asked = list(range(max(self._first, index - config.tried + 1), index + 1))
                return self._agreed((yield from self._loops_at(place, asked)))
            self._place = place
            self._backlog = list(range(max(self._first, index - config.back), index))
            asked = [index]
        else:  # a few at a time, the newest first: the next scan does not wait
            asked = [*self._backlog[-config.at_a_time :], index]
            del self._backlog[-config.at_a_time :]
        self._loops += yield from self._loops_at(self._place, asked)
        join = self._agreed(self._loops)
        self._tries += 1
        if join is None and not self._is_start_known and self._tries >= config.patience:
            self._give_up()
        return join

    def _loops_at(self, place: SE2, asked: list[int]) -> Steps[list[Loop]]:
        """The loops of some keyframes with the map, if the session lies at a place."""
        yield _LOOPS * len(asked)
        moved = _moved(self._poses, self._first, place)
        sigma = self.config.start_sigma if self._is_start_known else self.config.sigma
        return self._closer.found(
            self._keyframes, moved, asked, sigma, range(self._first), self._loose_m
        )

    def _searched(self, index: int) -> Steps[tuple[SE2 | None, bool]]:
        """Where the session seems to lie by a search of the whole map, and whether that is sure: little of what the
        scans see may be mapped. None where no place is likely, or none was looked for."""
        config, count = self.config, self._looks
        self._looks += 1
        assert self._known is not None
        if count >= config.eager and count % config.eager >= config.burst:
            return None, False
        if count >= config.eager and count % config.eager == 0:
            self._give_up()
        keyframe = self._keyframes[index]
        T_now = keyframe.T_map_base
        moved = SE2.identity() if self._T_last is None else self._T_last.inverse() @ T_now
        self._T_last = T_now
        beams = keyframe.beams.cut(self._known.laser.range_max_m)
        look = Look(keyframe.time_s, beams, self._known.matcher("fast"))
        judged = yield from self._guard.search_in_steps(look, moved, np.zeros((3, 3)))
        is_sure = judged.verdict.status is Status.TRACKING and judged.match is not None
        T_map_base = judged.match.T_map_base if is_sure and judged.match else self._guard.likely
        if T_map_base is None:
            return None, False
        return T_map_base @ SE2.from_array(self._poses[index]).inverse(), is_sure

    def _agreed(self, loops: Sequence[Loop]) -> Join | None:
        """The place that enough loops agree on, if there is one."""
        config, poses, best = self.config, self._poses, list[Loop]()
        place = SE2.identity()
        ends = [SE2.from_array(poses[loop.earlier]) @ loop.T_earlier_later for loop in loops]
        for end, loop in zip(ends, loops, strict=True):
            candidate = end @ SE2.from_array(poses[loop.later]).inverse()
            agreeing = [
                other
                for there, other in zip(ends, loops, strict=True)
                if there.is_near(candidate @ SE2.from_array(poses[other.later]), *config.near)
            ]
            if len(agreeing) > len(best):
                best, place = agreeing, candidate
        laters = sorted({loop.later for loop in best})
        if len(laters) < config.least_loops:
            return None
        apart_m = np.hypot(*(poses[laters, :2] - poses[laters[0], :2]).T)
        return Join(place, tuple(best)) if apart_m.max() >= config.least_way_m else None

    def _give_up(self) -> None:
        """Starts the search anew."""
        assert self._known is not None
        self._place, self._tries, self._loops, self._backlog = None, 0, [], []
        self._guard, self._T_last = Guard(self._known.relocalizer), None


def set_aside(keyframes: Sequence[Keyframe], poses: FloatArray, first: int) -> FloatArray:
    """Poses (K, 3), of which those from the first of a session on are moved beside all others."""
    ends = [
        (SE2.from_array(pose) @ keyframe.points)[:, 0]
        for keyframe, pose in zip(keyframes, poses, strict=True)
    ]
    most_m = max(float(x.max(initial=-math.inf)) for x in ends[:first])
    least_m = min(float(x.min(initial=math.inf)) for x in ends[first:])
    moved = poses.copy()
    moved[first:, 0] += most_m + _ASIDE_M - least_m
    return moved


def _moved(poses: FloatArray, first: int, T_map_session: SE2) -> FloatArray:
    moved = poses.copy()
    moved[first:] = composed(T_map_session.as_array(), poses[first:])
    return moved

"""What the last keyframes saw of what a scan shows, or looked through."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.keyframes import Keyframe
from slam.frontend.witnesses import Witnesses
from slam.kernels.visibility import contradictions
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMap, moved
from slam.surface.surface_match import SurfaceMatch

_LAST, _BEFORE = slice(-12, None), slice(-12, -3)
"""Keyframes asked what is looked through, and those of them since which people have walked on. Chosen: of one a
metre ahead, all but the last three saw him where the robot is by now."""
_THERE_M = 0.1
"""Within which a scan matched with what these saw says the same, a turn counted as at a metre. Chosen: of scans of
five real logs that wheels denied it was 0.07 at most; of people who had walked on, 0.2 and more."""
_ASIDE, _NEARER = (0.5, 0.1), 0.5
"""[m], [rad], and share of how far off the wheels lead, within which it may have been drawn aside, if nobody looked
through what it shows there: else they saw the same people. Chosen: walls of a corridor with doors were
0.27 m aside."""
_MANY, _FEW, _MUCH = 3, 3, 0.3
"""Keyframes, all if there are fewer, and points that each and the scan looked through; or, of all together, share of the
scan's: a cart close by hides what is behind it from all but the last two. Chosen: of one who walks two
metres ahead 5 of 181 beams, 10 of 361, at most keyframes; none of a room's walls, three at one keyframe that lay
9 cm aside."""
_ASIDE_M = 0.05
"""Of beams that pass by: with 0.1 m one who had walked ahead hid himself. Chosen."""
_SURE = 0.9
"""Of the farthest that a laser returned: up to there, beams that came back from nowhere looked through what
is there now. Chosen: walls that have just come into reach are no people."""


@dataclass(frozen=True, eq=False)
class LastSeen:
    """What a scan is compared with: the surfaces that the last keyframes saw, and all keyframes so far."""

    surfaces: SurfaceMap
    keyframes: Sequence[Keyframe]
    config: FrontEndConfig

    def before(self, points: FloatArray, beams: Beams) -> SeenBefore:
        """What keyframes a while before saw of a scan; of one at a time."""
        return SeenBefore(self.keyframes, points, beams, self.config, self._scratch)

    @cached_property
    def _scratch(self) -> SurfaceMap:
        return SurfaceMap(self.config.surfaces)


class SeenBefore:
    """What keyframes a while before saw of a scan, of its faced points (N, 3) and beams.

    scratch: a map to learn that in, whatever it holds, of one of these at a time; a new one takes a millisecond to
    be written to first.
    """

    def __init__(
        self,
        keyframes: Sequence[Keyframe],
        points: FloatArray,
        beams: Beams,
        config: FrontEndConfig,
        scratch: SurfaceMap,
    ) -> None:
        self._last, self._before = (
            [one for one in some if not one.is_place_alone]
            for some in (keyframes[_LAST], keyframes[_BEFORE] or keyframes[:1])
        )
        self._points, self._beams, self._config = points, beams, config
        self._ends, self._scratch = np.ascontiguousarray(points[:, :2]), scratch

    def are_people(self, match: SurfaceMatch, T_wheels: SE2) -> bool:
        """Whether one of them looked through what the scan shows at a match, or the scan through what it saw,
        and nothing that they saw says that it lies there rather than where the wheels lead."""
        if not self._is_looked_through(self._last, match):
            return False
        T = match.T_map_base
        seen = self._surfaces.match_alone(self._points, T)
        if seen.least_facing < self._config.least_facing:
            return True
        off_m = _apart(seen.T_map_base, T)
        if off_m < _THERE_M:
            return False
        is_aside = seen.T_map_base.is_near(T, *_ASIDE)
        is_aside &= off_m < _NEARER * _apart(T_wheels, T)
        return not is_aside or self._is_looked_through(self._before, seen)

    def _is_looked_through(self, keyframes: Sequence[Keyframe], match: SurfaceMatch) -> bool:
        # those before are the first of the last ones
        through = [
            self._looked_through(one, sure, match)
            for one, sure in zip(keyframes, self._last_sure, strict=False)
        ]
        many = sum(count >= _FEW for count in through)
        return 0 < min(_MANY, len(keyframes)) <= many or sum(through) > _MUCH * len(self._points)

    def _looked_through(self, keyframe: Keyframe, sure: Beams, match: SurfaceMatch) -> int:
        """How many of both scans' points the other did; sure: the beams of the keyframe."""
        margins, there = self._config.denial.margins, keyframe.T_map_base.between(match.T_map_base)
        through = 0
        for points, beams, T in (
            (self._ends, sure, there),
            (keyframe.points, self._sure, there.inverse()),
        ):
            through += contradictions(
                points, T.x, T.y, T.theta, beams.middle_m, beams.angles_rad, beams.ranges_m,
                *margins, _ASIDE_M,
            )[1]  # fmt: skip
        return through

    def _surely(self, beams: Beams) -> Beams:
        """The same beams; those that came back from nowhere, up to where something would have been seen."""
        ranges_m = np.where(np.isposinf(beams.ranges_m), self._sure_m, beams.ranges_m)
        ranges_m.flags.writeable = False  # not to be copied
        return beams.with_ranges(ranges_m)

    @cached_property
    def _sure(self) -> Beams:
        return self._surely(self._beams)

    @cached_property
    def _last_sure(self) -> list[Beams]:
        return [self._surely(one.beams) for one in self._last]

    @cached_property
    def _sure_m(self) -> float:
        """How far these would have seen something [m]."""
        ends = [np.sort(one.beams.ranges_m[one.beams.is_hit]) for one in self._last]
        # all but two beams: one may stray
        return _SURE * max((float(one[-3]) for one in ends if len(one) > 2), default=0.0)

    @cached_property
    def _surfaces(self) -> SurfaceMap:
        """What those before saw that stood: somebody whom one of them met may be met there again."""
        surfaces, denial = self._scratch, self._config.denial
        surfaces.clear()
        sure = [
            replace(one, beams=beams)
            for one, beams in zip(self._last, self._last_sure, strict=True)
        ]
        poses = np.array([one.T_map_base.as_array() for one in sure]).reshape(-1, 3)
        witnesses = Witnesses(sure, poses, denial.margins, denial.aside_m)
        for k, keyframe in enumerate(self._before):
            surfaces.add(moved(keyframe.T_map_base, keyframe.faced[witnesses.stands(k)]))
        return surfaces


def _apart(one: SE2, other: SE2) -> float:
    """How far two poses are apart [m], a turn as far as at a metre."""
    between = one.between(other)
    return math.hypot(between.x, between.y, between.theta)

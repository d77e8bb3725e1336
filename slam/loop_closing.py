"""Loops: keyframes that see again what others saw before, proposed by pose, verified by scans."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from slam.arrays import FloatArray, diagonal_of
from slam.frontend.contradictions import passed
from slam.frontend.kept_keyframes import has_scan
from slam.frontend.keyframes import Keyframe
from slam.frontend.remaining import Remaining
from slam.kernels.near_keyframes import seen_before
from slam.kernels.normal_equations import inverse_of
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMap, SurfaceMapConfig, all_moved
from slam.surface.surface_match import SurfaceMatch

_NONE: Set[int] = frozenset()
_SLIDE = 1.5
"""Of the reach of a search, to its corners and a little on: farther off a match is another place."""


@dataclass(frozen=True)
class LoopConfig:
    """How loops are proposed and verified.

    radius_m: how far a keyframe may seem from one that it sees again, beside its uncertainty.
    least_way_m: of the robot between the two. every: which keyframes are asked. most: submaps that
    each is compared with; apart: keyframes between two of them. half: keyframes to either side that
    make a submap. search_m, search_rad: around the pose told, beside its uncertainty; max_search_m:
    at most. least_seen_ratio, least_inlier_ratio: of a verified match. most_passed: share of the
    points in view that the other's beams went through, by margins [m] and as a share. least_held: information along the weakest
    direction, of that along the strongest. sigma: (m, m, rad) beside what the match says of itself.
    Chosen, all of these.
    """

    radius_m: float = 4.0
    least_way_m: float = 6.0
    every: int = 2
    most: int = 3
    apart: int = 20
    half: int = 8
    search_m: float = 0.6
    search_rad: float = math.radians(12.0)
    max_search_m: float = 6.0
    least_seen_ratio: float = 0.6
    least_inlier_ratio: float = 0.85
    most_passed: float = 0.06
    margins: tuple[float, float] = (0.15, 0.02)
    least_held: float = 0.01
    sigma: tuple[float, float, float] = (0.01, 0.01, 0.003)


@dataclass(frozen=True, eq=False)
class Loop:
    """Keyframe `later` as seen from keyframe `earlier`, and the (3, 3) information of that. is_tie: of
    one way, past keyframes that left open how far it went; no place is seen again."""

    earlier: int
    later: int
    T_earlier_later: SE2
    information: FloatArray
    inlier_ratio: float
    passed_ratio: float
    is_tie: bool = False


def without_ties(loops: Sequence[Loop]) -> list[Loop]:
    """The loops at which a place is seen again."""
    return [loop for loop in loops if not loop.is_tie]


def renumbered(loops: Sequence[Loop], remaining: Remaining) -> list[Loop]:
    """The loops between keyframes that remain, by their numbers then."""
    is_kept, number = remaining.is_kept, remaining.number
    return [
        replace(loop, earlier=number(loop.earlier), later=number(loop.later))
        for loop in loops
        if is_kept[loop.earlier] and is_kept[loop.later]
    ]


class LoopCloser:
    """Proposes and verifies loops among keyframes; doubted: those the steps to which may be wrong, on both sides of which
    what is seen does not go together."""

    def __init__(
        self, config: LoopConfig | None = None, surfaces: SurfaceMapConfig | None = None
    ) -> None:
        self.config = config or LoopConfig()
        self.doubted: Set[int] = _NONE
        self._surfaces = SurfaceMap(surfaces)

    def undoubted(
        self, keyframes: Sequence[Keyframe], loops: Sequence[Loop], doubted: Set[int]
    ) -> list[Loop]:
        """Loops but those with what was seen on both sides of a step that is doubted: such a one says where the later
        keyframe is as seen from one of the sides, and nobody knows which."""
        return [
            loop
            for loop in loops
            if loop.is_tie
            or doubted.isdisjoint(self._around(keyframes, loop.earlier, loop.later, _NONE)[1:])
        ]

    def found(
        self,
        keyframes: Sequence[Keyframe],
        poses: FloatArray,
        asked: Sequence[int],
        sigma: tuple[float | FloatArray, float | FloatArray] = (0.0, 0.0),
        others: range | None = None,
        loose_m: FloatArray | None = None,
    ) -> list[Loop]:
        """The verified loops among keyframes at poses (K, 3).

        asked: which are compared with those before them, of others; None: all. sigma: how uncertain
        their poses are as seen from the others [m], [rad]; or (K,) of each of these. loose_m: (K,) of
        those that leave open how far along they lie, see `Looseness`.
        """
        sigma_m, sigma_rad = (np.array(np.broadcast_to(one, len(keyframes))) for one in sigma)
        loose_m = np.zeros(len(keyframes)) if loose_m is None else loose_m
        loops = [
            self.verified(
                keyframes, poses, earlier, later,
                (float(sigma_m[earlier]), float(sigma_rad[earlier])), float(loose_m[earlier]),
            )
            for earlier, later in self.proposed(keyframes, poses, asked, sigma_m, others)
            # of two that leave it open how far along they lie, what fits is chance; others in their place,
            # farther off, were right less often than those next to one that sees where it is
            if min(loose_m[earlier], loose_m[later]) == 0.0
        ]  # fmt: skip
        return [loop for loop in loops if loop is not None]

    def proposed(
        self,
        keyframes: Sequence[Keyframe],
        poses: FloatArray,
        asked: Sequence[int],
        sigma_m: FloatArray,
        others: range | None = None,
    ) -> list[tuple[int, int]]:
        """Pairs (earlier, later) of keyframes that may have seen the same place."""
        config, sessions = self.config, keyframes[-1].session if keyframes else 0
        starts = [
            bisect_left(keyframes, session, key=lambda keyframe: keyframe.session)
            for session in range(1, sessions + 1)
        ]
        others = range(len(keyframes)) if others is None else others
        near, away_m = np.empty(len(keyframes), np.int64), np.empty(len(keyframes))
        pairs: list[tuple[int, int]] = []
        for later in asked:
            if not has_scan(keyframes, later):
                continue
            count = seen_before(
                poses, later, np.array(starts, np.int64), config.least_way_m, config.radius_m,
                sigma_m, config.max_search_m, others.start, others.stop, near, away_m,
            )  # fmt: skip
            # of two that are as far, the earlier one
            order = np.argsort(away_m[:count][::-1], kind="stable")
            rest = near[:count][::-1][order].tolist()
            for _ in range(config.most):
                seen = (at for at, k in enumerate(rest) if has_scan(keyframes, k))
                if (at := next(seen, None)) is None:
                    break
                earlier = rest[at]
                pairs.append((earlier, later))
                rest = [k for k in rest[at + 1 :] if abs(k - earlier) > config.apart]
        return pairs

    def verified(
        self,
        keyframes: Sequence[Keyframe],
        poses: FloatArray,
        earlier: int,
        later: int,
        sigma: tuple[float, float],
        loose_m: float = 0.0,
    ) -> Loop | None:
        """The loop between two keyframes, if their scans agree that there is one.

        loose_m: by how much the earlier one may lie farther along than what is seen around it, which
        shows where the later one lies; as seen from the earlier one, nobody knows that any better.
        """
        members = self._around(keyframes, earlier, later, self.doubted)
        self._surfaces.add(
            all_moved(
                poses[members.start : members.stop],
                [self._surfaces.thinned(keyframes[k].faced) for k in members],
            )
        )
        T_told, reach = SE2.from_array(poses[later]), self._reach(sigma)
        match = self._matched(keyframes[later], T_told, reach)
        self._surfaces.clear()
        config = self.config
        # a match may slide on from where it was looked for: to the next window of a row, say
        if (
            not T_told.is_near(match.T_map_base, _SLIDE * reach[0], _SLIDE * reach[1])
            or match.seen_ratio < config.least_seen_ratio
            or match.inlier_ratio < config.least_inlier_ratio
            or self._held(match) < config.least_held
        ):
            return None
        passed_ratio = self._passed(keyframes, poses, members, later, match.T_map_base)
        if passed_ratio > config.most_passed:
            return None
        T_earlier_later = SE2.from_array(poses[earlier]).inverse() @ match.T_map_base
        covariance = inverse_of(match.information) + diagonal_of(config.sigma)
        if loose_m > 0.0:
            covariance[:2, :2] += _along_open(keyframes[earlier], T_earlier_later, loose_m)
        return Loop(
            earlier, later, T_earlier_later, inverse_of(covariance),
            match.inlier_ratio, passed_ratio,
        )  # fmt: skip

    def _around(
        self, keyframes: Sequence[Keyframe], middle: int, later: int, doubted: Set[int]
    ) -> range:
        """The keyframes around one, none beyond a gap, a place where the scans broke off or a step that is doubted, nor
        nearer to the later one: where scans are rare it would be compared with itself."""
        first, last, most = middle, middle, (middle + later) // 2

        def is_joined(k: int) -> bool:
            return keyframes[k].goes_on and k not in doubted

        while first > max(0, middle - self.config.half) and is_joined(first):
            first -= 1
        while last < min(most, middle + self.config.half) and is_joined(last + 1):
            last += 1
        return range(first, last + 1)

    def _reach(self, sigma: tuple[float, float]) -> tuple[float, float]:
        """How far around the pose told is searched [m], [rad]."""
        config = self.config
        return (
            config.search_m + min(2.0 * sigma[0], config.max_search_m),
            config.search_rad + min(2.0 * sigma[1], math.pi),
        )

    def _matched(self, keyframe: Keyframe, T_told: SE2, reach: tuple[float, float]) -> SurfaceMatch:
        points = keyframe.faced
        starts = [T_told, *self._surfaces.searched(points, T_told, *reach)]
        return self._surfaces.best_alone(points, starts)

    def _held(self, match: SurfaceMatch) -> float:
        """Information of the weakest direction of the position, of that of the strongest."""
        (xx, xy), (_, yy) = match.place_information.tolist()
        middle, apart = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
        return (middle - apart) / (middle + apart) if middle + apart > 0.0 else 0.0

    def _passed(
        self,
        keyframes: Sequence[Keyframe],
        poses: FloatArray,
        members: Sequence[int],
        later: int,
        T_later: SE2,
    ) -> float:
        """Share of the points in view, to and fro, that the other's beams went through."""
        seen = through = 0
        for k in members[::4]:
            there = SE2.from_array(poses[k]).inverse() @ T_later
            counts = passed(keyframes[later], keyframes[k], there, self.config.margins)
            seen, through = seen + counts[0], through + counts[1]
        return through / max(seen, 1)


def _along_open(keyframe: Keyframe, T_keyframe_other: SE2, sigma_m: float) -> FloatArray:
    """(2, 2) of where another one lies, in its own frame, as seen from a keyframe that is so unsure of
    how far along it lies itself."""
    along = np.linalg.eigh(keyframe.covariance[:2, :2])[1][:, -1]
    c, s = math.cos(T_keyframe_other.theta), math.sin(T_keyframe_other.theta)
    turned = np.array([[c, s], [-s, c]]) @ along
    return sigma_m**2 * np.outer(turned, turned)

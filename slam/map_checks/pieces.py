"""The pieces of a map, between which its scans broke off, and which of them loops tie together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain, pairwise

import numpy as np

from slam.arrays import FloatArray
from slam.frontend.keyframes import Keyframe
from slam.kernels.normal_equations import inverse_of
from slam.loop_closing import Loop
from slam.odometry import place_sigma_m
from slam.se2 import SE2

_SURE_M, _TOLD_M = 0.8, 3.0
"""Standard deviation of the wheels' way over a break, up to which they say where a piece lies, and up to
which they say anything. Chosen: the first is what scans that broke off make of 0.6 m."""
_MOST_NIS, _MOST_OFF_M = 11.3, 0.5
"""Of that way as it is on the map (chi2 with three degrees of freedom, 1 %), and how far it may be off:
what is taken for the wheels' error where scans broke off would excuse metres. Chosen."""
_MANY = 4
"""Keyframes on either side that loops need, if the wheels say otherwise. Chosen: three on one side and two
on the other tied a third of mit-csail 11 m off, where these were off by 27, squared and normalised."""
_LITTLE = 1e-6
"""[m2], [rad2]: a map file may say that a way over a break is known for sure."""
_FEW = 2
"""Keyframes of a piece that wheels alone may place. Chosen: five were 0.8 m off."""


class Pieces:
    """Of keyframes at poses (K, 3): which pieces hold together.

    A loop alone may be of a place that looks the same, and so may three: it takes four keyframes on
    either side, or two where the wheels do not contradict them, or one where they lead and are sure
    of it. A scan or two that no loop ties lie where wheels lead to from before them, if they lead on
    from there to what came after. A session that has begun anywhere has rules of its own, see
    `MapSession`: it is tied by any loop. breaks: keyframes that a piece begins with, but
    for the first; joined: of each piece, the first one that it is tied to.
    """

    def __init__(
        self, keyframes: Sequence[Keyframe], loops: Sequence[Loop], poses: FloatArray | None = None
    ) -> None:
        self._keyframes, self._poses = keyframes, poses
        self.breaks = [k for k, keyframe in enumerate(keyframes) if keyframe.is_break]
        of = np.zeros(len(keyframes), dtype=np.int64)
        for k in self.breaks:
            of[k:] += 1
        self.joined: list[int] = list(range(len(self.breaks) + 1))
        between = [
            (loop.earlier, loop.later) for loop in loops if of[loop.earlier] != of[loop.later]
        ]
        while (found := next(chain(self._tied(between, of), self._on_the_way()), None)) is not None:
            first, other = sorted(found)
            self.joined = [first if one == other else one for one in self.joined]

    def _tied(self, between: list[tuple[int, int]], of: np.ndarray) -> Iterator[tuple[int, int]]:
        """Pairs of pieces, each by the first that it is tied to, that belong together as well."""
        ends: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for loop in between:
            one, other = (self.joined[of[k]] for k in loop)
            if one != other:
                ordered = loop if one < other else loop[::-1]
                ends.setdefault((min(one, other), max(one, other)), []).append(ordered)
        for pair, loops in ends.items():
            least = min(len(set(side)) for side in zip(*loops, strict=True))
            ways = self._between(pair)
            if (
                least >= _MANY
                or any(self._are_of_two_sessions(*ends) for ends in loops)
                or (least > 1 and any(all(map(self._agrees, way)) for way in ways))
                or any(len(way) == 1 and self._is_led(way[0]) for way in ways)
            ):
                yield pair

    def _on_the_way(self) -> Iterator[tuple[int, int]]:
        """Pieces and what they are on the way between, by the wheels to them and on from them."""
        for at, (k, after) in enumerate(pairwise(self.breaks)):
            before, piece, on = self.joined[at : at + 3]
            is_one_drive = self._keyframes[k - 1].session == self._keyframes[after].session
            is_short = after - k <= _FEW and before == on != piece
            if is_short and is_one_drive and self._is_led(k) and self._is_led(after):
                yield before, piece

    def _between(self, pair: tuple[int, int]) -> list[list[int]]:
        """The breaks on each way from one of two groups of pieces to the other."""
        ends = [at for at, one in enumerate(self.joined) if one in pair]
        return [
            self.breaks[one:other]
            for one, other in pairwise(ends)
            if self.joined[one] != self.joined[other]
        ]

    def _are_of_two_sessions(self, one: int, other: int) -> bool:
        return self._keyframes[one].session != self._keyframes[other].session

    def _off(self, k: int) -> tuple[float, float]:
        """How far what came after a break lies from where the wheels led [m], and that squared and
        normalised; no way where poses are not known."""
        if self._poses is None:
            return 0.0, 0.0
        before, after = (SE2.from_array(pose) for pose in self._poses[k - 1 : k + 1])
        off = ((before @ self._keyframes[k].T_before).inverse() @ after).log()
        information = inverse_of(self._keyframes[k].covariance + _LITTLE * np.eye(3))
        return math.hypot(off[0], off[1]), float(off @ information @ off)

    def _agrees(self, k: int) -> bool:
        """Whether wheels that tell of the way over a break do not contradict where the map has what
        came after."""
        is_told = place_sigma_m(self._keyframes[k].covariance) < _TOLD_M
        return is_told and self._off(k)[1] < _MOST_NIS

    def _is_led(self, k: int) -> bool:
        """Whether wheels lead over a break to where the map has what came after it, and are sure of it."""
        is_near = self._off(k)[0] < _MOST_OFF_M and self._agrees(k)
        return is_near and place_sigma_m(self._keyframes[k].covariance) < _SURE_M

"""The pieces of a map, between which its scans broke off, and which of them loops tie together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain, pairwise

import numpy as np

from slam.arrays import FloatArray
from slam.keyframes import Keyframe
from slam.loop_closing import Loop
from slam.se2 import SE2

_SURE_M = 0.8
"""Standard deviation of the wheels' way over a break, up to which they say where a piece lies; chosen: what
scans that broke off make of wheels that are sure to 0.6 m."""
_MOST_NIS, _MOST_OFF_M = 11.3, 0.5
"""Of that way as it is on the map (chi2 with three degrees of freedom, 1 %), and how far it may be off:
what is taken for the wheels' error where scans broke off would excuse metres. Chosen."""
_FEW = 2
"""Keyframes of a piece that wheels alone may place. Chosen: five were 0.8 m off."""


class Pieces:
    """Of keyframes at poses (K, 3): which pieces hold together.

    One loop alone may be of a place that looks the same: it takes two, between other keyframes on
    either side, or that the wheels lead there as well; and a scan or two that no loop ties lie where
    wheels lead to from before them, if they lead on from there to what came after. A session that has begun anywhere has rules of
    its own, see `MapSession`: it is tied by any loop. breaks: keyframes that a piece begins with, but
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
            is_sure = all(len(set(side)) > 1 for side in zip(*loops, strict=True))
            if is_sure or any(self._is_led(k) for k in self._between(pair)):
                yield pair

    def _on_the_way(self) -> Iterator[tuple[int, int]]:
        """Pieces and what they are on the way between, by the wheels to them and on from them."""
        for at, (k, after) in enumerate(pairwise(self.breaks)):
            before, piece, on = self.joined[at : at + 3]
            is_one_drive = self._keyframes[k - 1].session == self._keyframes[after].session
            is_short = after - k <= _FEW and before == on != piece
            if is_short and is_one_drive and self._is_led(k) and self._is_led(after):
                yield before, piece

    def _between(self, pair: tuple[int, int]) -> list[int]:
        """The breaks between two groups of pieces."""
        sides = zip(self.breaks, self.joined, self.joined[1:], strict=False)
        return [k for k, before, after in sides if {before, after} == set(pair)]

    def _is_led(self, k: int) -> bool:
        """Whether wheels lead over a break to where the map has what came after it, and are sure of it;
        of sessions nobody asks."""
        keyframe = self._keyframes[k]
        if self._poses is None or keyframe.session != self._keyframes[k - 1].session:
            return True
        before, after = (SE2.from_array(pose) for pose in self._poses[k - 1 : k + 1])
        off = ((before @ keyframe.T_before).inverse() @ after).log()
        information = np.linalg.inv(keyframe.covariance)
        is_sure = np.linalg.eigvalsh(keyframe.covariance[:2, :2])[-1] < _SURE_M**2
        is_near = math.hypot(off[0], off[1]) < _MOST_OFF_M and off @ information @ off < _MOST_NIS
        return bool(is_sure and is_near)

"""What the scans of a map say of one another's points, but for what moved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from slam.arrays import BoolArray, FloatArray
from slam.frontend.kept_keyframes import has_scan
from slam.frontend.keyframes import Keyframe
from slam.kernels.visibility import NOT_THROUGH, THROUGH, statements_into
from slam.se2 import SE2

_ALONG = 0.3
"""Sine of the angle between a beam and a surface, below which it passes or meets that by a hair. Chosen,
as what follows, on right and wrong maps of simulated buildings and real logs."""
_BESIDE = 3
"""Keyframes to either side in the drive, that lie right beside one another whatever else is wrong."""
_BESIDE_MARGINS, _BESIDE_ASIDE_M = (0.15, 0.02), 0.05
"""By which beams of those go through what is no more there."""
_MOST_MOVED = 0.25
"""Share of a scan that one beside it looks through: more, and it is the scan that lies wrong."""


class Witnesses:
    """Keyframes at poses (K, 3), asked about one another.

    margins, in metres and as a share of the distance, and aside_m: as in `slam.frontend.contradictions`. What a
    scan shows, and those just before and after it look through, moved: somebody walked by. It is in
    nobody's view, and no contradiction of a scan that comes by later.
    """

    def __init__(
        self,
        keyframes: Sequence[Keyframe],
        poses: FloatArray,
        margins: tuple[float, float],
        aside_m: float,
    ) -> None:
        self._keyframes, self._poses = keyframes, [SE2.from_array(pose) for pose in poses]
        self._margins, self._aside_m = margins, aside_m
        self._stands: dict[int, BoolArray] = {}
        self._fans: dict[int, tuple[FloatArray, FloatArray]] = {}

    def passed(self, one: int, other: int) -> tuple[int, int]:
        """Of both scans' points that stand, to and fro: how many are in the other's view, and how many
        of these its beams went through."""
        seen = through = 0
        if not (has_scan(self._keyframes, one) and has_scan(self._keyframes, other)):
            return 0, 0
        for of, by in ((one, other), (other, one)):
            said = self._said(of, by, self._margins, self._aside_m)[self.stands(of)]
            through += (passed := int(np.count_nonzero(said == THROUGH)))
            seen += passed + int(np.count_nonzero(said == NOT_THROUGH))
        return seen, through

    def next_to(self, k: int) -> Iterator[int]:
        """The last keyframe before one, and the first after it, that are more than their place."""
        for ks in (range(k - 1, -1, -1), range(k + 1, len(self._keyframes))):
            yield from islice((at for at in ks if has_scan(self._keyframes, at)), 1)

    def stands(self, k: int) -> BoolArray:
        """(N,) which points of a keyframe were there before and after it too, as far as anybody saw."""
        if k not in self._stands:
            stands = np.ones(len(self._keyframes[k].points), dtype=np.bool_)
            for beside in self._beside(k):
                is_passed = self._said(k, beside, _BESIDE_MARGINS, _BESIDE_ASIDE_M) == THROUGH
                if np.count_nonzero(is_passed) <= _MOST_MOVED * len(is_passed):
                    stands &= ~is_passed
            self._stands[k] = stands
        return self._stands[k]

    def _beside(self, k: int) -> Iterator[int]:
        """Keyframes just before and after one, none beyond a gap or a place where the scans broke off."""
        keyframes = self._keyframes
        for step in (-1, 1):
            for off in range(1, _BESIDE + 1):
                beside = k + step * off
                if (
                    not 0 <= beside < len(keyframes)
                    or not keyframes[max(beside, beside - step)].goes_on
                ):
                    break
                if has_scan(keyframes, beside):
                    yield beside

    def _said(
        self, of: int, by: int, margins: tuple[float, float], aside_m: float
    ) -> NDArray[np.int8]:
        """(N,) of the points of one keyframe, by the beams of another: see `statements_into`."""
        there, beams = self._poses[by].inverse() @ self._poses[of], self._keyframes[by].beams
        if by not in self._fans:
            self._fans[by] = beams.from_middle()
        said = np.empty(len(self._keyframes[of].points), dtype=np.int8)
        statements_into(
            self._keyframes[of].faced, there.as_array(), beams.middle_m, *self._fans[by],
            *margins, aside_m, _ALONG, said,
        )  # fmt: skip
        return said

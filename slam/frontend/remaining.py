"""Which keyframes of a drive remain, once others are let go of that add nothing to the map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from slam.arrays import BoolArray, IntArray
from slam.frontend.told_steps import ToldStep


@dataclass(frozen=True, eq=False)
class Remaining:
    """Of K keyframes, those that remain.

    is_kept: (K,). anchors: (K,) for each that does not remain the one beside it that does, which scans are seen from
    then that were seen from it; its own number for one that remains. ways: the step to one that remains from the last
    that does, past others, by its number.
    """

    is_kept: BoolArray
    anchors: IntArray
    ways: Mapping[int, ToldStep] = field(default_factory=dict)

    @cached_property
    def kept(self) -> IntArray:
        """(R,) the numbers so far of those that remain."""
        return np.flatnonzero(self.is_kept)

    @cached_property
    def numbers(self) -> IntArray:
        """(K + 1,) how many remain before each of them, and of all: the new number of one that does."""
        return np.concatenate([[0], np.cumsum(self.is_kept)])

    def number(self, k: int) -> int:
        """Of a keyframe that remains, or of one that is yet to come."""
        is_known = k < len(self.is_kept)
        return int(self.numbers[k]) if is_known else int(self.numbers[-1]) + k - len(self.is_kept)

    def after(self, first: int) -> Remaining:
        """Of the keyframes from that one on, counted from there."""
        ways = {k - first: way for k, way in self.ways.items() if k >= first}
        return Remaining(self.is_kept[first:], self.anchors[first:] - first, ways)

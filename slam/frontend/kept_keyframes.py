"""The keyframes of a drive: those of which no more than the place is kept as rows of numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, ClassVar

import numpy as np

from slam.frontend.keyframes import Keyframe
from slam.frontend.remaining import Remaining
from slam.frontend.told_steps import ToldStep
from slam.packed import MadeWhenAsked, PackedRows
from slam.se2 import SE2


class _Places(PackedRows[Keyframe]):
    """Keyframes of which no more than the place is kept: 230 bytes each."""

    DTYPE: ClassVar[np.dtype[Any]] = np.dtype(
        [
            ("time_s", "f8"), ("T_map_base", "f8", 3), ("T_before", "f8", 3),
            ("covariance", "f8", (3, 3)), ("is_break", "?"), ("session", "i4"), ("told", "f8", 3),
            ("told_covariance", "f8", (3, 3)), ("is_after_gap", "?"),
        ]
    )  # fmt: skip

    @staticmethod
    def packed(thing: Keyframe) -> tuple[Any, ...]:
        """See `PackedRows`."""
        return (
            thing.time_s, thing.T_map_base.as_array(), thing.T_before.as_array(), thing.covariance,
            thing.is_break, thing.session, thing.told.motion.as_array(), thing.told.covariance,
            thing.is_after_gap,
        )  # fmt: skip

    @staticmethod
    def unpacked(row: tuple[Any, ...]) -> Keyframe:
        """See `PackedRows`."""
        (
            time_s,
            T_map_base,
            T_before,
            covariance,
            is_break,
            session,
            told,
            told_covariance,
            is_after_gap,
        ) = row
        return Keyframe.of_place(
            time_s, SE2.from_array(T_map_base), SE2.from_array(T_before), covariance.copy(),
            is_break=is_break, session=session,
            told=ToldStep(SE2.from_array(told), told_covariance.copy()), is_after_gap=is_after_gap,
        )  # fmt: skip


class Keyframes(MadeWhenAsked[Keyframe]):
    """A list of keyframes; those that are kept for their place alone are made anew when they are asked for."""

    def __init__(self, keyframes: Iterable[Keyframe] = ()) -> None:
        self._things: list[Keyframe | int] = list(keyframes)
        self._places = _Places()

    def __len__(self) -> int:
        return len(self._things)

    def _one(self, at: int) -> Keyframe:
        thing = self._things[at]
        return self._places[thing] if isinstance(thing, int) else thing

    def __setitem__(self, at: int, keyframe: Keyframe) -> None:
        thing = self._things[at]
        if isinstance(thing, int) and keyframe.is_place_alone:
            self._places[thing] = keyframe
        else:
            self._things[at] = keyframe

    def append(self, keyframe: Keyframe) -> None:
        """One more."""
        self._things.append(keyframe)

    def keep_place_alone(self, at: int) -> None:
        """Lets go of all but the place of one."""
        thing = self._things[at]
        if not isinstance(thing, int):
            self._places.append(thing)
            self._things[at] = len(self._places) - 1

    def renumber(self, remaining: Remaining) -> None:
        """Lets go of those that do not remain."""
        things = [self._things[k] for k in remaining.kept.tolist()]
        rows = np.array([thing for thing in things if isinstance(thing, int)], np.int64)
        self._places, numbers = self._places.some(rows), iter(range(len(rows)))
        self._things = [next(numbers) if isinstance(one, int) else one for one in things]
        for k, way in remaining.ways.items():
            at = remaining.number(k)
            self[at] = self._one(at).after_gap(way)

    def has_scan(self, at: int) -> bool:
        """Whether more than the place of one is kept."""
        thing = self._things[at]
        return not (isinstance(thing, int) or thing.is_place_alone)


def has_scan(keyframes: Sequence[Keyframe], at: int) -> bool:
    """Whether more than the place is kept of one of keyframes, who is not made for it."""
    if isinstance(keyframes, Keyframes):
        return keyframes.has_scan(at)
    return not keyframes[at].is_place_alone

"""Floor plans: walls along lines with doors in them, and what stands between the walls."""

import itertools
import math
from dataclasses import dataclass

from kitasap_sim.built_places import Block, Pillar

Point = tuple[float, float]

_LEAST_PIECE_M = 1e-3
"""What is left of a wall beside a door that is shorter than this is left out."""
_LONGEST_MITRE = 2.0
"""Chosen: of half the thickness; the outer corners of sharper turns than 127 degrees are blunt."""


@dataclass(frozen=True)
class Wall:
    """A wall along the middle line through some points, with gaps in it.

    doors_m: from and to, lengths along the line from its first point. is_closed: back to the first
    point. Raises ValueError for less than two points, points that coincide, or a door that is not
    on the line.
    """

    line_m: tuple[Point, ...]
    thickness_m: float
    height_m: float
    doors_m: tuple[tuple[float, float], ...] = ()
    is_closed: bool = False

    def __post_init__(self) -> None:
        if len(self.line_m) < (3 if self.is_closed else 2):
            least = "three, if it is closed" if self.is_closed else "two"
            raise ValueError(f"a wall needs points, at least {least}, not {len(self.line_m)}")
        for (one, other), length_m in zip(self._legs, self._lengths_m, strict=True):
            if length_m < _LEAST_PIECE_M:
                raise ValueError(f"two points of the wall in a row are the same: {one} and {other}")
        length_m = sum(self._lengths_m)
        for first_m, last_m in self.doors_m:
            if not 0.0 <= first_m < last_m <= length_m + 1e-6:
                raise ValueError(
                    f"a door goes from one length along its wall to a larger one, within"
                    f" 0 and {length_m:.3f} m, not from {first_m:g} to {last_m:g}"
                )

    @property
    def _legs(self) -> list[tuple[Point, Point]]:
        corners = (*self.line_m, self.line_m[0]) if self.is_closed else self.line_m
        return list(itertools.pairwise(corners))

    @property
    def _lengths_m(self) -> list[float]:
        return [math.dist(one, other) for one, other in self._legs]

    def blocks(self) -> list[Block]:
        """The boxes that it is made of: one for each straight piece, mitred where it turns."""
        legs, found, begin_m = self._legs, [], 0.0
        for index, (leg, length_m) in enumerate(zip(legs, self._lengths_m, strict=True)):
            before = legs[index - 1] if index or self.is_closed else None
            after = (
                legs[(index + 1) % len(legs)] if index + 1 < len(legs) or self.is_closed else None
            )
            for first_m, last_m in self._standing(begin_m, begin_m + length_m):
                # to the outer corner: there is none where the line ends, nor at a door
                from_m = first_m - begin_m
                from_m -= self._mitre_m(before, leg) if first_m == begin_m else 0.0
                to_m = last_m - begin_m
                to_m += self._mitre_m(leg, after) if last_m == begin_m + length_m else 0.0
                found.append(self._block(leg, from_m, to_m))
            begin_m += length_m
        return found

    def _standing(self, first_m: float, last_m: float) -> list[tuple[float, float]]:
        """What the doors leave of a stretch of the line."""
        left = [(first_m, last_m)]
        for from_m, to_m in self.doors_m:
            left = [
                piece
                for low, high in left
                for piece in ((low, min(high, from_m)), (max(low, to_m), high))
                if piece[1] - piece[0] > _LEAST_PIECE_M
            ]
        return left

    def _mitre_m(self, one: tuple[Point, Point] | None, other: tuple[Point, Point] | None) -> float:
        """How far beyond the corner between two legs their outer sides meet."""
        if one is None or other is None:
            return 0.0
        turn = abs(math.remainder(_heading(other) - _heading(one), 2.0 * math.pi))
        return self.thickness_m / 2 * min(math.tan(min(turn, 3.1) / 2), _LONGEST_MITRE)

    def _block(self, leg: tuple[Point, Point], from_m: float, to_m: float) -> Block:
        heading = _heading(leg)
        middle_m = (from_m + to_m) / 2
        return Block(
            leg[0][0] + middle_m * math.cos(heading),
            leg[0][1] + middle_m * math.sin(heading),
            to_m - from_m,
            self.thickness_m,
            self.height_m,
            heading,
        )


@dataclass(frozen=True)
class FloorPlan:
    """Walls, and what stands about. start: x, y [m] and heading [rad]; None: the roomiest spot."""

    walls: tuple[Wall, ...]
    things: tuple[Block | Pillar, ...] = ()
    start: tuple[float, float, float] | None = None

    def solids(self) -> list[Block | Pillar]:
        """All of it, the walls first."""
        return [*itertools.chain.from_iterable(wall.blocks() for wall in self.walls), *self.things]


def _heading(leg: tuple[Point, Point]) -> float:
    (x, y), (next_x, next_y) = leg
    return math.atan2(next_y - y, next_x - x)

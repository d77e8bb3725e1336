"""The pieces of furniture in a place: which there are, which can be moved, and moving them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np

from kitasap_sim.free_space import Grid, widened
from kitasap_sim.geometry import cuts_at, cuts_between, points_on, static_triangles
from kitasap_sim.robot import KITASAP2, SWEPT_HEIGHTS_M

_MAX_SIDE_M = 0.8
"""Chosen: what is wider nobody moves in passing."""
_BUILT_IN = ("wall", "door", "column", "pillar", "post", "pilaster", "shaft", "partition")
_FLOOR_TOP_M = SWEPT_HEIGHTS_M[0]
_BANDS_M = (SWEPT_HEIGHTS_M, (SWEPT_HEIGHTS_M[1], 0.65), (0.65, 2.0))
"""Chosen: a seat goes under a table, the back of the chair does not."""
_CELL_M = 0.0125
_CLEARANCE_M = 0.02
_DIRECTIONS = 32
_LISTED = 12


@dataclass(frozen=True)
class Piece:
    """What moves as one: a frame, a body or a geom that stands in the worldbody itself.

    solids, seen: the triangles (F, 3, 3) of its geoms [m], all of them and those that beams hit.
    """

    name: str
    is_built_in: bool
    solids: list[np.ndarray] = field(repr=False)
    seen: list[np.ndarray] = field(repr=False)

    @cached_property
    def boxes_m(self) -> np.ndarray:
        """(G, 2, 3) lower and upper corner of the box around each of its geoms [m]."""
        corners = [solid.reshape(-1, 3) for solid in self.solids]
        return np.array([[points.min(axis=0), points.max(axis=0)] for points in corners])

    @property
    def sides_m(self) -> np.ndarray:
        """(2,) width and depth of the box around it [m]."""
        boxes_m = self.boxes_m[:, :, :2]
        result: np.ndarray = boxes_m[:, 1].max(axis=0) - boxes_m[:, 0].min(axis=0)
        return result

    @property
    def is_floor(self) -> bool:
        """Whether the robot can drive over all of it."""
        return bool(self.boxes_m[:, 1, 2].max() < _FLOOR_TOP_M)

    def touches(self, other: "Piece") -> bool:
        """Whether the box around any geom of one meets that around any geom of the other."""
        mine, theirs = self.boxes_m[:, None], other.boxes_m[None]
        is_apart = (mine[:, :, 0] > theirs[:, :, 1]) | (theirs[:, :, 0] > mine[:, :, 1])
        return bool((~is_apart.any(axis=2)).any())


def pieces(spec: mujoco.MjSpec) -> dict[str, Piece]:
    """The static pieces of a place by name; those without any name together as ''."""
    spec = spec.copy()
    model = spec.compile()
    solids = static_triangles(model, seen_only=False)
    seen = static_triangles(model, seen_only=True)
    found = {}
    for name, parts in _parts(spec).items():
        geoms = [geom for _, geoms in parts for geom in geoms if geom.id in solids]
        if geoms:
            words = " ".join([name, *(_class_name(geom) for geom in geoms)]).lower()
            found[name] = Piece(
                name=name,
                is_built_in=any(word in words for word in _BUILT_IN),
                solids=[solids[geom.id] for geom in geoms],
                seen=[seen[geom.id] for geom in geoms if geom.id in seen],
            )
    return found


def shift(spec: mujoco.MjSpec, moved_m: Mapping[str, tuple[float, float]], place: str) -> None:
    """Moves pieces of a place by (dx, dy) each [m].

    Raises ValueError for an unknown name and for what is not two finite numbers.
    """
    parts = _parts(spec)
    for name, shift_m in moved_m.items():
        offset_m = np.array([*shift_m, 0.0], dtype=float)
        if offset_m.shape != (3,) or not np.isfinite(offset_m).all():
            raise ValueError(f"'{name}' is moved by two finite numbers, dx and dy, not {shift_m}")
        if not name or name not in parts:
            raise ValueError(_unknown(name, parts, place))
        for element, _ in parts[name]:
            # nan: not given by its two ends
            if isinstance(element, mujoco.MjsGeom) and not np.isnan(element.fromto[0]):
                element.fromto = element.fromto + np.tile(offset_m, 2)
            else:
                element.pos = element.pos + offset_m


def movable(found: Mapping[str, Piece], height_m: float, place: str) -> str:
    """The free-standing small piece of which beams at a height see most; a chair before others.

    Raises ValueError if there is none.
    """
    standing = [piece for piece in found.values() if not piece.is_floor]
    outlines_m = {
        piece.name: _length_m(cuts_at(piece.seen, height_m))
        for piece in standing
        if piece.name and not piece.is_built_in and (piece.sides_m <= _MAX_SIDE_M).all()
    }
    free = [
        name
        for name, outline_m in outlines_m.items()
        if outline_m > 0
        and not any(found[name].touches(other) for other in standing if other.name != name)
    ]
    if not free:
        raise ValueError(
            f"place {place} has no free-standing piece of furniture of at most {_MAX_SIDE_M} m "
            f"that is seen at {height_m} m height"
        )
    return max(free, key=lambda name: ("chair" in name.lower(), outlines_m[name]))


def pushed(
    found: Mapping[str, Piece],
    name: str,
    distance_m: float,
    kept_free_m: np.ndarray,
    rng: np.random.Generator,
    place: str,
) -> tuple[float, float]:
    """(dx, dy) of a push of that length in a direction drawn, into nothing on the way [m].

    kept_free_m: (T, 2) corners of a line on which there must be room for the robot afterwards.
    Raises ValueError if there is no such piece, or no such direction.
    """
    if not name or name not in found:
        raise ValueError(_unknown(name, found, place))
    if not (np.isfinite(distance_m) and distance_m >= 0):
        raise ValueError(f"a piece is pushed by a distance of 0 or more, not {distance_m} m")
    line_m = np.stack([kept_free_m, np.roll(kept_free_m, -1, axis=0)], axis=1)
    kept_m, _ = points_on(line_m, 4 * _CELL_M)
    shares = np.linspace(0, 1, 2 + int(distance_m / _CELL_M))[1:, None, None]
    bands = [_Band(found, name, distance_m, *heights_m) for heights_m in _BANDS_M]
    for angle in rng.uniform(-np.pi, np.pi, _DIRECTIONS):
        push_m = distance_m * np.array([np.cos(angle), np.sin(angle)])
        if all(band.is_clear(shares * push_m) for band in bands):
            gaps_m = np.linalg.norm((bands[0].outline_m + push_m)[:, None] - kept_m, axis=2)
            if gaps_m.size == 0 or gaps_m.min() > KITASAP2.radius_m + 2 * _CELL_M:
                return float(push_m[0]), float(push_m[1])
    raise ValueError(
        f"place {place}: '{name}' cannot be pushed by {distance_m} m: something is in each way"
    )


class _Band:
    """What a piece could run into between two heights, as seen from above."""

    def __init__(
        self, found: Mapping[str, Piece], name: str, reach_m: float, low_m: float, high_m: float
    ) -> None:
        others = [solid for piece in found.values() if piece.name != name for solid in piece.solids]
        outline = cuts_between(found[name].solids, low_m, high_m)
        obstacles = cuts_between(others, low_m, high_m)
        ends_m = np.concatenate([outline.reshape(-1, 2), obstacles.reshape(-1, 2), [[0.0, 0.0]]])
        bounds_m = np.array([ends_m.min(axis=0), ends_m.max(axis=0)])
        self._grid = Grid.over(bounds_m, _CELL_M, margin_m=reach_m)
        self._is_taken = widened(self._grid.walls(obstacles), _CLEARANCE_M / _CELL_M)
        points_m, _ = points_on(outline, _CELL_M)
        cells = np.unique(self._grid.cells(points_m), axis=0)
        self.outline_m = self._grid.centres_m(cells)

    def is_clear(self, shifts_m: np.ndarray) -> bool:
        """Whether the piece runs into nothing at any of the shifts (K, 1, 2) [m]."""
        cells = self._grid.cells((self.outline_m + shifts_m).reshape(-1, 2))
        return not self._is_taken[tuple(cells.T)].any()


_Part = tuple[mujoco.MjsElement, list[mujoco.MjsGeom]]


def _parts(spec: mujoco.MjSpec) -> dict[str, list[_Part]]:
    """What bears each name in the worldbody itself, and the geoms that move with it.

    A frame without a name goes by its first geom's that has one.
    """
    tops: dict[mujoco.MjsElement, list[mujoco.MjsGeom]] = {}
    for geom in spec.worldbody.geoms:
        tops.setdefault(_top(geom), []).append(geom)
    for body in spec.worldbody.bodies:
        tops.setdefault(_top(body), []).extend(_geoms(body))
    parts: dict[str, list[_Part]] = {}
    for top, geoms in tops.items():
        name = top.name or next((geom.name for geom in geoms if geom.name), "")
        parts.setdefault(name, []).append((top, geoms))
    return parts


def _top(element: mujoco.MjsElement) -> mujoco.MjsElement:
    """The outermost frame around an element of the worldbody, or the element itself."""
    while element.frame is not None:
        element = element.frame
    return element


def _geoms(body: mujoco.MjsBody) -> list[mujoco.MjsGeom]:
    return [*body.geoms, *(geom for child in body.bodies for geom in _geoms(child))]


def _class_name(geom: mujoco.MjsGeom) -> str:
    return geom.classname.name if geom.classname else ""


def _length_m(segments: np.ndarray) -> float:
    return float(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum())


def _unknown(name: str, there_are: Iterable[str], place: str) -> str:
    # what can be moved first
    known = sorted(filter(None, there_are), key=lambda known: any(w in known for w in _BUILT_IN))
    more = f" and {len(known) - _LISTED} more" if len(known) > _LISTED else ""
    listed = ", ".join(known[:_LISTED]) or "none with a name"
    return f"place {place} has no piece called '{name}'; there are: {listed}{more}"

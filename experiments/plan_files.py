"""Floor plans in YAML: a place for the robot in twenty lines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

from experiments.plan_example import EXAMPLE
from kitasap_sim.built_places import Block, Pillar
from kitasap_sim.floor_plan import FloorPlan, Wall
from slam.files.yaml_files import read_yaml, shown

_FARTHEST_M = 300.0
"""Chosen: the cells in which a place's free space is found are then 0.2 m wide."""
_LOWEST_WALL_M, _HIGHEST_M = 0.5, 10.0
"""A wall is above every laser."""
_LEAST_M = 0.01
_DEFAULT_HEIGHT_M, _DEFAULT_THICKNESS_M = 0.8, 0.1
_RESERVED = ("floor", "start", "overview", "sun", "fill")
_T = TypeVar("_T")

__all__ = ["EXAMPLE", "read_plan"]


def read_plan(path: Path) -> FloorPlan:
    """The floor plan in a YAML file; `EXAMPLE` is one that has all there is.

    Raises ValueError, one line that names the file and what in it, where it is none; OSError when
    it cannot be opened.
    """
    fields = read_yaml(path)
    try:
        return _plan(fields)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _plan(fields: object) -> FloorPlan:
    given = _keys(fields, "a floor plan", ("walls",), ("height", "thickness", "boxes", "cylinders", "start"))  # fmt: skip
    height_m = _wall_height(given.get("height", str(_DEFAULT_HEIGHT_M)), "height")
    thickness_m = _length(given.get("thickness", str(_DEFAULT_THICKNESS_M)), "thickness")
    walls = _each(given, "walls", lambda one, where: _wall(one, where, thickness_m, height_m))
    boxes = _each(given, "boxes", lambda one, where: _box(one, where, height_m))
    pillars = _each(given, "cylinders", lambda one, where: _pillar(one, where, height_m))
    _check_names([*boxes, *pillars])
    return FloorPlan(tuple(walls), (*boxes, *pillars), _start(given.get("start")))


def _wall(fields: object, where: str, thickness_m: float, height_m: float) -> Wall:
    given = _keys(fields, where, ("line",), ("closed", "doors", "thickness", "height"))
    line = _list(given["line"], f"{where}: line", "points [x, y]")
    doors = _list(given.get("doors", []), f"{where}: doors", "lengths [from, to]")
    try:
        return Wall(
            tuple(_pair(point, f"{where}: line") for point in line),
            _length(given.get("thickness", str(thickness_m)), f"{where}: thickness"),
            _wall_height(given.get("height", str(height_m)), f"{where}: height"),
            tuple(_pair(door, f"{where}: doors") for door in doors),
            _is_true(given.get("closed", "no"), f"{where}: closed"),
        )
    except ValueError as error:
        said = str(error)
        raise ValueError(said if said.startswith(where) else f"{where}: {said}") from None


def _box(fields: object, where: str, height_m: float) -> Block:
    given = _keys(fields, where, ("at", "size"), ("name", "height", "turned"))
    x_m, y_m = _pair(given["at"], f"{where}: at")
    width_m, depth_m = _pair(given["size"], f"{where}: size", _LEAST_M)
    return Block(
        x_m,
        y_m,
        width_m,
        depth_m,
        _length(given.get("height", str(height_m)), f"{where}: height", _HIGHEST_M),
        math.radians(_number(given.get("turned", "0"), f"{where}: turned", -360.0, 360.0)),
        _name(given.get("name", where.replace("boxes ", "box_")), where),
    )


def _pillar(fields: object, where: str, height_m: float) -> Pillar:
    given = _keys(fields, where, ("at", "radius"), ("name", "height"))
    x_m, y_m = _pair(given["at"], f"{where}: at")
    return Pillar(
        x_m,
        y_m,
        _length(given["radius"], f"{where}: radius"),
        _length(given.get("height", str(height_m)), f"{where}: height", _HIGHEST_M),
        _name(given.get("name", where.replace("cylinders ", "cylinder_")), where),
    )


def _start(fields: object) -> tuple[float, float, float] | None:
    if fields is None:
        return None
    given = _keys(fields, "start", ("at",), ("heading",))
    heading = _number(given.get("heading", "0"), "start: heading", -360.0, 360.0)
    return (*_pair(given["at"], "start: at"), math.radians(heading))


def _keys(fields: object, where: str, needed: Iterable[str], more: Iterable[str]) -> dict[str, Any]:
    """What is said under known keys. Raises ValueError for others, and where one is missing."""
    known = (*needed, *more)
    listed = ", ".join(known)
    if not isinstance(fields, dict):
        raise ValueError(f"{where} is given by keys ({listed}), not by {shown(fields)}")
    for key in fields:
        if key not in known:
            raise ValueError(f"{where}: there is no key {shown(key)}; there are: {listed}")
    for key in needed:
        if key not in fields:
            raise ValueError(f"{where}: the key {key} is missing; there are: {listed}")
    return fields


def _each(given: dict[str, Any], key: str, made: Callable[[object, str], _T]) -> list[_T]:
    """What is made of each entry of a list, named by its number from 1 on."""
    entries = _list(given.get(key, []), key, "entries")
    return [made(entry, f"{key} {number}") for number, entry in enumerate(entries, start=1)]


def _list(value: object, where: str, of: str) -> list[object]:
    if not isinstance(value, list):
        raise ValueError(f"{where} must be a list of {of}, not {shown(value)}")
    return value


def _pair(value: object, where: str, least: float = -_FARTHEST_M) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError(f"{where} takes two numbers in brackets, not {shown(value)}")
    first, second = (_number(number, where, least, _FARTHEST_M) for number in value)
    return first, second


def _length(value: object, where: str, most_m: float = _FARTHEST_M) -> float:
    return _number(value, where, _LEAST_M, most_m)


def _wall_height(value: object, where: str) -> float:
    return _number(value, where, _LOWEST_WALL_M, _HIGHEST_M)


def _number(value: object, where: str, least: float, most: float) -> float:
    try:
        number = float(value) if isinstance(value, str) else math.nan
    except ValueError:
        number = math.nan
    if not least <= number <= most:
        raise ValueError(f"{where} takes numbers from {least:g} to {most:g}, not {shown(value)}")
    return number


def _is_true(value: object, where: str) -> bool:
    word = value.lower() if isinstance(value, str) else ""
    if word not in ("yes", "no", "true", "false"):
        raise ValueError(f"{where} takes yes or no, not {shown(value)}")
    return word in ("yes", "true")


def _name(value: object, where: str) -> str:
    is_fine = isinstance(value, str) and 0 < len(value) <= 60 and value.isprintable()
    if not isinstance(value, str) or not is_fine:
        raise ValueError(f"{where}: name takes up to 60 letters, not {shown(value)}")
    return value


def _check_names(things: Iterable[Block | Pillar]) -> None:
    seen = set(_RESERVED)
    for thing in things:
        if thing.name in seen:
            raise ValueError(f"the name {shown(thing.name)} is taken: give each thing its own")
        seen.add(str(thing.name))

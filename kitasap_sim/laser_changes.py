"""Lasers that differ from one that is sold: `urg_04lx:beams=181:range_noise=2`."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kitasap_sim.laser import LaserSpec

_ALL_AROUND_RAD = 2.0 * math.pi - 1e-6
_NO_NUMBERS = ("name", "sigma_at_m", "mount_m")
_MEANT = ("beams", "view_deg", "range_noise")


def changeable(spec: LaserSpec) -> tuple[str, ...]:
    """What may be changed: `beams` over the same view, `view_deg` at the same step, `range_noise`, a
    factor to the standard deviation at all ranges; and each number of `LaserSpec` by its name."""
    return _MEANT + tuple(one.name for one in fields(spec) if one.name not in _NO_NUMBERS)


def changed(spec: LaserSpec, name: str, changes: list[str]) -> LaserSpec:
    """The laser with changes, "field=value" each, made one after the other; name: its new one.

    Raises ValueError, naming those there are, for an unknown field, and for what is no such laser.
    """
    for change in changes:
        field, equals, text = change.partition("=")
        if field not in changeable(spec) or not equals:
            raise ValueError(
                f"laser {name}: '{change}' is no change field=value of these fields:"
                f" {', '.join(changeable(spec))}"
            )
        spec = replace(_with(spec, name, field, text), name=name)
    return spec


def _with(spec: LaserSpec, name: str, field: str, text: str) -> LaserSpec:
    match field:
        case "beams":
            return _with_beams(spec, _whole(name, field, text, least=2))
        case "view_deg":
            return _with_view(spec, math.radians(_number(name, field, text)))
        case "range_noise":
            factor = _number(name, field, text)
            if not factor > 0.0:
                raise ValueError(f"laser {name}: range_noise is a factor above 0, not {text}")
            sigmas = tuple((at, factor * sigma) for at, sigma in spec.sigma_at_m)
            return replace(spec, sigma_at_m=sigmas)
    own = getattr(spec, field)
    value: Any
    if isinstance(own, bool):
        if text not in ("True", "False"):
            raise ValueError(f"laser {name}: {field} is True or False, not {text}")
        value = text == "True"
    elif isinstance(own, int):
        value = _whole(name, field, text, least=1)
    else:
        value = _number(name, field, text)
    return replace(spec, **{field: value})


def _with_beams(spec: LaserSpec, count: int) -> LaserSpec:
    """So many beams over the same view; of one that looks all around, all around."""
    if spec.beam_count * spec.step_rad >= _ALL_AROUND_RAD:
        step_rad = spec.beam_count * spec.step_rad / count
    else:
        step_rad = (spec.beam_count - 1) * spec.step_rad / (count - 1)
    return replace(spec, beam_count=count, step_rad=step_rad)


def _with_view(spec: LaserSpec, view_rad: float) -> LaserSpec:
    """The beams of a narrower view about the middle of this one."""
    own_rad = (spec.beam_count - 1) * spec.step_rad
    if not spec.step_rad <= view_rad <= own_rad + 1e-9:
        raise ValueError(
            f"laser {spec.name}: view_deg lies between {math.degrees(spec.step_rad):.3g} and"
            f" {math.degrees(own_rad):.5g}, its own, not at {math.degrees(view_rad):.5g}"
        )
    left_out = math.ceil((own_rad - view_rad) / spec.step_rad / 2.0 - 1e-9)
    mirror_turn_s = spec.period_s / spec.interlace
    return replace(
        spec,
        beam_count=spec.beam_count - 2 * left_out,
        first_angle_rad=spec.first_angle_rad + left_out * spec.step_rad,
        # as many are left out before and behind: the others keep their times
        first_beam_s=spec.first_beam_s + left_out * spec.step_rad / math.tau * mirror_turn_s,
    )


def _number(name: str, field: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"laser {name}: {field} is a finite number, not '{text}'")
    return number


def _whole(name: str, field: str, text: str, least: int) -> int:
    if not (text.isascii() and text.isdigit()) or int(text) < least:
        raise ValueError(f"laser {name}: {field} is a whole number from {least} on, not '{text}'")
    return int(text)

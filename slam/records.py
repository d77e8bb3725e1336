"""Dataclasses that are made for each scan, and not changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar, dataclass_transform

_Record = TypeVar("_Record")


@dataclass_transform(frozen_default=True, eq_default=False)
def record(cls: type[_Record]) -> type[_Record]:
    """As `dataclass(frozen=True, eq=False)`, to the type checker, and not at run time: each field of a frozen one
    is set by a call, so that to make it takes four times as long."""
    return dataclass(eq=False)(cls)

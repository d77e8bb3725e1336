"""Keywords of the driving tasks in plain values: how a specification is kept as JSON, and read."""

import copy
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec

from kitasap_sim.laser import LaserSpec
from kitasap_sim.laser import laser as laser_preset
from kitasap_sim.places import Place


class KeepsSpec:
    """An environment whose `spec` holds its keywords in plain values: `spec.to_json()` keeps all
    but a `Place` that a program made, which pickles."""

    _kept_spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """What made it; None if Gymnasium did not."""
        return self._kept_spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            spec = copy.copy(spec)
            spec.kwargs = {key: _plain(value) for key, value in spec.kwargs.items()}
        self._kept_spec = spec


def laser_of(given: Any) -> LaserSpec:
    """A laser by its name, as it is, or by its fields, as JSON has them.

    Raises ValueError, naming the keyword, for anything else.
    """
    if isinstance(given, str):
        return laser_preset(given)
    if isinstance(given, Mapping):
        fields = {key: _in_tuples(value) for key, value in given.items()}
        try:
            return LaserSpec(**fields)
        except TypeError as error:  # of fields that there are not, or that hold no numbers
            raise ValueError(f"laser: the fields of a LaserSpec, not {given!r} ({error})") from None
    if not isinstance(given, LaserSpec):
        raise ValueError(f"laser: a name or a LaserSpec, not {given!r}")
    return given


def _plain(value: Any) -> Any:
    if isinstance(value, Place):
        return value.name if value.is_file else value
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return value


def _in_tuples(value: Any) -> Any:
    return tuple(_in_tuples(one) for one in value) if isinstance(value, list | tuple) else value

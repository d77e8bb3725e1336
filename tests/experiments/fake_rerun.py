"""A stand-in for the library Rerun, which is large: keeps what is logged."""

import sys
from dataclasses import dataclass, field
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest


@dataclass
class Shown:
    """One call of `log`. scan: the number of the scan that was set last, None before the first."""

    entity: str
    kind: str
    content: Any
    values: dict[str, Any]
    scan: int | None


@dataclass
class FakeRerun:
    """What all streams together were told."""

    shown: list[Shown] = field(default_factory=list)
    scan: int | None = None

    def of(self, entity: str) -> list[Shown]:
        return [one for one in self.shown if one.entity == entity]

    def log(self, entity: str, what: SimpleNamespace, *, static: bool) -> None:
        assert static == (self.scan is None)
        self.shown.append(Shown(entity, what.kind, what.content, what.values, self.scan))

    def set_time(self, timeline: str, **value: float) -> None:
        if timeline == "scan":
            self.scan = int(value["sequence"])

    def save(self, path: Path, **_: Any) -> None:
        path.write_bytes(b"RRF2")

    def disconnect(self) -> None:
        self.scan = None

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: None  # settings


def archetype(kind: str) -> Any:
    def made(content: Any = None, *_: Any, **values: Any) -> SimpleNamespace:
        return SimpleNamespace(kind=kind, content=content, values=values)

    return made


class _Module(ModuleType):
    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return archetype(name)


def installed(monkeypatch: pytest.MonkeyPatch) -> FakeRerun:
    """In place of the library, be it there or not."""
    stream = FakeRerun()
    module, blueprint = _Module("rerun"), _Module("rerun.blueprint")
    module.__spec__ = ModuleSpec("rerun", None)
    up = SimpleNamespace(kind="ViewCoordinates", content=None, values={})
    vars(module).update(
        RecordingStream=lambda name: stream,
        ViewCoordinates=SimpleNamespace(RIGHT_HAND_Z_UP=up),
        components=SimpleNamespace(
            ImageFormat=lambda **values: values, Colormap=SimpleNamespace(RvizMap="rviz")
        ),
        blueprint=blueprint,
    )
    monkeypatch.setitem(sys.modules, "rerun", module)
    monkeypatch.setitem(sys.modules, "rerun.blueprint", blueprint)
    return stream

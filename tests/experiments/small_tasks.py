"""Tasks for engines, which other processes have to be able to import; nothing heavy is loaded."""

import ctypes
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from experiments.engines import Engine, Finished
from experiments.processes import local_engine

IDENTITY = "small"


@dataclass(frozen=True)
class SmallTask:
    """Each trial's record is a function of its index."""

    def prepare(self) -> str:
        return IDENTITY

    def __call__(self, index: int) -> Finished:
        return index, {"status": "ok", "square": index * index}, {"cpu_s": 0.0}


@dataclass(frozen=True)
class DyingTask(SmallTask):
    """At one trial the process is killed, so many times. folder: where that is counted."""

    folder: Path
    at: int
    times: int

    def __call__(self, index: int) -> Finished:
        if index == self.at and len(list(self.folder.iterdir())) < self.times:
            (self.folder / str(time.monotonic_ns())).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().__call__(index)


@dataclass(frozen=True)
class HangingTask(SmallTask):
    """At one trial it hangs, in C code that no thread and no signal handler of Python gets past."""

    at: int

    def __call__(self, index: int) -> Finished:
        if index == self.at:
            ctypes.PyDLL(None).sleep(600)
        return super().__call__(index)


@dataclass(frozen=True)
class UnpreparedTask(SmallTask):
    """No process gets ready."""

    def prepare(self) -> str:
        sys.exit(3)


@contextmanager
def at_work(engine: Engine, task: SmallTask, told: list[str] | None = None) -> Iterator:
    with engine.at_work(task, IDENTITY, [].append if told is None else told.append) as work:
        yield work


def main() -> None:
    """A parent whose worker hangs; it says when that is so."""
    with at_work(local_engine(2), HangingTask(at=1)) as work:
        for index, *_ in work([1, 0]):
            print(index, flush=True)


if __name__ == "__main__":
    main()

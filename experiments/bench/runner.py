"""What the runner adds to trials: its own processor time, and how well two processes share the work."""

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from experiments.engines import Finished
from experiments.memory import resident_mb
from experiments.processes import local_engine
from experiments.progress import TrialProgress
from experiments.runs import Run, recorded_trial
from experiments.tables import wide_console
from experiments.trials import TrialConfig, config_hash

_KIDNAP = TrialConfig(poses="anywhere", methods=("limit",))
_FEW = 100
"""Trials whose run is taken off that of many: what is left is of the others alone."""


@dataclass(frozen=True)
class EmptyTask:
    """Trials that do nothing: each has the record of one that was run once."""

    identity: str
    record: dict[str, Any]
    timing: dict[str, Any]

    def prepare(self) -> str:
        """Nothing is to be got ready."""
        return self.identity

    def __call__(self, index: int) -> Finished:
        """The record, whatever the index."""
        return index, self.record, self.timing


@dataclass(frozen=True)
class _EmptyRun(Run):
    """A run of trials that do nothing: log, digest, progress, table and summary are real."""

    @property
    def task(self) -> EmptyTask:
        """Of the same hash as the real one."""
        identity = config_hash(self.experiment, self.config, self.seed)
        return EmptyTask(identity, *_one_kidnap())


@cache
def _one_kidnap() -> tuple[dict[str, Any], dict[str, Any]]:
    _, record, timing = recorded_trial("kidnap", _KIDNAP, 0, 0)
    return record, timing


def print_benchmark(trials: int, overhead_trials: int, seed: int, out: Path | None) -> None:
    """Prints both tables; out: keeps the runs there, which resume."""
    with _folder(out) as folder:
        console = wide_console()
        console.print(_overhead_table(folder, overhead_trials))
        console.print(_efficiency_table(folder, trials, seed))


@contextmanager
def _folder(out: Path | None) -> Iterator[Path]:
    if out is not None:
        yield out
        return
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def _overhead_table(folder: Path, trials: int) -> Table:
    table = Table(title=f"What the runner adds to each of {trials} kidnaps that do nothing")
    for column in ("engine", "CPU for each trial [ms]"):
        table.add_column(escape(column), justify="right")
    for name, jobs in (("this process", 1), ("two processes", 2)):
        table.add_row(name, f"{overhead_ms(folder, jobs, trials):.3f}")
    return table


def overhead_ms(folder: Path, jobs: int, trials: int) -> float:
    """CPU time of a run of empty trials, its processes included, for each trial [ms].

    Of a run of many less one of few: starting processes and reading sources is not for each.
    """
    _one_kidnap()
    took_s = []
    for count in (_FEW, _FEW, _FEW + trials):  # the first loads what all need
        own = folder / f"empty_{jobs}_{count}"
        shutil.rmtree(own, ignore_errors=True)
        run = _EmptyRun("kidnap", _KIDNAP, 0, count, own)
        started_s = _cpu_s()
        with TrialProgress("empty", count, _KIDNAP.methods) as progress:
            run.execute(local_engine(jobs), progress.update)
        took_s.append(_cpu_s() - started_s)
        shutil.rmtree(own)
    return 1000.0 * (took_s[2] - took_s[1]) / trials


def _efficiency_table(folder: Path, trials: int, seed: int) -> Table:
    """Two processes of one run beside two runs of one process, at the same time, half as long."""
    memory = _Memory(trials)
    started_s = time.monotonic()
    Run("kidnap", _KIDNAP, seed, trials, folder / "pool").execute(local_engine(2), memory.note)
    pool_s, pool_cpu_s = time.monotonic() - started_s, _trials_cpu_s(folder / "pool")
    started_s = time.monotonic()
    singles = [_single(folder / f"single_{k}", trials // 2, seed + 1 + k) for k in range(2)]
    if any(single.wait() for single in singles):
        raise RuntimeError("a single run has failed; what it said stands above")
    singles_s = time.monotonic() - started_s
    singles_cpu_s = sum(_trials_cpu_s(folder / f"single_{k}/kidnap") for k in range(2))
    table = Table(title=f"{trials} kidnaps to anywhere, {', '.join(_KIDNAP.methods)}")
    for column in ("", "wall [s]", "CPU of the trials [s]", "trials per second"):
        table.add_column(escape(column), justify="right")
    table.add_row("one run, two processes", *_columns(pool_s, pool_cpu_s, trials))
    table.add_row("two runs, one process each", *_columns(singles_s, singles_cpu_s, trials))
    table.add_row(
        "efficiency", f"{singles_s / pool_s:.3f}", f"{singles_cpu_s / pool_cpu_s:.3f}", ""
    )
    table.caption = memory.words
    return table


def _columns(wall_s: float, cpu_s: float, trials: int) -> list[str]:
    return [f"{wall_s:.1f}", f"{cpu_s:.1f}", f"{trials / wall_s:.2f}"]


def _single(out: Path, trials: int, seed: int) -> "subprocess.Popen[bytes]":
    """`kitasap run` in one process, which begins as the other run does; no figures."""
    code = (
        "import sys; from pathlib import Path; from experiments.bench.runner import run_single;"
        " run_single(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))"
    )
    return subprocess.Popen([sys.executable, "-c", code, str(out), str(trials), str(seed)])


def run_single(out: Path, trials: int, seed: int) -> None:
    """The run of one process."""
    Run("kidnap", _KIDNAP, seed, trials, out / "kidnap").execute(1, lambda *_: None)


def _trials_cpu_s(folder: Path) -> float:
    return float(json.loads((folder / "summary.json").read_text())["cpu_s"])


def _cpu_s() -> float:
    """Of this process, and of those that it has ended."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime


class _Memory:
    """What a run's processes hold, at a tenth of its trials and at its end [MB]."""

    def __init__(self, trials: int) -> None:
        self._at = {max(1, trials // 10), trials // 2, trials}
        self._done = 0
        self._told: list[tuple[int, float | None, list[float]]] = []

    def note(self, index: int, record: dict[str, Any]) -> None:
        """One more trial is done."""
        self._done += 1
        if self._done in self._at:
            children = sorted(_children_mb(), reverse=True)[:2]
            self._told.append((self._done, resident_mb(), children))

    @property
    def words(self) -> str:
        """All of it."""
        told = (
            f"after {done}: {own:.0f} and {', '.join(f'{mb:.0f}' for mb in children)}"
            for done, own, children in self._told
            if own is not None
        )
        return "MB held by the run and its processes " + "; ".join(told)


def _children_mb() -> Iterator[float]:
    """Of each process that this one has started; of Linux."""
    page_mb = os.sysconf("SC_PAGE_SIZE") / 1e6
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
            if parent == os.getpid():
                yield int((stat.parent / "statm").read_text().split()[1]) * page_mb
        except (OSError, ValueError, IndexError):
            continue  # it just ended

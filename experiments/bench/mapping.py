"""`kitasap bench mapping LOG`: processor time and memory of mapping, one core, compiled beforehand."""

import gc
import json
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from functools import partial
from itertools import islice
from pathlib import Path

from rich.table import Table

from experiments.bench.registration_run import one_core
from experiments.memory import MemoryGrowth
from experiments.tables import wide_console
from slam.frontend.front_end import FrontEnd
from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.readers.log import Log
from slam.readers.recognition import read_log

LIMITS = {"front end alone": 1.5, "with loops": 10.0, "with finishing": 40.0}
"""CPU seconds on intel, of issue 5; other logs are as long as they are."""
_WARM_UP_SCANS = 150
"""Chosen: enough for a search, a loop and an adjustment to have been compiled on any log."""


@dataclass(frozen=True)
class MappingCost:
    """What mapping a log costs. All times are processor time [s], of one thread.

    compile_s: of the first scans, most of it compiling or loading what was compiled. read_s: of
    reading the log, which the others leave out. with_loops_s, with_finishing_s: each with what is
    before it. slowest_update_s: of one scan, loops among it. memory_mb: by which the process grew
    at most while the log was read and mapped, for a moment or for good; None where no one tells.
    """

    log: str
    scans: int
    duration_s: float
    compile_s: float
    read_s: float
    front_end_s: float
    with_loops_s: float
    with_finishing_s: float
    slowest_update_s: float
    memory_mb: float | None


def print_benchmark(log_path: Path, out: Path | None) -> MappingCost:
    """Measures, prints the table, and writes it as JSON where asked; what was measured."""
    log = read_log(log_path)
    log.check_sees()
    with one_core():
        cost = measured(log)
    wide_console().print(_table(cost))
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(json.dumps(asdict(cost), indent=2) + "\n")
    return cost


def measured(log: Log) -> MappingCost:
    """The cost of mapping a log."""
    compile_s = _cpu_s(lambda: _warm_up(log))
    memory_mb = _grown_mb(log)
    measurements: list[Measurement] = []
    read_s = _cpu_s(lambda: measurements.extend(log.measurements()))
    # a log held in memory, as here alone, is not the mapper's to be looked through for garbage
    gc.collect()
    gc.freeze()
    front_end = FrontEnd(log.T_base_laser)
    front_end_s = sum(_updates_s(front_end.update, measurements))
    mapper = Mapper(log.T_base_laser)
    updates_s = _updates_s(mapper.update, measurements)
    finish_s = _cpu_s(mapper.finish)
    gc.unfreeze()
    return MappingCost(
        log.name, len(measurements), measurements[-1].time_s - measurements[0].time_s, compile_s,
        read_s, front_end_s, sum(updates_s), sum(updates_s) + finish_s, max(updates_s), memory_mb,
    )  # fmt: skip


def _cpu_s(work: Callable[[], object]) -> float:
    started_s = time.process_time()
    work()
    return time.process_time() - started_s


def _updates_s(
    update: Callable[[Measurement], object], measurements: Iterable[Measurement]
) -> list[float]:
    return [_cpu_s(partial(update, one)) for one in measurements]


def _warm_up(log: Log) -> None:
    """The first scans there and back: so that there is a loop."""
    mapper, first = Mapper(log.T_base_laser), list(islice(log.measurements(), _WARM_UP_SCANS))
    for one in (*first, *first):
        mapper.update(one)
    mapper.finish()


def _grown_mb(log: Log) -> float | None:
    """By how much this process grows at most while it reads a log and maps it."""
    growth, mapper = MemoryGrowth(), Mapper(log.T_base_laser)
    for one in log.measurements():
        mapper.update(one)
    mapper.finish()
    return growth.most_mb()


def _table(cost: MappingCost) -> Table:
    table = Table(
        title=f"{cost.log} mapped: {cost.scans} scans in {cost.duration_s:.0f} s, one thread",
        caption=f"Reading the log {cost.read_s:.1f} s, compiling or loading what was compiled"
        f" {cost.compile_s:.1f} s: both apart. The limits are those set for intel.",
    )
    for column in ("", "measured", "limit", "x real time"):
        table.add_column(column, justify="right" if column else "left")
    for (name, limit_s), cpu_s in zip(
        LIMITS.items(), (cost.front_end_s, cost.with_loops_s, cost.with_finishing_s), strict=True
    ):
        speed = cost.duration_s / cpu_s if cpu_s > 0.0 else 0.0
        table.add_row(name, f"{cpu_s:.2f} s", f"{limit_s:g} s", f"{speed:.0f}")
    table.add_row("slowest update", f"{1000.0 * cost.slowest_update_s:.0f} ms", "100 ms", "")
    grown = "-" if cost.memory_mb is None else f"{cost.memory_mb:.0f} MB"
    table.add_row("memory grown by", grown, "150 MB", "")
    return table

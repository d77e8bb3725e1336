"""All that is measured of the testbed's speed, in one run and one table."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table

from experiments.bench import env, mapping, registration_run, relocalization, simulation
from experiments.bench.registration_run import one_core
from experiments.progress import CountProgress
from experiments.tables import wide_console
from experiments.trials import TrialConfig
from kitasap_sim.places import Place
from slam.files.whole_files import write_whole
from slam.readers.log import Log
from slam.readers.recognition import read_log

_PLACE, _LASER = "room_fig4", "urg_04lx"
_COLUMNS = ("benchmark", "of", "measured", "beside")


@dataclass(frozen=True)
class Measured:
    """One line: of which benchmark, what was measured, the figure, and what it stands beside."""

    benchmark: str
    of: str
    figure: str
    beside: str


def print_benchmark(log: Path | None, trials: int, seed: int, out: Path | None) -> None:
    """Prints the table, and writes it in Markdown where asked.

    log: a recorded drive, for mapping; None: that is left out. trials: of registration, and of
    relocalisation in each place.
    """
    recorded = None if log is None else read_log(log)
    parts: list[Callable[[], Iterator[Measured]]] = [
        _simulation, lambda: _registration(trials, seed), lambda: _relocalization(trials, seed),
        *([] if recorded is None else [lambda: _mapping(recorded)]), lambda: _env(seed),
    ]  # fmt: skip
    rows: list[Measured] = []
    with CountProgress("benchmarks", len(parts)) as progress:
        for number, part in enumerate(parts, start=1):
            rows += part()
            progress.update(number, rows[-1].benchmark)
    wide_console().print(_table(rows))
    if log is None:
        print("mapping is left out: name a recorded log to have it measured")
    if out is not None:
        write_whole(out, markdown(rows).encode())


def markdown(rows: list[Measured]) -> str:
    """The table in Markdown."""
    cells_of = [tuple(cell.replace("|", "\\|") for cell in _cells(row)) for row in rows]
    lines = [_COLUMNS, ("---",) * len(_COLUMNS), *cells_of]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def _cells(row: Measured) -> tuple[str, ...]:
    return row.benchmark, row.of, row.figure, row.beside


def _table(rows: list[Measured]) -> Table:
    table = Table(title="Processor time of one thread, unless a row says otherwise")
    for column in _COLUMNS:
        table.add_column(column)
    for before, row in zip([None, *rows], rows, strict=False):
        if before is not None and before.benchmark != row.benchmark:
            table.add_section()
        table.add_row(*map(escape, _cells(row)))
    return table


def _simulation() -> Iterator[Measured]:
    speed = simulation.simulation_speed(Place(_PLACE), _LASER)
    yield Measured(
        "sim", f"a scanning robot, {_LASER} in {_PLACE}", f"{speed.with_fan:.0f} s for each CPU s",
        f"{speed.ratio:.2f} of bare MuJoCo without beams",
    )  # fmt: skip


def _registration(trials: int, seed: int) -> Iterator[Measured]:
    result = registration_run.measured(Place(_PLACE), _LASER, trials, seed)
    for row in result.rows:
        rmse = "" if row.position_rmse_mm is None else f", RMSE {row.position_rmse_mm:.2f} mm"
        yield Measured(
            "registration", row.name, f"{row.cpu_us:.0f} µs{rmse}",
            f"{result.rows[0].cpu_us / row.cpu_us:.3g} times as fast as {result.rows[0].name}",
        )  # fmt: skip
    for library, names in result.missing.items():
        yield Measured("registration", ", ".join(names), "-", f"{library} is not installed")


def _relocalization(trials: int, seed: int) -> Iterator[Measured]:
    for place in relocalization.PLACES:
        config = TrialConfig(place=place, laser=_LASER, people=3)
        search_ms, query_ms, right = relocalization.measured(config, trials, seed)
        yield Measured(
            "relocalization", f"one scan, no prior, {place}", f"{np.median(query_ms):.1f} ms",
            f"search alone {np.median(search_ms):.1f} ms; first answer right {right} of {trials}",
        )  # fmt: skip


def _mapping(log: Log) -> Iterator[Measured]:
    log.check_sees()
    with one_core():
        cost = mapping.measured(log)
    times_s = (cost.front_end_s, cost.with_loops_s, cost.with_finishing_s)
    for name, cpu_s in zip(mapping.LIMITS, times_s, strict=True):
        yield Measured(
            "mapping", f"{cost.log}, {name}", f"{cpu_s:.2f} s",
            f"{cost.duration_s / cpu_s:.0f} times real time",
        )  # fmt: skip
    grown = "" if cost.memory_mb is None else f"memory grew by {cost.memory_mb:.0f} MB"
    yield Measured(
        "mapping", f"{cost.log}, slowest update", f"{1000 * cost.slowest_update_s:.0f} ms", grown
    )


def _env(seed: int) -> Iterator[Measured]:
    figures = env.measured("random", 0.5, seed)
    for row in figures["cost"]:
        yield Measured(
            "env", row["env"], f"{row['step_us']:.0f} µs a step",
            f"{row['ratio']:.2f} times bare MuJoCo with the same beams",
        )  # fmt: skip
    rates = figures["vector"]
    yield Measured(
        "env", f"{rates['native_envs']} native episodes, {rates['cores']:.0f} cores",
        f"{rates['native_per_s']:.0f} steps per s", f"{rates['ratio']:.2f} times AsyncVectorEnv",
    )  # fmt: skip

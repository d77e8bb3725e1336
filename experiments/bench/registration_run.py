"""`kitasap bench registration`: processor time and error of one scan on a map, by method.

Processor time is the process's own clock, all threads added up, so that helpers do not hide; and
the methods take turns scan by scan, so that what else runs on the machine slows all alike.
"""

import json
import math
import os
import statistics
import sys
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table

from experiments import provenance
from experiments.bench.registration import OURS, Register, Registration
from experiments.bench.registration_data import (
    START_ERROR_M,
    START_ERROR_RAD,
    RegistrationData,
    RegistrationTrial,
    drawn,
)
from experiments.bench.registration_peers import MAX_PAIR_DISTANCE_M, PEERS
from experiments.paper import VICINITY_M, VICINITY_RAD
from experiments.tables import wide_console
from kitasap_sim.laser import LaserSpec
from kitasap_sim.places import Place
from slam.arrays import FloatArray

Bound = Callable[[RegistrationData, RegistrationTrial], FloatArray]
"""The least covariance (3, 3) of x, y [m] and heading [rad] that a scan allows (Cramer-Rao)."""

_LONG_ENOUGH_S = 2e-3
_MAX_REPEATS = 20
"""Fast registrations are repeated until together they take so long, at most so often."""


@dataclass(frozen=True)
class RowResult:
    """One method over all trials.

    cpu_us: median over the trials. prepare_ms: imports and preparation of the map; first_ms: the
    first call, in which numba compiles, once on a machine, or loads what was compiled; both in
    processor time. A library is imported by the first row that uses it. Errors are over the trials
    that did not fail: ended within 5 cm and 2 degrees; None if all failed.
    other_threads: share of the time that was not spent by the calling thread.
    """

    name: str
    note: str
    cpu_us: float
    prepare_ms: float
    first_ms: float
    position_rmse_mm: float | None
    heading_rmse_mrad: float | None
    failed: int
    other_threads: float


@dataclass(frozen=True)
class BenchmarkResult:
    """The rows in the order of the table; what they were measured on; who was left out.

    bound: RMSE of position [mm] and heading [mrad] at the Cramer-Rao bound, where it was asked for.
    """

    rows: list[RowResult]
    data: RegistrationData
    missing: dict[str, list[str]]
    bound: tuple[float, float] | None = None

    def record(self) -> dict[str, Any]:
        """The result as plain numbers."""
        sizes = self.data.scan_sizes
        bound = self.bound and dict(
            zip(("position_rmse_mm", "heading_rmse_mrad"), self.bound, strict=True)
        )
        return {
            "trials": len(self.data.trials),
            "map_points": len(self.data.known.points),
            "map_spacing_m": self.data.map_spacing_m,
            "scan_points": {
                "min": min(sizes),
                "median": statistics.median(sizes),
                "max": max(sizes),
            },
            "start_error_m": START_ERROR_M,
            "start_error_rad": START_ERROR_RAD,
            "max_pair_distance_m": MAX_PAIR_DISTANCE_M,
            "rows": [
                asdict(row) | {"times_faster": self.rows[0].cpu_us / row.cpu_us}
                for row in self.rows
            ],
            "cramer_rao_bound": bound,
            "missing": self.missing,
        }


def print_benchmark(
    place_name: str, laser_name: str, trials: int, seed: int, out: Path | None
) -> None:
    """Measures all rows, prints the table, and writes it to a JSON file where one is named."""
    result = measured(Place(place_name), laser_name, trials, seed)
    wide_console().print(table(result, f"{place_name}, {laser_name}, seed {seed}"))
    if result.missing:
        rows = sum(map(len, result.missing.values()))
        print(
            f"{rows} rows left out, {' and '.join(result.missing)} missing: "
            "pip install 'kitasap[peers]'"
        )
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        asked = {"place": place_name, "laser": laser_name, "seed": seed}
        known = asked | result.record() | _provenance(result.missing)
        out.write_text(json.dumps(known, indent=2) + "\n")
        print(f"written: {out}")


def measured(
    place: Place,
    laser: LaserSpec | str,
    trials: int,
    seed: int,
    *,
    methods: Sequence[Registration] = (*PEERS, *OURS),
    bound: Bound | None = None,
) -> BenchmarkResult:
    """Every method on the same scans and map, each within one thread.

    Methods whose library is not installed are left out. The first one is what the others are
    compared with. bound: for one row more.
    """
    data = drawn(place, laser, trials, seed)
    with one_core():
        runs, missing = _prepared(methods, data)
        for trial in track(
            data.trials,
            f"{len(runs)} methods",
            console=Console(stderr=True),
            transient=True,
            disable=not sys.stderr.isatty(),
        ):
            for run in runs:
                run.measure(trial)
    least = None if bound is None else _bound(bound, data)
    return BenchmarkResult([run.result() for run in runs], data, missing, least)


@contextmanager
def one_core() -> Iterator[None]:
    """This thread, and all that it starts, on one core: thread pools that count cores find one.

    Where a system cannot do that, or a pool runs already, its threads' time is counted like ours
    and told apart (`RowResult.other_threads`): without this, on two cores, 4 % of Open3D's and 9 %
    of its tensor ICP's, for the same total. NumPy's BLAS takes its number of threads from the
    environment; `experiments.cli.main` asks for one.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {sorted(cores)[os.getpid() % len(cores)]})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


@dataclass
class _Run:
    """A method ready to be measured, and what was measured so far."""

    method: Registration
    register: Register
    prepare_s: float
    first_s: float
    repeats: int
    cpu_s: list[float] = field(default_factory=list)
    thread_s: list[float] = field(default_factory=list)
    errors: list[FloatArray] = field(default_factory=list)

    def measure(self, trial: RegistrationTrial) -> None:
        """One scan more. What is timed are repetitions on caches that a first call has warmed."""
        arguments = trial.points_base, trial.scan, trial.T_start
        if self.repeats > 1:
            self.register(*arguments)
        cpu_s, thread_s = time.process_time(), time.thread_time()
        for _ in range(self.repeats):
            T_map_base = self.register(*arguments)
        self.thread_s.append((time.thread_time() - thread_s) / self.repeats)
        self.cpu_s.append((time.process_time() - cpu_s) / self.repeats)
        change = T_map_base.as_array() - trial.T_true.as_array()
        change[2] = math.remainder(change[2], math.tau)
        self.errors.append(change)

    def result(self) -> RowResult:
        """What came of it."""
        errors = np.array(self.errors)
        offsets_m = np.hypot(errors[:, 0], errors[:, 1])
        is_near = (offsets_m <= VICINITY_M) & (np.abs(errors[:, 2]) <= VICINITY_RAD)
        return RowResult(
            name=self.method.name,
            note=self.method.note,
            cpu_us=1e6 * statistics.median(self.cpu_s),
            prepare_ms=1e3 * self.prepare_s,
            first_ms=1e3 * self.first_s,
            position_rmse_mm=_rms(1e3 * offsets_m[is_near]),
            heading_rmse_mrad=_rms(1e3 * errors[is_near, 2]),
            failed=int(np.count_nonzero(~is_near)),
            other_threads=max(0.0, 1.0 - sum(self.thread_s) / max(sum(self.cpu_s), 1e-9)),
        )


def _prepared(
    methods: Sequence[Registration], data: RegistrationData
) -> tuple[list[_Run], dict[str, list[str]]]:
    runs: list[_Run] = []
    missing: dict[str, list[str]] = {}
    first = data.trials[0]
    for method in methods:
        started_s = time.process_time()
        try:
            register = method.prepare(data.known)
        except ImportError as error:  # not there, or broken: the other rows are worth having
            if method.package is None:
                raise
            if not isinstance(error, ModuleNotFoundError):
                print(f"{method.package} cannot be imported: {error}", file=sys.stderr)
            missing.setdefault(method.package, []).append(method.name)
            continue
        stamps_s = [time.process_time()]
        for _ in range(2):
            register(first.points_base, first.scan, first.T_start)
            stamps_s.append(time.process_time())
        first_s, once_s = np.diff(stamps_s).tolist()
        repeats = min(max(round(_LONG_ENOUGH_S / max(once_s, 1e-6)), 1), _MAX_REPEATS)
        runs.append(_Run(method, register, stamps_s[0] - started_s, first_s, repeats))
    return runs, missing


def table(result: BenchmarkResult, what: str) -> Table:
    """The result for a terminal."""
    sizes, known = result.data.scan_sizes, result.data.known
    others = max(row.other_threads for row in result.rows)
    shown = Table(
        title=f"One scan of {statistics.median(sizes):.0f} points (median) registered on a map of "
        f"{len(known.points)}\n{what}, {len(sizes)} trials, starts within "
        f"{100 * START_ERROR_M:.0f} cm and {START_ERROR_RAD} rad on each axis",
        caption="CPU: median processor time from a NumPy array of points to the pose, one thread "
        f"(others took {others:.1%} of it at most).\n"
        f"Times faster: than {result.rows[0].name}. Failed: ended farther than 5 cm or 2 degrees "
        "off; errors are over the rest.\n"
        "Map: import by the first row of each library, preparation of the map. First: the first call,\n"
        "in which numba compiles, once on a machine, or loads what was compiled.",
        box=box.SIMPLE_HEAD,
    )
    shown.add_column("method")
    for heading in ("CPU µs", "times faster", "RMSE mm", "mrad", "failed", "map ms", "first ms"):
        shown.add_column(heading, justify="right")
    shown.add_column("note", style="dim")
    for row in result.rows:
        shown.add_row(
            row.name,
            f"{row.cpu_us:.0f}",
            f"{result.rows[0].cpu_us / row.cpu_us:.3g}",
            _number(row.position_rmse_mm),
            _number(row.heading_rmse_mrad),
            str(row.failed),
            f"{row.prepare_ms:.0f}",
            f"{row.first_ms:.0f}",
            row.note,
        )
    if result.bound is not None:
        position_mm, heading_mrad = map(_number, result.bound)
        shown.add_row(
            "Cramer-Rao bound",
            "",
            "",
            position_mm,
            heading_mrad,
            "",
            "",
            "",
            "no method can do better",
        )
    return shown


def _bound(bound: Bound, data: RegistrationData) -> tuple[float, float]:
    least = np.mean([np.diag(bound(data, trial)) for trial in data.trials], axis=0)
    return 1e3 * math.sqrt(least[0] + least[1]), 1e3 * math.sqrt(least[2])


def _rms(values: FloatArray) -> float | None:
    return math.sqrt(float(np.mean(values**2))) if len(values) else None


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _provenance(missing: Collection[str]) -> dict[str, Any]:
    packages = {method.package for method in PEERS if method.package is not None}
    peers = {package: version(package) for package in sorted(packages - set(missing))}
    return {"versions": provenance.versions() | peers, "commit": provenance.commit()}

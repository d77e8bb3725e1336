"""Every reader and every update given mutated input: `kitasap bench fuzz`.

One process for each target, which the one that started it watches over: it may crash, hang, or ask
for more memory than it gets, and goes on then with other inputs.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from experiments.fuzzing.board import RENEWED, Board, Tally
from experiments.fuzzing.child import Task
from experiments.fuzzing.targets import checked_targets
from experiments.tables import wide_console

_HANG_S = 20.0
"""Chosen: a map's end, with loops looked for once more, takes a second on a slow machine."""
_START_S = 180.0
"""All imported, kernels compiled."""
_LOOK_S = 0.25
_LEAST_S = 2.0
_MOST_DEATHS = 20


@dataclass
class Result:
    """What became of one target. found: by kind, the files that hold the inputs."""

    target: str
    seconds: float = 0.0
    tally: Tally = field(default_factory=Tally)
    found: list[Path] = field(default_factory=list)


def print_benchmark(name: str, minutes: float, inputs: int, seed: int, out: Path) -> bool:
    """Fuzzes one target or all, and prints a table; whether nothing was found."""
    targets, console = checked_targets(name), wide_console()
    results = []
    for target in targets:
        result = fuzzed(target, 60.0 * minutes, inputs, seed, out / target)
        results.append(result)
        for path in result.found:
            console.print(escape(f"{target}: {path}"), soft_wrap=True)
    console.print(_table(results, minutes, inputs, seed))
    return not any(result.found for result in results)


def fuzzed(target: str, seconds: float, inputs: int, seed: int, folder: Path) -> Result:
    """Fuzzes a target for so long, or so many inputs. The folder keeps corpus and what is found.

    Raises RuntimeError if the target cannot be loaded, or refuses its own valid inputs.
    """
    for name in ("corpus", "found", "files"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for path in (folder / "found").iterdir():  # of a run before: tried once more
        if path.suffix == ".bin":
            path.replace(folder / "corpus" / path.name)
        else:
            path.unlink()
    result, deaths, begun = Result(target), 0, 0
    while (left_s := seconds - result.seconds) > _LEAST_S or result.seconds == 0.0:
        left = inputs - result.tally.inputs
        if left <= 0:
            break
        how = _ended(Task(target, max(_LEAST_S, left_s), seed + begun, str(folder), left), result)
        begun, deaths = begun + 1, deaths + (how not in ("", "renewed"))
        if not how or deaths >= _MOST_DEATHS:
            break  # well, or found often enough
    result.found = sorted((folder / "found").glob("*.bin"))
    return result


def _ended(task: Task, result: Result) -> str:
    """How one process ended: "" well, "renewed" to be followed by another one, or a hang or death, and
    on what it hung or died is kept."""
    folder = Path(task.folder)
    board = Board(folder / "board", is_new=True)
    said = folder / "said.txt"
    with said.open("wb") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "experiments.fuzzing.child", task.text()],
            stdout=file, stderr=subprocess.STDOUT,
        )  # fmt: skip
        started_s, first_s, how = time.monotonic(), 0.0, ""
        try:
            while process.poll() is None and not how:
                time.sleep(_LOOK_S)
                tally, now_s = board.read(), time.monotonic()
                if tally.inputs and not first_s:
                    first_s = now_s
                hung_s = _HANG_S if first_s else _START_S
                if now_s - (tally.since_s or started_s) > hung_s and (tally.since_s or not first_s):
                    how = "hang"
                if first_s and now_s - first_s > task.seconds + 3 * _HANG_S:
                    break
        finally:
            process.kill()
            status = process.wait()
    tally = board.read()
    if not tally.inputs:
        raise RuntimeError(f"{task.target} cannot be fuzzed; {said} says why")
    result.seconds += time.monotonic() - (first_s or started_s)
    result.tally.add(tally)
    if not how and status == RENEWED:
        return "renewed"
    if not how and tally.since_s and status != 0:
        how = f"died-{abs(status)}"
    if how:
        data = board.under_way()
        kept = folder / "found" / f"{how}-{hashlib.sha256(data).hexdigest()[:8]}.bin"
        kept.write_bytes(data)
        for path in (folder / "corpus").iterdir():
            if path.read_bytes() == data:
                path.unlink()  # the next process shall get past it
        kept.with_suffix(".txt").write_bytes(said.read_bytes()[-20_000:])
    return how


def _table(results: list[Result], minutes: float, inputs: int, seed: int) -> Table:
    table = Table(title=f"Fuzzed for {minutes:g} minutes or {inputs} inputs each, seed {seed}")
    for column in ("target", "guided by"):
        table.add_column(column)
    for column in ("seconds", "inputs", "refused", "slowest [ms]", "memory grown [MB]", "found"):
        table.add_column(escape(column), justify="right")
    for result in results:
        tally = result.tally
        table.add_row(
            result.target, "coverage" if tally.is_guided else "nothing", f"{result.seconds:.0f}",
            str(tally.inputs), f"{100 * tally.refused / max(1, tally.inputs):.0f} %",
            f"{1000 * tally.slowest_s:.0f}", f"{tally.grown_kb / 1000:.0f}", str(len(result.found)),
        )  # fmt: skip
    table.caption = (
        "Found: kinds of inputs that crash, hang, take more than 500 MB, give a result that is not"
        " finite, or are refused in another way than one line that names the file. Coverage guides"
        " where atheris is installed: pip install 'kitasap\\[fuzz]'."
    )
    return table

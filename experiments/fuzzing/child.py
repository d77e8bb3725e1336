"""The process that fuzzes one target: `python -m experiments.fuzzing.child '{...}'`.

It may die of what it finds. Coverage guides it where atheris is installed; else inputs are mutated
without.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import resource
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path

from experiments.fuzzing.board import LONGEST_INPUT, RENEWED, Board, Tally
from experiments.fuzzing.files import check_refusal
from experiments.fuzzing.mutations import mutated
from experiments.fuzzing.targets import TARGETS, Reading, Target
from experiments.memory import resident_mb

_MORE_MB = 2_000
"""Address space beyond what the process has once all is loaded; chosen: four times the memory that an
input may take, since allocators ask for more than they touch."""
_MOST_GROWN_KB = 500_000
"""Chosen: maps of 16 million cells are read, and take 200 MB."""
_MOST_LEFT_KB = 300_000
"""Chosen: what atheris sees compared it keeps, 20 kB with each scan of a mapper, where the same
without it keeps nothing; a process that holds so much more ends, and another one goes on."""
_OWN_MUTATIONS = 0.7


@dataclass(frozen=True)
class Task:
    """One process's work. folder: corpus, found, board and files to read lie in it."""

    target: str
    seconds: float
    seed: int
    folder: str
    most_inputs: int

    def text(self) -> str:
        """For its command line."""
        return json.dumps(asdict(self))


class Trial:
    """Gives a target one input after the other, and keeps those that it should not have failed on."""

    def __init__(self, target: str, folder: Path, board: Board, read: Reading) -> None:
        self._target, self._read, self._board = TARGETS[target], read, board
        self._files, self._found = folder / "files", folder / "found"
        self.tally = Tally()
        self._known: dict[str, int] = {}
        self._first_kb = _held_kb()

    @property
    def is_worn(self) -> bool:
        """Whether the process holds much that it did not when it began."""
        return _held_kb() - self._first_kb > _MOST_LEFT_KB

    def arm(self) -> None:
        """Memory is counted, and limited, from here on."""
        self._first_kb = _held_kb()
        statm = Path("/proc/self/statm")
        if statm.exists():
            size = int(statm.read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (size + _MORE_MB * 10**6,) * 2)

    def __call__(self, data: bytes) -> None:
        """One input."""
        data = data[:LONGEST_INPUT]
        tally = self.tally
        self._board.begin(tally, data)
        peak_kb, held_kb = _peak_kb(), _held_kb()
        try:
            self._one(data)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is what is looked for
            self._keep(data, error)
        took_s = time.monotonic() - tally.since_s
        tally.inputs += 1
        tally.slowest_s = max(tally.slowest_s, took_s)
        # of what takes no more than another one before nobody knows how much
        grown_kb = _peak_kb() - held_kb if _peak_kb() > peak_kb else 0
        if grown_kb > max(_MOST_GROWN_KB, tally.grown_kb):
            self._keep(data, MemoryError(f"{grown_kb / 1000:.0f} MB"))
        tally.grown_kb = max(tally.grown_kb, grown_kb)
        tally.since_s = 0.0
        self._board.write(tally)

    def _one(self, data: bytes) -> None:
        try:
            self._read(data, self._files)
        except (ValueError, OSError) as error:
            if self._target.file is None:
                raise
            # the system's own errors name it where there is one
            check_refusal(error, None if isinstance(error, OSError) else self._target.file)
            self.tally.refused += 1

    def _keep(self, data: bytes, error: Exception) -> None:
        """The shortest input of each kind of failure: by its type, and where it came from."""
        frames = traceback.extract_tb(error.__traceback__)
        own = [one for one in frames if "/fuzzing/" not in one.filename] or frames
        where = "".join(f"{Path(one.filename).name}:{one.lineno}" for one in own[-1:])
        kind = f"{type(error).__name__}-{hashlib.sha256(where.encode()).hexdigest()[:8]}"
        if self._known.get(kind, LONGEST_INPUT + 1) <= len(data):
            return
        self._known[kind] = len(data)
        told = "".join(traceback.format_exception(error))
        (self._found / f"{kind}.bin").write_bytes(data)
        (self._found / f"{kind}.txt").write_text(told, encoding="utf-8", errors="replace")


def _held_kb() -> int:
    held_mb = resident_mb()
    return _peak_kb() if held_mb is None else round(1000.0 * held_mb)


def _peak_kb() -> int:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak // 1000 if sys.platform == "darwin" else peak


def main(task: Task) -> None:
    """Fuzzes until the time is over."""
    folder, target = Path(task.folder), TARGETS[task.target]
    is_guided = find_spec("atheris") is not None
    if is_guided:
        import atheris

        # atheris includes whole packages; what Numba compiles must be left as it is
        packages = sorted({name.split(".")[0] for name in target.instrumented})
        with atheris.instrument_imports(include=packages, exclude=_others(target, packages)):
            seeds, read = target.make(folder / "files")
    else:
        seeds, read = target.make(folder / "files")
    # what a user would be told on the way to a result is no result
    warnings.simplefilter("error", RuntimeWarning)
    trial = Trial(task.target, folder, Board(folder / "board", is_new=False), read)
    trial.tally.is_guided = int(is_guided)
    for data in seeds:  # valid ones: whatever is raised, nothing can be fuzzed with them
        read(data, folder / "files")
    trial.arm()

    def one(data: bytes) -> None:
        trial(data)
        if trial.is_worn:
            os._exit(RENEWED)  # libFuzzer lets nothing else end it

    seeds += [path.read_bytes() for path in sorted((folder / "corpus").glob("*-*.bin"))]
    (_guided if is_guided else _unguided)(task, seeds, one)


def _others(target: Target, packages: list[str]) -> list[str]:
    """The modules of packages that are not among those which a target has instrumented."""
    found = []
    for package in packages:
        spec = find_spec(package)
        for root in map(Path, (spec.submodule_search_locations or []) if spec else []):
            for path in root.rglob("*.py"):
                parts = path.relative_to(root.parent).with_suffix("").parts
                found.append(".".join(part for part in parts if part != "__init__"))
    wanted = target.instrumented
    return [name for name in found if not any(f"{name}.".startswith(f"{one}.") for one in wanted)]


def _unguided(task: Task, seeds: list[bytes], trial: Callable[[bytes], None]) -> None:
    rng, end_s, inputs = random.Random(task.seed), time.monotonic() + task.seconds, 0
    while time.monotonic() < end_s and inputs < task.most_inputs:
        trial(mutated(rng.choice(seeds), rng, rng.choice(seeds)))
        inputs += 1


def _guided(task: Task, seeds: list[bytes], trial: Callable[[bytes], None]) -> None:
    import atheris

    corpus = Path(task.folder) / "corpus"
    for number, data in enumerate(seeds):
        (corpus / f"seed{number}").write_bytes(data)

    def mutate(data: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if rng.random() > _OWN_MUTATIONS:
            return bytes(atheris.Mutate(data, most))
        # what is wrong already stays so: half of all begin with a valid one
        begin = rng.choice((data, rng.choice(seeds)))
        return mutated(begin, rng, rng.choice(seeds))[:most]

    # -timeout and limits of its own are off: the process that started this one watches over it
    options = {
        "max_total_time": max(1, round(task.seconds)), "runs": task.most_inputs,
        "seed": task.seed % 2**31 or 1, "max_len": LONGEST_INPUT, "rss_limit_mb": 0,
        "malloc_limit_mb": 0, "timeout": 100_000, "verbosity": 0, "detect_leaks": 0,
        "artifact_prefix": f"{task.folder}/",
    }  # fmt: skip
    arguments = [sys.argv[0], *(f"-{name}={value}" for name, value in options.items())]
    atheris.Setup([*arguments, str(corpus)], trial, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    main(Task(**json.loads(sys.argv[1])))

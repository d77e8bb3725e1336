"""Runs of many trials: in several processes, resumable, nothing finished ever lost."""

import importlib
import json
import multiprocessing
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from experiments.map_statistics import mapping_summary
from experiments.observer import NOBODY, TrialObserver
from experiments.paper import PAPER_VALUES
from experiments.provenance import commit, versions
from experiments.recovery import recovery_figures
from experiments.rehearsal import rehearse, told_if_long
from experiments.statistics import samples_of, summarised, verdict_counts
from experiments.trial_log import TrialLog, locked, write_atomically
from experiments.trials import TrialConfig, config_hash, generator

EXPERIMENTS = ("localization", "kidnap", "tracking", "mapping")

Finished = tuple[int, dict[str, Any], dict[str, Any]]
"""Index, record and timing of a trial."""


@dataclass(frozen=True)
class Run:
    """A number of trials of one experiment, in one folder."""

    experiment: str
    config: TrialConfig
    seed: int
    trials: int
    folder: Path

    def execute(
        self,
        jobs: int,
        on_trial: Callable[[int, dict[str, Any]], None],
        on_compiling: Callable[[], None] | None = None,
    ) -> dict[str, Any]:
        """Does the trials that the folder does not hold yet; the content of `summary.json`.

        on_trial: told of each trial's index and record, first of those done before. on_compiling:
        told if the first has to wait for compiled code, by another thread.
        Raises ValueError for a configuration that cannot be run, or a folder that holds another or
        in which another run is at work.
        """
        self.check()
        with locked(self.folder):
            return self._execute_alone(jobs, on_trial, on_compiling)

    def check(self) -> None:
        """Raises ValueError as `execute` does, before anything is run."""
        experiment_module(self.experiment).checked(self.config)
        if self.folder.exists():
            with locked(self.folder):
                self._log()

    def _execute_alone(
        self,
        jobs: int,
        on_trial: Callable[[int, dict[str, Any]], None],
        on_compiling: Callable[[], None] | None,
    ) -> dict[str, Any]:
        started_s = time.monotonic()
        log = self._log()
        self._write_config()
        for index in sorted(log.records):
            if index < self.trials:
                on_trial(index, log.records[index])
        missing = [index for index in range(self.trials) if index not in log.records]
        if missing:
            # here first, also where others do the trials: they load what was compiled
            with told_if_long(on_compiling):
                rehearse(self.experiment, self.config)
        for index, record, timing in self._finished(missing, jobs):
            log.append(index, record, timing)
            on_trial(index, record)
        log.finish(self.trials)
        return self._write_summary(log, time.monotonic() - started_s)

    def _finished(self, missing: list[int], jobs: int) -> Iterator[Finished]:
        """The trials as they finish. Those under way at an interrupt are still handed out."""
        job = (self.experiment, self.config, self.seed)
        if min(jobs, len(missing)) <= 1:
            yield from (recorded_trial(*job, index) for index in missing)
            return
        pool = ProcessPoolExecutor(
            min(jobs, len(missing)),
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_prepare_worker,
            initargs=(self.experiment, self.config),
        )
        queue = iter(missing)
        pending: set[Future[Finished]] = set()
        try:
            while True:
                # no more are handed to the pool than it works on: an interrupt ends soon
                while len(pending) < jobs and (index := next(queue, None)) is not None:
                    with _interrupts_held():  # for a process that this may start
                        pending.add(pool.submit(recorded_trial, *job, index))
                if not pending:
                    break
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
        except KeyboardInterrupt:
            done, _ = wait(pending)
            yield from (future.result() for future in done)
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def _log(self) -> TrialLog:
        return TrialLog(self.folder, self.experiment, self._config_hash)

    @property
    def _config_hash(self) -> str:
        return config_hash(self.experiment, self.config, self.seed)

    def _write_config(self) -> None:
        content = {
            "experiment": self.experiment,
            "config": asdict(self.config),
            "config_hash": self._config_hash,
            "seed": self.seed,
            "trials": self.trials,
            "versions": versions(),
            "commit": commit(),
            "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
        }
        write_atomically(self.folder / "config.json", json.dumps(content, indent=2) + "\n")

    def _write_summary(self, log: TrialLog, wall_s: float) -> dict[str, Any]:
        indices = [index for index in sorted(log.records) if index < self.trials]
        records = [log.records[index] for index in indices]
        counted = samples_of(records)
        samples = [sample for sample in counted if sample["status"] == "ok"]
        timings = [log.timings[index] for index in indices if index in log.timings]
        summary = {
            "experiment": self.experiment,
            "trials": len(records),
            "samples": len(samples),
            "seed": self.seed,
            "wall_s": round(wall_s, 3),
            "cpu_s": round(sum(timing["cpu_s"] for timing in timings), 3),
            "sim_s": round(sum(record.get("sim_s", 0.0) for record in records), 3),
            "people_in_view": _mean(
                [record["people_in_view"] for record in samples if "people_in_view" in record]
            ),
            "methods": self._of_methods(counted),
            "paper_values": PAPER_VALUES.get(self.experiment),
        }
        if self.experiment == "tracking":
            for name, figures in summary["methods"].items():
                figures |= verdict_counts(records, name)
        if self.experiment == "kidnap":
            for name, figures in summary["methods"].items():
                figures |= recovery_figures(records, timings, name)
        write_atomically(self.folder / "summary.json", json.dumps(summary, indent=2) + "\n")
        return summary

    def _of_methods(self, records: list[dict[str, Any]]) -> dict[str, Any]:
        if self.experiment == "mapping":
            return mapping_summary(records, self.config.methods)
        return summarised(records, self.config.methods)


def _mean(values: list[int]) -> float | None:
    return sum(values) / len(values) if values else None


def experiment_module(name: str) -> ModuleType:
    """The module of an experiment. Raises ValueError, naming those there are, if unknown."""
    if name not in EXPERIMENTS:
        raise ValueError(f"no experiment called '{name}'; there are: {', '.join(EXPERIMENTS)}")
    return importlib.import_module(f"experiments.{name}")


def trial_result(
    experiment: str,
    config: TrialConfig,
    seed: int,
    index: int,
    observer: TrialObserver = NOBODY,
) -> Any:
    """One trial of a run, bit for bit, with all that its record leaves out."""
    module = experiment_module(experiment)
    if experiment == "mapping":
        config = module.of_trial(config, index)
    return module.run_trial(config, generator(experiment, seed, index), observer)


def recorded_trial(experiment: str, config: TrialConfig, seed: int, index: int) -> Finished:
    """One trial's record and timing. A trial that raises is a failed trial, with its traceback."""
    started_s = time.process_time()
    timing: dict[str, Any] = {}
    try:
        result = trial_result(experiment, config, seed, index)
        record = result.record()
        timing["methods"] = {name: round(cpu_s, 6) for name, cpu_s in result.cpu_s.items()}
    except Exception as error:  # noqa: BLE001 - whatever a trial raises is its result
        record = {
            "status": "error",
            "error": f"{type(error).__name__}: {error}",
            "traceback": traceback.format_exc(),
        }
    timing["cpu_s"] = round(time.process_time() - started_s, 6)
    return index, record, timing


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """A process started within never hears of Ctrl-C, not even in the second of its imports.

    This one hears of it at the end: a mask is inherited, and it loses no signal.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _prepare_worker(experiment: str, config: TrialConfig) -> None:
    """Leaves Ctrl-C to the parent, and does not outlive it, however it dies; then rehearses."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    rehearse(experiment, config)


def _exit_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

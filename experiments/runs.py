"""Runs of many trials: by any engine, in shards, resumable, nothing finished ever lost."""

import importlib
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

from experiments.engines import Engine, Finished, Task, Tell
from experiments.json_lines import OtherRun
from experiments.observer import NOBODY, TrialObserver
from experiments.processes import local_engine
from experiments.rehearsal import rehearse, told_if_long
from experiments.run_files import difference, shard_of, write_config, write_summary
from experiments.shards import WHOLE, Shard
from experiments.trial_log import TrialLog, locked
from experiments.trials import TrialConfig, config_hash, generator

EXPERIMENTS = ("localization", "kidnap", "tracking", "mapping")


class Enough(Protocol):
    """When a run may end before all its trials are done."""

    @property
    def looks(self) -> Iterable[int]:
        """After how many trials, the first ones, it is asked."""
        ...

    def __call__(self, records: Iterable[dict[str, Any]]) -> bool:
        """Whether these trials are enough."""
        ...


@dataclass(frozen=True)
class Run:
    """A number of trials of one experiment, in one folder.

    shard: the part of them that is done here. again: trials that raised are done again. enough: ends
    it earlier, by its first trials alone.
    """

    experiment: str
    config: TrialConfig
    seed: int
    trials: int
    folder: Path
    shard: Shard = WHOLE
    again: bool = False
    enough: Enough | None = None

    def execute(
        self,
        engine: Engine | int,
        on_trial: Callable[[int, dict[str, Any]], None],
        on_compiling: Callable[[], None] | None = None,
        tell: Tell = lambda _: None,
    ) -> dict[str, Any]:
        """Does the trials that the folder does not hold yet; the content of `summary.json`.

        engine: or a number of processes. on_trial: told of each trial's index and record, first of
        those done before. on_compiling: told if the first has to wait for compiled code, by another
        thread. tell: told in a line what went wrong and was mended.
        Raises ValueError for a configuration that cannot be run, or a folder that holds another or
        in which another run is at work.
        """
        self.check()
        if isinstance(engine, int):
            engine = local_engine(engine)
        with locked(self.folder), closing(self._log()) as log:
            return self._execute_alone(log, engine, on_trial, on_compiling, tell)

    def check(self) -> None:
        """Raises ValueError as `execute` does, before anything is run."""
        experiment_module(self.experiment).checked(self.config)
        if self.folder.exists():
            with locked(self.folder):
                self._log(is_kept=True)
                held = shard_of(self.folder) or self.shard
                if self.shard not in (WHOLE, held):
                    raise ValueError(
                        f"{self.folder} holds {held.words} of this run, not {self.shard.words}:"
                        " give each an --out of its own"
                    )

    def records(self) -> Iterator[dict[str, Any]]:
        """What the log holds of the trials that were asked for, in their order."""
        log = self._log(is_kept=True)
        there = [index for index in self.shard.indices(self.trials) if index in log.trials]
        return log.trials.records(there)

    @property
    def task(self) -> Task:
        """What is done for each trial."""
        return TrialTask(self.experiment, self.config, self.seed)

    def _execute_alone(
        self,
        log: TrialLog,
        engine: Engine,
        on_trial: Callable[[int, dict[str, Any]], None],
        on_compiling: Callable[[], None] | None,
        tell: Tell,
    ) -> dict[str, Any]:
        started_s = time.monotonic()
        if log.mended:
            tell(log.mended)
        write_config(self, log.config_hash, self.trials)
        asked = list(self.shard.indices(self.trials))
        if self.again:
            _forget_raised(log, asked)
        done = [index for index in asked if index in log.trials]
        for index, record in zip(done, log.trials.records(done), strict=True):
            on_trial(index, record)
        trials = self._do_missing(log, engine, on_trial, on_compiling, tell)
        if trials < self.trials:
            write_config(self, log.config_hash, trials)
            asked = [index for index in asked if index < trials]
        log.finish(asked)
        return write_summary(self, log, asked, time.monotonic() - started_s)

    def _do_missing(
        self,
        log: TrialLog,
        engine: Engine,
        on_trial: Callable[[int, dict[str, Any]], None],
        on_compiling: Callable[[], None] | None,
        tell: Tell,
    ) -> int:
        """How many of the first trials are there in the end: all, or as many as are enough."""
        if all(index in log.trials for index in self.shard.indices(self.trials)):
            return self._enough_of(log) or self.trials
        # here first, also where others do the trials: they load what was compiled
        with told_if_long(on_compiling):
            rehearse(self.experiment, self.config)
        with engine.at_work(self.task, log.config_hash, tell) as work:
            for trials in self._stages:
                asked = self.shard.indices(trials)
                for index, record, timing in work([one for one in asked if one not in log.trials]):
                    log.append(index, record, timing)
                    on_trial(index, record)
                if self._is_enough(log, trials):
                    return trials
        return self.trials

    @property
    def _stages(self) -> list[int]:
        """After how many trials it may end."""
        looks = [] if self.enough is None else self.enough.looks
        return [*(look for look in looks if look < self.trials), self.trials]

    def _enough_of(self, log: TrialLog) -> int | None:
        return next((trials for trials in self._stages if self._is_enough(log, trials)), None)

    def _is_enough(self, log: TrialLog, trials: int) -> bool:
        return self.enough is not None and self.enough(log.trials.records(range(trials)))

    def _log(self, *, is_kept: bool = False) -> TrialLog:
        try:
            return TrialLog(self.folder, self.experiment, self._config_hash, is_kept=is_kept)
        except OtherRun as error:
            how = difference(self)
            raise ValueError(f"{error}{how}: choose another --out, or remove that folder") from None

    @property
    def _config_hash(self) -> str:
        return config_hash(self.experiment, self.config, self.seed)


def _forget_raised(log: TrialLog, asked: list[int]) -> None:
    done = [index for index in asked if index in log.trials]
    raised = [
        index
        for index, record in zip(done, log.trials.records(done), strict=True)
        if record["status"] != "ok"
    ]
    for index in raised:
        log.trials.forget(index)


@dataclass(frozen=True)
class TrialTask:
    """The trials of a run, by their indices, in whatever process."""

    experiment: str
    config: TrialConfig
    seed: int

    def prepare(self) -> str:
        """Gets a process ready for the first trial; the hash that it would log trials under."""
        rehearse(self.experiment, self.config)
        return config_hash(self.experiment, self.config, self.seed)

    def __call__(self, index: int) -> Finished:
        """One trial's record and timing."""
        return recorded_trial(self.experiment, self.config, self.seed, index)


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

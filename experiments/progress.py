"""Live progress: of a run's trials and how many of them each method won, of a log's scans."""

import sys
from types import TracebackType
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from slam.localization import Estimate


class TrialProgress:
    """A progress bar on a terminal, a line now and then elsewhere."""

    def __init__(self, name: str, trials: int, methods: tuple[str, ...]) -> None:
        self._name, self._trials = name, trials
        self._done, self._raised = 0, 0
        self._successes = dict.fromkeys(methods, 0)
        self._bar = Progress(
            TextColumn(name),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[successes]}"),
            console=Console(stderr=True),
            disable=not sys.stderr.isatty(),
        )
        self._task = self._bar.add_task(name, total=trials, successes="")

    def __enter__(self) -> "TrialProgress":
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.stop()

    def update(self, index: int, record: dict[str, Any]) -> None:
        """Counts one more trial."""
        self._done += 1
        if record["status"] != "ok":
            self._raised += 1
        else:
            for name in self._successes:
                self._successes[name] += record["methods"][name]["success"]
        self._bar.update(self._task, completed=self._done, successes=self._text())
        if self._bar.disable and self._done % max(1, self._trials // 10) == 0:
            print(f"{self._name} {self._done} of {self._trials}: {self._text()}", file=sys.stderr)

    def _text(self) -> str:
        won = ", ".join(f"{name} {count}" for name, count in self._successes.items())
        return f"succeeded: {won}" + (f"; raised: {self._raised}" if self._raised else "")


class ScanProgress:
    """A progress bar over the scans of a log, on a terminal; with the last verdict where there is one."""

    def __init__(self, name: str) -> None:
        self._bar = Progress(
            TextColumn(name),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[verdict]}"),
            console=Console(stderr=True),
            disable=not sys.stderr.isatty(),
        )
        self._task = self._bar.add_task(name, total=None, verdict="")

    def __enter__(self) -> "ScanProgress":
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.stop()

    def update(self, index: int, scans: int, estimate: "Estimate | None" = None) -> None:
        """One more scan of so many is done."""
        verdict = "" if estimate is None else estimate.verdict.status.value
        self._bar.update(self._task, completed=index + 1, total=scans, verdict=verdict)

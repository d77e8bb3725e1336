"""Live progress: of a run's trials and how many of them each method won, of a log's scans."""

import math
import sys
from typing import TYPE_CHECKING, Any, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from slam.localization import Estimate
    from slam.mapping import MapperStep


class _Bar:
    """A named progress bar with some words behind it, on a terminal. tells: elsewhere a line after each
    tenth."""

    tells = False

    def __init__(self, name: str, total: int | None) -> None:
        self._bar = Progress(
            TextColumn(name),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[words]}"),
            console=Console(stderr=True),
            disable=not sys.stderr.isatty(),
            # a library imported meanwhile may keep what it finds there for good
            redirect_stdout=False,
            redirect_stderr=False,
        )
        self._last_words = ""
        self._name, self._total, self._tenths = name, total, 0
        self._task = self._bar.add_task(name, total=total, words="")

    def __enter__(self) -> Self:
        if not self._is_hidden:  # older rich ends a hidden one with an empty line
            self._bar.start()
        return self

    def __exit__(self, *raised: object) -> None:
        if not self._is_hidden:
            self._bar.update(self._task, words=self._last_words)
            self._bar.stop()

    @property
    def _is_hidden(self) -> bool:
        return self._bar.disable

    def _show(self, done: int, words: str, total: int | None = None, now: str = "") -> None:
        """total: None: as before. now: words more, of what is done until the bar is left."""
        self._last_words, self._total = words, total or self._total
        if self.tells and self._is_hidden and self._total:
            self._tell_tenth(done, self._total, words)
        words = f"{words}; {now}" if words and now else words or now
        self._bar.update(self._task, completed=done, total=total, words=words)
        if done == total:
            # what comes now may keep the thread that draws from its turn
            self._bar.refresh()

    def tell(self, line: str) -> None:
        """Says something that stays: above the bar, where there is one."""
        if self._is_hidden:
            print(f"{self._name}: {line}", file=sys.stderr)
        else:
            self._bar.console.print(f"{self._name}: {line}", markup=False, highlight=False)

    def _tell_tenth(self, done: int, total: int, words: str) -> None:
        """Where each tenth of so many begins to be over; anew where it is done once more."""
        tenths = 10 * done // total
        if tenths > self._tenths:
            print(f"{self._name} {done} of {total}: {words}", file=sys.stderr)
        self._tenths = tenths


class TrialProgress(_Bar):
    """A progress bar over the trials of a run, and who succeeded in them."""

    tells = True

    def __init__(self, name: str, trials: int, methods: tuple[str, ...]) -> None:
        super().__init__(name, trials)
        self._done, self._raised = 0, 0
        self._successes = dict.fromkeys(methods, 0)

    def update(self, index: int, record: dict[str, Any]) -> None:
        """Counts one more trial."""
        self._done += 1
        if record["status"] != "ok":
            self._raised += 1
        else:
            for name in self._successes:
                self._successes[name] += record["methods"][name]["success"]
        self._show(self._done, self._text())

    def compiling(self) -> None:
        """Says why nothing happens yet."""
        said = "loading what was compiled, or compiling it: some 30 s, once per checkout"
        self._show(self._done, "", now=said)
        if self._is_hidden:
            print(f"{self._name}: {said}", file=sys.stderr)

    def _text(self) -> str:
        won = ", ".join(f"{name} {count}" for name, count in self._successes.items())
        return f"succeeded: {won}" + (f"; raised: {self._raised}" if self._raised else "")


class ScanProgress(_Bar):
    """A progress bar over the scans of a log; with the last verdict where there is one."""

    tells = True

    def __init__(self, name: str) -> None:
        super().__init__(name, None)

    def update(self, index: int, scans: int, estimate: "Estimate | None" = None) -> None:
        """One more scan of so many is done."""
        self._show(index + 1, "" if estimate is None else estimate.verdict.status.value, scans)


class CountProgress(_Bar):
    """A progress bar over what is done so many times."""

    tells = True

    def __init__(self, name: str, total: int) -> None:
        super().__init__(name, total)

    def update(self, done: int, words: str = "") -> None:
        """So many are done."""
        self._show(done, words)


class DriveProgress(_Bar):
    """A progress bar over the seconds of a drive, and what is worked out after it."""

    def __init__(self, name: str, after: str) -> None:
        super().__init__(name, None)
        self._after = after

    def update(self, time_s: float, duration_s: float) -> None:
        """So much of the drive is over."""
        total = math.ceil(duration_s)
        is_over = time_s >= duration_s
        done = total if is_over else int(time_s)
        self._show(done, "seconds driven", total, now=self._after if is_over else "")


class SlamProgress(_Bar):
    """A progress bar over the scans of a log that is mapped: the last step, and the loops so far."""

    tells = True

    def __init__(self, name: str) -> None:
        super().__init__(name, None)

    def update(self, index: int, scans: int, step: "MapperStep") -> None:
        """One more scan of so many is placed. With the last one the map is not finished yet."""
        joined = "" if step.is_joined else ", not joined yet"
        now = "finishing the map" if index + 1 == scans else ""
        self._show(index + 1, f"{step.status.value}, {step.loops} loops{joined}", scans, now)

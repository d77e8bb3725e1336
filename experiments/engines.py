"""Who does the trials of a run: this process, or a crew of others. The results are the same."""

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

Finished = tuple[int, dict[str, Any], dict[str, Any]]
"""Index, record and timing of a trial."""
Tell = Callable[[str], None]
"""Told in one line what whoever waits for the run should know."""
Work = Callable[[Iterable[int]], Iterator[Finished]]
"""Does trials by their indices; handed out as they finish, in whatever order."""

_ATTEMPTS = 3
"""Chosen: a trial whose process dies is done again twice, by others, and is a failure then."""
_DEAD_STARTS = 3
"""Chosen: so many processes in a row that die before they are ready are no accident."""
_LONG_S = 600.0
"""Chosen: a trial that takes longer, and has no limit, is told of."""


class Task(Protocol):
    """What is to be done: pure in the index, so that any process may do any trial, and twice."""

    def prepare(self) -> str:
        """Gets a process ready for the first trial; names what its trials would depend on."""
        ...

    def __call__(self, index: int) -> Finished:
        """One trial. It raises nothing."""
        ...


class Engine(Protocol):
    """Where trials are done."""

    def at_work(self, task: Task, identity: str, tell: Tell) -> AbstractContextManager[Work]:
        """Trials are done while this is entered. identity: what `prepare` has to say everywhere.

        Raises ValueError where it says something else, RuntimeError where no process starts.
        """
        ...


class SerialEngine:
    """This process, one trial after the other."""

    @contextmanager
    def at_work(self, task: Task, identity: str, tell: Tell) -> Iterator[Work]:
        """As of any engine; prepared has whoever calls."""
        yield lambda indices: (task(index) for index in indices)


@dataclass(frozen=True)
class Ready:
    """A hand may start; identity: what its `prepare` said."""

    hand: "Hand"
    identity: str


@dataclass(frozen=True)
class Done:
    """A hand has finished its trial."""

    hand: "Hand"
    finished: Finished


@dataclass(frozen=True)
class Gone:
    """A hand has died; how: in words."""

    hand: "Hand"
    how: str


class Hand(Protocol):
    """One process of a crew."""

    def start(self, index: int) -> None:
        """Has it do a trial; it is ready, or done with the one before."""
        ...

    def kill(self) -> None:
        """Ends it at once, whatever it does; nothing more is heard of it."""
        ...


class Crew(Protocol):
    """Processes that do one task's trials, one each at a time."""

    def hire(self) -> Hand:
        """One more, which says when it is ready."""
        ...

    def events(self, timeout_s: float | None) -> list[Ready | Done | Gone]:
        """What happened; waits for it, up to so long."""
        ...

    def dismiss(self) -> None:
        """Ends all that there are."""
        ...


class CrewEngine:
    """Several processes. Whichever of them hangs or dies, the others go on, and its trial is done.

    crew: makes them for a task; jobs: at most so many; limit_s: of a trial, by the clock.
    """

    def __init__(self, crew: Callable[[Task], Crew], jobs: int, limit_s: float | None) -> None:
        self._crew, self._jobs, self._limit_s = crew, jobs, limit_s

    @contextmanager
    def at_work(self, task: Task, identity: str, tell: Tell) -> Iterator[Work]:
        """As of any engine."""
        crew = self._crew(task)
        try:
            yield _Foreman(crew, self._jobs, self._limit_s, identity, tell).finished
        finally:
            crew.dismiss()


@dataclass
class _Started:
    """A trial that is under way."""

    index: int
    since_s: float
    is_told: bool = False


class _Foreman:
    """Hands out trials, one to each hand, and again where a hand died with one."""

    def __init__(
        self, crew: Crew, jobs: int, limit_s: float | None, identity: str, tell: Tell
    ) -> None:
        self._crew, self._jobs, self._limit_s = crew, jobs, limit_s
        self._identity, self._tell = identity, tell
        self._waiting: deque[int] = deque()
        self._starting: set[Hand] = set()
        self._idle: list[Hand] = []
        self._busy: dict[Hand, _Started] = {}
        self._deaths: Counter[int] = Counter()
        self._dead_starts = 0
        self._is_ending = False

    def finished(self, indices: Iterable[int]) -> Iterator[Finished]:
        """The trials as they finish. Those under way at an interrupt are still handed out."""
        self._waiting = deque(indices)
        try:
            yield from self._until_done()
        except KeyboardInterrupt:
            self._waiting.clear()
            self._is_ending = True
            if self._busy:
                self._tell("waiting for the trials under way; another interrupt ends them")
            yield from self._until_done()
            raise

    def _until_done(self) -> Iterator[Finished]:
        while self._waiting or self._busy:
            self._staff()
            for event in self._crew.events(self._patience_s()):
                match event:
                    case Ready(hand, identity):
                        self._welcome(hand, identity)
                    case Done(hand, finished):
                        del self._busy[hand]
                        self._idle.append(hand)
                        yield finished
                    case Gone(hand, how):
                        yield from self._bury(hand, how)
            yield from self._overdue()

    def _staff(self) -> None:
        """Whoever is idle gets a trial; for those that are left more hands are hired."""
        while self._waiting and self._idle:
            hand, index = self._idle.pop(), self._waiting.popleft()
            self._busy[hand] = _Started(index, time.monotonic())
            hand.start(index)
        wanted = min(self._jobs - len(self._busy), len(self._waiting))
        while len(self._starting) < wanted:
            self._starting.add(self._crew.hire())

    def _welcome(self, hand: Hand, identity: str) -> None:
        if identity != self._identity:
            raise ValueError(
                "a process of this run has another version of the code, its libraries or the place"
                " than the one that started it: they must not differ"
            )
        self._starting.remove(hand)
        self._idle.append(hand)
        self._dead_starts = 0

    def _bury(self, hand: Hand, how: str) -> Iterator[Finished]:
        """Its trial is done again, unless all is to end; too often, and that is the trial's result."""
        if hand in self._idle:
            self._idle.remove(hand)
            return
        if hand in self._starting:
            self._starting.remove(hand)
            self._dead_starts += 1
            if self._dead_starts >= _DEAD_STARTS:
                raise RuntimeError(f"the processes that are to do the trials die at once ({how})")
            return
        index = self._busy.pop(hand).index
        if self._is_ending:  # a SIGTERM for all processes is theirs as well
            return
        self._deaths[index] += 1
        if self._deaths[index] < _ATTEMPTS:
            self._waiting.appendleft(index)
            self._tell(f"the process at trial {index} died ({how}); the trial is done again")
            return
        yield _failed(index, f"process died: {_ATTEMPTS} times, the last one {how}", 0.0)

    def _patience_s(self) -> float | None:
        """Until the first trial that is under way has taken too long."""
        limit_s = self._limit_s or _LONG_S
        awaited = [one for one in self._busy.values() if self._limit_s or not one.is_told]
        if not awaited:
            return None
        first_s = min(one.since_s for one in awaited)
        return max(0.0, first_s + limit_s - time.monotonic())

    def _overdue(self) -> Iterator[Finished]:
        now_s = time.monotonic()
        for hand, one in list(self._busy.items()):
            taken_s = now_s - one.since_s
            if self._limit_s is not None and taken_s >= self._limit_s:
                hand.kill()
                del self._busy[hand]
                self._tell(f"trial {one.index} was not done within {self._limit_s:g} s: stopped")
                why = f"timeout: not done within {self._limit_s:g} s"
                yield _failed(one.index, why, taken_s)
            elif self._limit_s is None and taken_s >= _LONG_S and not one.is_told:
                one.is_told = True
                self._tell(
                    f"trial {one.index} has been under way for {taken_s / 60.0:.0f} minutes;"
                    " --trial-timeout ends such"
                )


def _failed(index: int, error: str, wall_s: float) -> Finished:
    """The trial of a process that was ended; its processor time went with it."""
    record = {"status": "error", "error": error, "traceback": ""}
    return index, record, {"cpu_s": 0.0, "wall_s": round(wall_s, 3)}

"""A crew of processes on this machine. None outlives the one that started it, however that ends."""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait

from experiments.engines import CrewEngine, Done, Engine, Gone, Ready, SerialEngine, Task

_PR_SET_PDEATHSIG = 1
"""Of Linux: prctl(2)."""
_END_S = 10.0


def local_engine(jobs: int | None = None, limit_s: float | None = None) -> Engine:
    """This machine. jobs: processes, one per core if not said; limit_s: of each trial.

    A single one is this process, unless a trial may have to be stopped.
    """
    jobs = jobs or cores()
    if jobs == 1 and limit_s is None:
        return SerialEngine()
    return CrewEngine(ProcessCrew, jobs, limit_s)


def cores() -> int:
    """On how many this process may run."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class ProcessHand:
    """One process, and the pipe to it."""

    def __init__(self, task: Task) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, far = context.Pipe()
        self._process = context.Process(target=_work, args=(far, task), daemon=True)
        with _interrupts_held():
            self._process.start()
        far.close()

    def start(self, index: int) -> None:
        """Has it do a trial. One that is dead is heard of later."""
        try:
            self.pipe.send(index)
        except OSError:
            return

    def kill(self) -> None:
        """Ends it at once."""
        self._process.kill()
        self._process.join(_END_S)
        self.pipe.close()

    def epitaph(self) -> str:
        """How it died, in words; it has closed its end of the pipe."""
        self._process.join(_END_S)
        self.kill()
        code = self._process.exitcode
        if code is not None and code < 0:
            return f"by signal {-code}"
        return f"with status {code}"


class ProcessCrew:
    """Processes of this machine that do one task's trials."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._hands: dict[Connection, ProcessHand] = {}

    def hire(self) -> ProcessHand:
        """One more process."""
        hand = ProcessHand(self._task)
        self._hands[hand.pipe] = hand
        return hand

    def events(self, timeout_s: float | None) -> list[Ready | Done | Gone]:
        """What the processes said, or that they died."""
        for pipe in [pipe for pipe in self._hands if pipe.closed]:  # of those that were killed
            del self._hands[pipe]
        heard = wait(list(self._hands), timeout_s)
        return [self._heard(pipe) for pipe in heard if isinstance(pipe, Connection)]

    def dismiss(self) -> None:
        """Ends them all."""
        for hand in self._hands.values():
            hand.kill()
        self._hands.clear()

    def _heard(self, pipe: Connection) -> Ready | Done | Gone:
        hand = self._hands[pipe]
        try:
            said = pipe.recv()
        except (EOFError, OSError):  # also in the middle of what it said
            del self._hands[pipe]
            return Gone(hand, hand.epitaph())
        return Ready(hand, said) if isinstance(said, str) else Done(hand, said)


def _work(pipe: Connection, task: Task) -> None:
    """What each process does: gets ready, then trials, until nobody wants more."""
    # a terminal's Ctrl-C is for the parent, which waits for the trials that are under way
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent()
    pipe.send(task.prepare())
    while True:
        try:
            index = pipe.recv()
        except (EOFError, OSError):
            return
        pipe.send(task(index))


def die_with_parent() -> None:
    """The system ends this process with its parent, whatever it is doing; a thread where none can."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent.pid:  # it died before that was said
            os._exit(1)
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """A process started within never hears of Ctrl-C, not even in the second of its imports.

    This one hears of it at the end: a mask is inherited, and it loses no signal.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # the first process started begins with this one, which lets interrupts through when it is done
    resource_tracker.ensure_running()
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)

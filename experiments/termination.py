"""SIGTERM taken as an interrupt: it leaves behind what Ctrl-C leaves."""

import signal
import threading

_heard: list[int] = []


def interrupt_when_terminated() -> None:
    """Has SIGTERM raise KeyboardInterrupt in this process; not in those that it starts.

    Left alone are a handler that somebody else set, and threads, which cannot set one.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if is_main and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _interrupt)


def is_terminated() -> bool:
    """Whether an interrupt was SIGTERM's."""
    return bool(_heard)


def _interrupt(number: int, _: object) -> None:
    _heard.append(number)
    raise KeyboardInterrupt

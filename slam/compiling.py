"""Whether kernels are being compiled, for those who would wait in silence."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from numba.core.event import Event, Listener, install_listener


@contextmanager
def told_of_compiling(tell: Callable[[], None]) -> Iterator[None]:
    """Something is told before the first kernel is compiled within, once; where all of them were
    compiled before and are loaded, never."""
    with install_listener("numba:compile", _Once(tell)):
        yield


class _Once(Listener):
    """Hears of each kernel that is compiled, not of those that are loaded."""

    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell, self._is_told = tell, False

    def on_start(self, event: Event) -> None:
        if not self._is_told:
            self._is_told = True
            self._tell()

    def on_end(self, event: Event) -> None:
        """Of no interest."""

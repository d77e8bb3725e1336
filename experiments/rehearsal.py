"""What a run's trials need is compiled, or loaded, before the first of them: none is timed with it."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace

import numpy as np

from experiments import kidnap, localization
from experiments.trials import TrialConfig
from slam.warm_up import warm_up

WITHOUT_KERNELS = ("odometry", "line", "paper")
"""Methods that run on NumPy and SciPy alone, and search no map."""
_LONG_S = 2.0


def rehearse(experiment: str, config: TrialConfig) -> None:
    """Goes once through what a trial of an experiment runs, with random numbers of its own.

    A kidnap compiles or loads all that any drive needs: it is lost, searches, looks, and is found.
    Half a minute once on a machine, later about a second in each process.
    """
    compiled = tuple(name for name in config.methods if name not in WITHOUT_KERNELS)
    is_searching = experiment == "kidnap" or (experiment == "tracking" and bool(compiled))
    if experiment == "mapping":
        if compiled:
            warm_up()
        # what is left to compile casts beams into the true map
        compiled, config = (), replace(config, map="true")
    own = replace(config, methods=compiled or ("odometry",), poses="random")
    # whatever is raised here the trials raise as well, and there it is their result
    with suppress(Exception):
        if is_searching:
            # from near by: in a large place the way of the hand would take most of a minute
            kidnap.run_trial(own, np.random.default_rng(0))
        else:
            localization.run_trial(own, np.random.default_rng(0))


@contextmanager
def told_if_long(tell: Callable[[], None] | None) -> Iterator[None]:
    """Something is told if what is done within takes longer than two seconds."""
    timer = threading.Timer(_LONG_S, tell or _nothing)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _nothing() -> None:
    """Nobody asked to be told."""

"""A crew on a Ray cluster: on an existing one, or on one that is started on this machine."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from experiments.engines import CrewEngine, Done, Finished, Gone, Ready, Task, Tell, Work

_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""As in the processes of this machine: sums keep their order."""
_ANSWER_S = 10.0
"""Chosen: a cluster that takes longer to take a connection is none to run trials on."""


class RayEngine:
    """A Ray cluster. jobs: trials at once, None: one per core of the cluster."""

    def __init__(self, ray: Any, jobs: int | None, limit_s: float | None, address: str | None):
        self._ray, self._jobs, self._limit_s, self._address = ray, jobs, limit_s, address

    @contextmanager
    def at_work(self, task: Task, identity: str, tell: Tell) -> Iterator[Work]:
        """As of any engine. Raises ValueError where no cluster answers at the address."""
        with self._cluster():
            jobs = self._jobs or max(1, int(self._ray.cluster_resources().get("CPU", 1)))
            crew = CrewEngine(lambda task: RayCrew(self._ray, task), jobs, self._limit_s)
            with crew.at_work(task, identity, tell) as work:
                yield work

    @contextmanager
    def _cluster(self) -> Iterator[None]:
        """Connected to the cluster; one that somebody else has connected to is left as it is."""
        if self._ray.is_initialized():
            yield
            return
        own = {} if self._address else {"num_cpus": self._jobs, "include_dashboard": False}
        try:
            _check_answers(self._address)
            self._ray.init(
                address=self._address or "local", log_to_driver=False, logging_level="error", **own
            )
        except (OSError, RuntimeError, ValueError, self._ray.exceptions.RayError) as error:
            where = self._address or "this machine"
            raise ValueError(f"no Ray cluster answers at {where}: {_first_line(error)}") from error
        try:
            yield
        finally:
            self._ray.shutdown()


class RayHand:
    """One actor of the cluster, with a core of its own."""

    def __init__(self, ray: Any, task: Task) -> None:
        self._ray = ray
        remote = ray.remote(Worker).options(
            num_cpus=1, max_restarts=0, runtime_env={"env_vars": _ONE_THREAD}
        )
        self._actor = remote.remote(task)
        self.awaited: Any = self._actor.prepare.remote()
        """What is to come from it; None where nothing is."""

    def start(self, index: int) -> None:
        """Has it do a trial."""
        self.awaited = self._actor.trial.remote(index)

    def kill(self) -> None:
        """Ends it at once."""
        self.awaited = None
        self._ray.kill(self._actor)


class RayCrew:
    """Actors of a Ray cluster that do one task's trials."""

    def __init__(self, ray: Any, task: Task) -> None:
        self._ray, self._task = ray, task
        self._hands: list[RayHand] = []

    def hire(self) -> RayHand:
        """One more actor; it waits until a core of the cluster is free."""
        hand = RayHand(self._ray, self._task)
        self._hands.append(hand)
        return hand

    def events(self, timeout_s: float | None) -> list[Ready | Done | Gone]:
        """What the actors said, or that they died."""
        awaited = {hand.awaited: hand for hand in self._hands if hand.awaited is not None}
        heard, _ = self._ray.wait(list(awaited), num_returns=1, timeout=timeout_s)
        return [self._heard(awaited[one]) for one in heard]

    def dismiss(self) -> None:
        """Ends them all."""
        for hand in self._hands:
            hand.kill()
        self._hands.clear()

    def _heard(self, hand: RayHand) -> Ready | Done | Gone:
        errors = self._ray.exceptions
        try:
            said, hand.awaited = self._ray.get(hand.awaited), None
        except errors.RayActorError as error:
            self._hands.remove(hand)
            if getattr(error, "actor_init_failed", False):
                raise _lacking(error) from None
            return Gone(hand, "lost by Ray: its process or its node")
        except errors.RayError as error:
            raise _lacking(error) from None
        return Ready(hand, said) if isinstance(said, str) else Done(hand, said)


class Worker:
    """What each actor does."""

    def __init__(self, task: Task) -> None:
        os.environ.update(_ONE_THREAD)
        self._task = task

    def prepare(self) -> str:
        """As of the task."""
        return self._task.prepare()

    def trial(self, index: int) -> Finished:
        """As of the task."""
        return self._task(index)


def ray_engine(jobs: int | None, limit_s: float | None, address: str | None) -> RayEngine:
    """Raises ImportError, naming the extra, where Ray is not installed."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
    except ImportError:
        raise ImportError("--engine ray needs Ray: pip install 'kitasap[ray]'") from None
    return RayEngine(ray, jobs, limit_s, address)


def _check_answers(address: str | None) -> None:
    """Raises OSError where nobody listens at HOST:PORT: Ray itself would try for minutes."""
    host, colon, port = (address or "").removeprefix("ray://").rpartition(":")
    if colon and port.isdigit():
        socket.create_connection((host, int(port)), _ANSWER_S).close()


def _lacking(error: Exception) -> RuntimeError:
    return RuntimeError(
        "a process of the Ray cluster cannot do the trials; kitasap has to be installed there, of"
        f" this version, and a place's file has to lie there as well: {_last_line(error)}"
    )


def _first_line(error: Exception) -> str:
    return next(iter(str(error).strip().splitlines()), type(error).__name__)


def _last_line(error: Exception) -> str:
    return next(iter(str(error).strip().splitlines()[::-1]), type(error).__name__)

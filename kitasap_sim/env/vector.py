"""Many episodes at once on threads: MuJoCo leaves Python's lock alone while it steps."""

import math
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import chain
from typing import Any, ClassVar

import numpy as np
from gymnasium.error import ClosedEnvironmentError
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import iterate

from kitasap_sim.env.base import KitasapEnv
from kitasap_sim.env.explore import ExploreEnv
from kitasap_sim.env.goto import GoToEnv
from kitasap_sim.env.keywords import KeepsSpec
from kitasap_sim.env.motors import checked_action
from kitasap_sim.env.relocalize import RelocalizeEnv
from kitasap_sim.env.track import TrackEnv

_SWITCH_S = 5e-5
"""Chosen: a tenth of a step's physics; Python's own 5 ms are those of ten steps."""

_Step = tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]
_Last = tuple[dict[str, np.ndarray], dict[str, Any]]
"""Observation and info with which an episode ended that began anew in the same step."""


class KitasapVectorEnv(KeepsSpec, SyncVectorEnv):
    """What `SyncVectorEnv` of the same task gives, to the bit, on all cores of the machine.

    `gymnasium.make_vec("Kitasap2/GoTo-v0", num_envs=64)` makes it. threads: as many as cores by
    default. An episode that ended begins anew as autoreset_mode says, one of Gymnasium's or its
    name: with the next step ("NextStep", as Gymnasium's own do by default), with the same one,
    which then has its last observation and info as `final_obs` and `final_info` ("SameStep"), or by
    `reset(options={"reset_mask": ...})` alone ("Disabled"). It is a keyword like any other, here,
    and one in `vector_kwargs` with `sync` and `async`.
    Lists of pictures, `rgb_array_list`, are made by Gymnasium's wrapper: with `sync` and `async`.
    """

    ENV: ClassVar[type[KitasapEnv]]
    _pool: ThreadPoolExecutor | None = None

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        threads: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        **keywords: Any,
    ) -> None:
        """keywords: of the task. Raises ValueError for values that make no sense."""
        if num_envs < 1 or (threads is not None and threads < 1):
            raise ValueError(f"num_envs, threads: 1 or more, not {num_envs}, {threads}")
        if max_episode_steps is not None and max_episode_steps < 1:
            raise ValueError(f"max_episode_steps: 1 or more, not {max_episode_steps}")
        modes = [mode.value for mode in AutoresetMode]
        if getattr(autoreset_mode, "value", autoreset_mode) not in modes:
            raise ValueError(f"autoreset_mode: {', '.join(modes)}, not {autoreset_mode!r}")
        self._tasks: list[KitasapEnv] = []

        def made() -> KitasapEnv:
            self._tasks.append(self.ENV(**keywords))
            return self._tasks[-1]

        super().__init__([made] * num_envs, autoreset_mode=autoreset_mode)
        self._most = math.inf if max_episode_steps is None else max_episode_steps
        self._elapsed = np.zeros(num_envs, dtype=np.int64)
        self._threads = min(threads or os.cpu_count() or 1, num_envs)
        self._pool = ThreadPoolExecutor(self._threads, thread_name_prefix="kitasap")

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """All anew; of `options`, `reset_mask` (num_envs,) leaves some as they are."""
        mask = None if options is None else options.get("reset_mask")
        observations, infos = super().reset(seed=seed, options=options)
        self._elapsed[slice(None) if mask is None else mask] = 0
        return observations, infos

    def step(
        self, actions: Any
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One step of all.

        Raises ValueError for actions that are none, RuntimeError where one is over that only
        `reset` begins anew, and ClosedEnvironmentError after close(); nothing moves then.
        """
        if self.closed:
            raise ClosedEnvironmentError("step() after close(): make the vector env anew")
        expected = f"actions: one for each of {self.num_envs} episodes"
        try:
            each = list(iterate(self.action_space, actions))
        except TypeError:
            raise ValueError(f"{expected}, not {actions!r}") from None
        if len(each) != self.num_envs:
            raise ValueError(f"{expected}, not {len(each)}")
        given = [checked_action(action) for action in each]

        if self.autoreset_mode is AutoresetMode.DISABLED and self._autoreset_envs.any():
            over = np.flatnonzero(self._autoreset_envs).tolist()
            raise RuntimeError(f"episodes {over} are over: reset them first, by `reset_mask`")

        # each thread takes the next that nobody has taken; what takes longest comes first
        left = iter(np.argsort(~self._autoreset_envs, kind="stable").tolist())

        def work(_: int) -> list[tuple[int, tuple[_Step, _Last | None]]]:
            return [(i, self._stepped(i, given[i])) for i in left]

        assert self._pool is not None
        with _patient():
            worked = self._pool.map(work, range(self._threads))
            taken = dict(chain.from_iterable(worked))
        steps = [taken[i][0] for i in range(self.num_envs)]
        observations, rewards, terminations, truncations, infos = zip(*steps, strict=True)
        self._terminations, self._truncations = np.array(terminations), np.array(truncations)
        self._autoreset_envs = self._terminations | self._truncations
        self._env_obs = list(observations)
        stacked = {key: np.stack([one[key] for one in observations]) for key in observations[0]}
        told = _stacked(infos)
        for i, (_, last) in taken.items():
            if last is not None:
                told = self._add_info(
                    told, dict(zip(("final_obs", "final_info"), last, strict=True)), i
                )
        return (
            stacked,
            np.array(rewards, dtype=np.float64), self._terminations.copy(),
            self._truncations.copy(), told,
        )  # fmt: skip

    def close_extras(self, **keywords: Any) -> None:
        """Ends the threads and closes all episodes."""
        if self._pool is None:  # older Gymnasium closes what was refused as well
            return
        self._pool.shutdown()
        super().close_extras(**keywords)

    def _stepped(self, i: int, action: np.ndarray) -> tuple[_Step, _Last | None]:
        """What one episode's step gives; and how it ended, if the next one began with it."""
        task = self._tasks[i]
        if self._autoreset_envs[i] and self.autoreset_mode is AutoresetMode.NEXT_STEP:
            self._elapsed[i] = 0
            observation, info = task.reset()
            return (observation, 0.0, False, False, info), None
        self._elapsed[i] += 1
        observation, reward, is_over, is_late, info = task.step(action)
        is_late, last = is_late or bool(self._elapsed[i] >= self._most), None
        if (is_over or is_late) and self.autoreset_mode is AutoresetMode.SAME_STEP:
            self._elapsed[i], last = 0, (observation, info)
            observation, info = task.reset()
        return (observation, reward, is_over, is_late, info), last


class GoToVectorEnv(KitasapVectorEnv):
    """`GoToEnv` many times."""

    ENV = GoToEnv


class ExploreVectorEnv(KitasapVectorEnv):
    """`ExploreEnv` many times."""

    ENV = ExploreEnv


class RelocalizeVectorEnv(KitasapVectorEnv):
    """`RelocalizeEnv` many times."""

    ENV = RelocalizeEnv


class TrackVectorEnv(KitasapVectorEnv):
    """`TrackEnv` many times."""

    ENV = TrackEnv


@contextmanager
def _patient() -> Iterator[None]:
    """Lets a thread that returns from MuJoCo go on at once, though another begins an episode."""
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before_s)


def _stacked(infos: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """As `VectorEnv` stacks them, for infos that all have the same keys."""
    stacked: dict[str, Any] = {}
    for key, first in infos[0].items():
        values = [info[key] for info in infos]
        stacked[key] = _stacked(values) if isinstance(first, dict) else np.array(values)
        stacked["_" + key] = np.ones(len(infos), dtype=np.bool_)
    return stacked

"""Policies for the driving tasks: classical baselines, random actions, and what was trained.

A policy gets the observation alone: never `info`, never the simulation.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import numpy as np

TASKS = {
    "GoTo": ("goto", "GoToBaseline"),
    "Explore": ("explore", "ExploreBaseline"),
    "Relocalize": ("relocalize", "TurnToDisambiguate"),
    "Track": ("track", "TrackBaseline"),
}
"""The tasks, each with the module and the class of its baseline, made from the robot's laser."""
_TRAINED = ("trained", "GoToTrained")
POLICIES = ("baseline", "trained", "random")


class Policy(Protocol):
    """What drives: reset() before each episode, then an action (2,) for each observation."""

    def reset(self) -> None:
        """Forgets the last episode."""

    def __call__(self, observation: "dict[str, np.ndarray]") -> "np.ndarray":
        """(2,) action for an observation."""


def checked(task: str, name: str) -> None:
    """Raises ValueError, naming those there are, for an unknown task or policy."""
    if task not in TASKS:
        raise ValueError(f"no task called '{task}'; there are: {', '.join(TASKS)}")
    if name not in POLICIES:
        raise ValueError(f"no policy called '{name}'; there are: {', '.join(POLICIES)}")
    if name == "trained" and task != "GoTo":
        raise ValueError(f"nothing was trained for {task}: only for GoTo")


def policy(task: str, name: str, env: Any, seed: int = 0) -> Policy:
    """A policy by name for a task's environment, of which it is told the laser and the actions.

    seed: of random actions. Raises ValueError for an unknown one, or wheels for actions.
    """
    checked(task, name)
    if name == "random":
        from experiments.policies.random_actions import RandomActions

        return RandomActions(seed)
    if env.unwrapped.control != "twist":
        raise ValueError(
            f"policy {name} gives speed and turn rate: make the task with control=twist"
        )
    module, kind = _TRAINED if name == "trained" else TASKS[task]
    made_from = getattr(import_module(f"experiments.policies.{module}"), kind)
    made: Policy = made_from(env.unwrapped.laser)
    return made

"""Who watches a trial: told of every scan, the truth at it, and what the methods made of it."""

from collections.abc import Mapping, Sequence

import numpy as np

from experiments.trials import Outcome
from kitasap_sim.simulation import SensorFrame, Simulation
from slam.se2 import SE2


class TrialObserver:
    """One that takes no notice. What is observed must not change what happens."""

    def begins(self, simulation: Simulation, T_map_base: SE2) -> None:
        """The robot stands where it starts, and believes to stand at a pose."""

    def frame(self, frame: SensorFrame, true_pose: np.ndarray) -> None:
        """One more sweep; true_pose: (3,) at its end."""

    def estimates(self, outcomes: Mapping[str, Outcome]) -> None:
        """What methods, by name, made of the last sweep."""


NOBODY = TrialObserver()


class Observers(TrialObserver):
    """Several, each of them told all."""

    def __init__(self, observers: Sequence[TrialObserver]) -> None:
        self._observers = observers

    def begins(self, simulation: Simulation, T_map_base: SE2) -> None:
        """Tells them."""
        for observer in self._observers:
            observer.begins(simulation, T_map_base)

    def frame(self, frame: SensorFrame, true_pose: np.ndarray) -> None:
        """Tells them."""
        for observer in self._observers:
            observer.frame(frame, true_pose)

    def estimates(self, outcomes: Mapping[str, Outcome]) -> None:
        """Tells them."""
        for observer in self._observers:
            observer.estimates(outcomes)

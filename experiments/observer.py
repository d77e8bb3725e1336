"""Who watches a trial or a log: told of every scan, and what the methods made of it."""

from collections.abc import Mapping

import numpy as np

from experiments.trials import Outcome
from kitasap_sim.simulation import SensorFrame, Simulation
from slam.known_map import KnownMap
from slam.localization import Estimate
from slam.mapping import Mapper, MapperStep
from slam.measurements import Measurement
from slam.readers.log import Log
from slam.se2 import SE2


class TrialObserver:
    """One that takes no notice. What is observed must not change what happens."""

    def begins(self, simulation: Simulation, T_map_base: SE2) -> None:
        """The robot stands where it starts, and believes to stand at a pose."""

    def frame(self, frame: SensorFrame, true_pose: np.ndarray) -> None:
        """One more sweep; true_pose: (3,) at its end."""

    def estimates(self, outcomes: Mapping[str, Outcome]) -> None:
        """What methods, by name, made of the last sweep."""

    def placed(self, poses: Mapping[str, SE2]) -> None:
        """Where methods that map, by name, place the last sweep, as seen from the first."""


class Observers(TrialObserver):
    """Several at once."""

    def __init__(self, *observers: TrialObserver) -> None:
        self._observers = observers

    def begins(self, simulation: Simulation, T_map_base: SE2) -> None:
        """Tells each."""
        for one in self._observers:
            one.begins(simulation, T_map_base)

    def frame(self, frame: SensorFrame, true_pose: np.ndarray) -> None:
        """Tells each."""
        for one in self._observers:
            one.frame(frame, true_pose)

    def estimates(self, outcomes: Mapping[str, Outcome]) -> None:
        """Tells each."""
        for one in self._observers:
            one.estimates(outcomes)

    def placed(self, poses: Mapping[str, SE2]) -> None:
        """Tells each."""
        for one in self._observers:
            one.placed(poses)


NOBODY = TrialObserver()


class LogObserver:
    """One that takes no notice of a recorded log. What is observed must not change what happens."""

    def begins(self, log: Log, known: KnownMap | None = None) -> None:
        """A log is about to be read, from its first scan on; on a map, if one is known."""

    def mapped(self, measurement: Measurement, step: MapperStep, mapper: Mapper) -> None:
        """A scan, and where it was placed."""

    def localized(self, measurement: Measurement, estimate: Estimate) -> None:
        """A scan, and where the robot believes to be."""


NO_ONE = LogObserver()

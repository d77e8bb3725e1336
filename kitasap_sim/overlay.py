"""What a viewer and what drives the robot tell each other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mujoco.studio import messages

from kitasap_sim.rendering import Mark


@dataclass(frozen=True, eq=False)
class Overlay(messages.Snapshot):
    """What is drawn over the scene: marks on the floor, beams (N,) [m], words in the corner."""

    marks: Sequence[Mark] = ()
    beams_m: np.ndarray | None = None
    words: Sequence[str] = ()


@dataclass(frozen=True)
class Wanted(messages.Snapshot):
    """What the keys ask for: speeds, and how many kidnaps so far."""

    speed_mps: float = 0.0
    turn_radps: float = 0.0
    kidnaps: int = 0

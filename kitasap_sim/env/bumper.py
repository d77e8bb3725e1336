"""Whether the robot touches anything but the floor."""

import mujoco
import numpy as np

from kitasap_sim import names
from kitasap_sim.simulation import Simulation

_OTHER, _ROBOT, _FLOOR = 0, 1, 9
"""Kinds of geoms: two of them add up to _ROBOT only where the robot touches what it should not."""


class Bumper:
    """Of the robot in a simulation: it may touch the floor and its bumps."""

    def __init__(self, simulation: Simulation) -> None:
        model = simulation.model
        base = model.body(names.BASE).id
        is_robot = model.body_rootid[model.geom_bodyid] == base
        is_plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        is_unseen = (model.geom_rgba[:, 3] == 0.0) & (model.geom_matid < 0)
        self._kinds = np.where(is_robot, _ROBOT, np.where(is_plane | is_unseen, _FLOOR, _OTHER))
        self._data = simulation.data

    def is_touched(self) -> bool:
        """Whether the robot touches anything else now."""
        kinds = self._kinds[self._data.contact.geom]
        return bool((kinds[:, 0] + kinds[:, 1] == _ROBOT).any())

"""Moments of a simulation, kept to be drawn later: all that a picture shows, and no more."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from kitasap_sim import names

if TYPE_CHECKING:
    from kitasap_sim.simulation import Simulation

_STATE = (
    mujoco.mjtState.mjSTATE_TIME.value
    | mujoco.mjtState.mjSTATE_QPOS.value
    | mujoco.mjtState.mjSTATE_MOCAP_POS.value
    | mujoco.mjtState.mjSTATE_MOCAP_QUAT.value
)


@dataclass(frozen=True, eq=False)
class Moment:
    """Where everything is at one time. pose: (3,) of the robot; is_held: by the hand; beams_m: (N,)
    exact ranges of the beams last fired, +inf no hit, None without a laser."""

    time_s: float
    pose: np.ndarray
    is_held: bool
    beams_m: np.ndarray | None
    _state: np.ndarray = field(repr=False)

    @classmethod
    def of(cls, simulation: Simulation) -> Moment:
        """How things are now; it changes nothing of the simulation."""
        state = np.empty(mujoco.mj_stateSize(simulation.model, _STATE))
        mujoco.mj_getState(simulation.model, simulation.data, state, _STATE)
        beams_m = None if simulation.laser is None else simulation.fan_ranges_m()
        is_held = bool(simulation.data.eq_active[simulation.model.equality(names.GRIP).id])
        return cls(simulation.time_s, simulation.pose(), is_held, beams_m, state)

    def put(self, simulation: Simulation, data: mujoco.MjData) -> None:
        """Has everything stand in `data`, of this simulation's model, as it stood then."""
        mujoco.mj_setState(simulation.model, data, self._state, _STATE)
        mujoco.mj_kinematics(simulation.model, data)
        mujoco.mj_comPos(simulation.model, data)
        mujoco.mj_camlight(simulation.model, data)

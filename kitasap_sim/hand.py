"""The kidnap: a hand grips the robot, lifts it, carries it, turns it, lowers it and lets go.

Paper, Section 4.1: "the robot is lifted and is moved compulsorily".
"""

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

import mujoco
import numpy as np

from kitasap_sim import names
from kitasap_sim.orientation import turned_to
from kitasap_sim.simulation import SensorFrame, Simulation

Wheels = Literal["held", "coast"]

LIFT_M = 0.10
"""The paper does not say how high; chosen: clear of the floor, and out from under a table."""


@dataclass(frozen=True)
class Operator:
    """How well and how fast a person does it (chosen: a careful person with marks on the floor).

    position_sigma_m, heading_sigma_rad: standard deviation of the place where the robot is set
    down, on each axis. The times are those of each part of the movement.
    """

    position_sigma_m: float = 0.01
    heading_sigma_rad: float = 0.02
    grip_s: float = 0.3
    lift_s: float = 1.0
    carry_speed_mps: float = 0.4
    min_carry_s: float = 3.0
    lower_s: float = 1.2
    settle_s: float = 0.4

    def aimed(self, pose: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(3,) the pose where this operator's hand really goes when asked for a pose (3,)."""
        sigma = (self.position_sigma_m, self.position_sigma_m, self.heading_sigma_rad)
        return np.asarray(pose, dtype=float) + rng.normal(0.0, sigma)


@dataclass(frozen=True)
class Kidnap:
    """What the hand did.

    commanded, placed: (3,) the pose the hand went to, and the robot's true pose after it let go.
    ticks_before, ticks_after: (2,) of the encoders. way_m: (W, 2) corners of the way it was carried.
    frames: of the sweeps that were completed meanwhile, seen from the air for the most part.
    """

    commanded: np.ndarray
    placed: np.ndarray
    ticks_before: np.ndarray
    ticks_after: np.ndarray
    way_m: np.ndarray
    frames: list[SensorFrame] = field(repr=False)


def kidnap(
    simulation: Simulation,
    pose: np.ndarray,
    wheels: Wheels = "held",
    operator: Operator | None = None,
) -> Kidnap:
    """Carries the robot to x, y [m], heading [rad], exactly; `Operator.aimed` makes it human.

    wheels: held by the powered motors, or free to coast with the motors off.
    The robot is lifted 10 cm and carried around the furniture and through doors, not over them.
    Raises ValueError if it cannot stand at the pose, or does not stand free now.
    """
    if wheels not in get_args(Wheels):
        raise ValueError(f"wheels are {' or '.join(get_args(Wheels))}, not '{wheels}'")
    operator = operator or Operator()
    pose = np.asarray(pose, dtype=float)
    start = simulation.truth().pose
    way_m = simulation.world.way(start[:2], pose[:2])
    ticks_before = simulation.wheel_ticks()
    simulation.drive(0.0, 0.0)
    with _motors(simulation, is_on=wheels == "held"):
        hand = _Hand(simulation)
        frames = simulation.run(operator.grip_s)
        frames += hand.move([0, 0, LIFT_M], 0.0, operator.lift_s)
        frames += _carry(hand, way_m, math.remainder(pose[2] - start[2], math.tau), operator)
        frames += hand.move([0, 0, -LIFT_M], 0.0, operator.lower_s)
        hand.release()
    frames += simulation.run(operator.settle_s)
    return Kidnap(
        commanded=pose,
        placed=simulation.truth().pose,
        ticks_before=ticks_before,
        ticks_after=simulation.wheel_ticks(),
        way_m=way_m,
        frames=frames,
    )


def _carry(
    hand: "_Hand", way_m: np.ndarray, turn_rad: float, operator: Operator
) -> list[SensorFrame]:
    """Leg by leg along the way, the turn spread over all of it."""
    legs = np.diff(way_m, axis=0)
    lengths_m = np.linalg.norm(legs, axis=1)
    total_m = lengths_m.sum()
    shares = lengths_m / total_m if total_m > 0 else np.ones(1)
    duration_s = max(operator.min_carry_s, total_m / operator.carry_speed_mps)
    frames = []
    for leg, share in zip(legs, shares, strict=True):
        frames += hand.move([*leg, 0.0], share * turn_rad, max(share * duration_s, 0.5))
    return frames


class _Hand:
    """The mocap body that holds the robot by a weld, taken hold of where the robot is."""

    def __init__(self, simulation: Simulation) -> None:
        model, data = simulation.model, simulation.data
        self._simulation = simulation
        self._grip = model.equality(names.GRIP).id
        mocap = model.body(names.HAND).mocapid[0]
        self._pos, self._quat = data.mocap_pos[mocap], data.mocap_quat[mocap]
        base = data.joint(names.BASE).qpos
        self._pos[:], self._quat[:] = base[:3], base[3:]
        self._heading = simulation.truth().pose[2]
        data.eq_active[self._grip] = 1

    def move(self, offset_m: list[float], turn_rad: float, duration_s: float) -> list[SensorFrame]:
        """Moves by (3,) and turns about the vertical, with the least jerk (Flash, Hogan 1985)."""
        start_pos, start_quat, start_heading = self._pos.copy(), self._quat.copy(), self._heading
        steps = round(duration_s / self._simulation.timestep_s)
        frames = []
        for step in range(1, steps + 1):
            share = step / steps
            share = share**3 * (10 - 15 * share + 6 * share**2)
            self._pos[:] = start_pos + share * np.array(offset_m)
            self._quat[:] = turned_to(start_quat, start_heading + share * turn_rad)
            frame = self._simulation.step()
            if frame is not None:
                frames.append(frame)
        self._heading = start_heading + turn_rad
        return frames

    def release(self) -> None:
        """Lets go."""
        self._simulation.data.eq_active[self._grip] = 0


class _motors:
    """Motors without power within the block, if they are to be off."""

    def __init__(self, simulation: Simulation, *, is_on: bool) -> None:
        self._model: mujoco.MjModel = simulation.model
        self._motors = [self._model.actuator(name).id for name in names.WHEELS]
        self._is_on = is_on

    def __enter__(self) -> None:
        self._limits = self._model.actuator_forcerange[self._motors].copy()
        if not self._is_on:
            self._model.actuator_forcerange[self._motors] = 0.0

    def __exit__(self, *_: object) -> None:
        self._model.actuator_forcerange[self._motors] = self._limits

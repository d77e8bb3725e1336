"""The motors of the driving tasks: what an action asks for, and how the robot follows it."""

import math
from collections import deque
from typing import Any

import numpy as np

from kitasap_sim.robot import KITASAP2
from kitasap_sim.simulation import Simulation

CONTROL_S = 0.05
"""Of one step: 25 physics steps of 2 ms."""
CONTROLS = ("twist", "wheels")
"""What the two numbers of an action mean: speed and turn rate, or the speeds of both wheels."""
MAX_SPEED_MPS, MAX_TURN_RATE_RADPS = 0.5, 1.5
"""What an action of 1 asks for."""
ACCELERATION_MPS2, TURN_ACCELERATION_RADPS2 = 1.0, 4.0
"""How fast the motor controller follows: no tire slips by it."""
_HALF_TRACK_M = KITASAP2.track_m / 2.0
MAX_WHEEL_RADPS = (MAX_SPEED_MPS + MAX_TURN_RATE_RADPS * _HALF_TRACK_M) / KITASAP2.wheel_radius_m


class Motors:
    """Drive the robot of one episode, which is at rest, by one action after the other.

    control: one of CONTROLS. latency_s: after which a command reaches the wheels.
    """

    def __init__(self, simulation: Simulation, control: str, latency_s: float) -> None:
        self._simulation, self._control = simulation, control
        self._timestep_s = simulation.timestep_s
        self._count = round(CONTROL_S / self._timestep_s)
        self._lag_steps = round(latency_s / self._timestep_s)
        self._command = (0.0, 0.0)
        self._waiting: deque[tuple[int, np.ndarray]] = deque()
        self._steps = 0

    @property
    def time_s(self) -> float:
        """For so long they have driven."""
        return self._steps * self._timestep_s

    def drive(self, action: np.ndarray) -> None:
        """One control period under an action (2,) within its bounds."""
        sim = self._simulation
        v, w = self._command = self._followed(*self._asked(action))
        count = self._count
        if self._lag_steps == 0:
            sim.drive(v, w)
            sim.advance(count)
            self._steps += count
            return
        self._waiting.append((self._steps + self._lag_steps, KITASAP2.wheel_speeds_radps(v, w)))
        end = self._steps + count
        while self._steps < end:
            while self._waiting and self._waiting[0][0] <= self._steps:
                sim.drive_wheels(self._waiting.popleft()[1])
            until = min(end, self._waiting[0][0]) if self._waiting else end
            sim.advance(until - self._steps)
            self._steps = until

    def _asked(self, action: np.ndarray) -> tuple[float, float]:
        """Forward speed [m/s] and turn rate [rad/s] that an action asks for."""
        first, second = action.tolist()
        if self._control == "twist":
            return first * MAX_SPEED_MPS, second * MAX_TURN_RATE_RADPS
        left, right = first * MAX_WHEEL_RADPS, second * MAX_WHEEL_RADPS
        radius_m = KITASAP2.wheel_radius_m
        return (left + right) * radius_m / 2.0, (right - left) * radius_m / KITASAP2.track_m

    def _followed(self, v: float, w: float) -> tuple[float, float]:
        """The next command on the way to a speed and a turn rate."""
        return (
            _towards(self._command[0], v, ACCELERATION_MPS2 * CONTROL_S),
            _towards(self._command[1], w, TURN_ACCELERATION_RADPS2 * CONTROL_S),
        )


def checked_action(action: Any) -> np.ndarray:
    """(2,) float32 the action clipped to its bounds. Raises ValueError for what is none."""
    try:
        values = np.asarray(action)
    except ValueError:
        values = np.zeros(0)
    # no text, nothing complex, no object
    if values.shape == (2,) and values.dtype.kind in "biuf":
        first, second = values.tolist()
        if math.isfinite(first) and math.isfinite(second):
            # clipped before it is narrowed: beyond what 32 bits hold there are numbers too
            clipped = min(max(first, -1.0), 1.0), min(max(second, -1.0), 1.0)
            return np.array(clipped, dtype=np.float32)
    raise ValueError(f"an action is two finite numbers from -1 to 1, not {action!r}")


def _towards(now: float, wanted: float, most: float) -> float:
    return now + max(-most, min(most, wanted - now))

"""Scripted tracks: the robot drives a polyline by its own odometry, as the paper's robot did."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from kitasap_sim.encoders import DeadReckoning
from kitasap_sim.simulation import SensorFrame, Simulation

_AT_CORNER_M = 0.005
"""A corner nearer than this is where the robot already is."""


@dataclass(frozen=True)
class Driver:
    """How a track is driven.

    speed_mps: the paper's "about 20 cm/sec" (Section 4.2). The rest is chosen: a turn rate and
    accelerations at which no tire slips, and a control period of a small controller.
    """

    speed_mps: float = 0.2
    turn_rate_radps: float = 0.5
    acceleration_mps2: float = 0.4
    turn_acceleration_radps2: float = 1.0
    control_period_s: float = 0.02
    heading_gain_radps: float = 3.0
    stop_s: float = 0.3


def square(side_m: float, *, is_clockwise: bool) -> np.ndarray:
    """(5, 2) corners of a square that starts along x from the origin and ends there [m]."""
    sign = -1.0 if is_clockwise else 1.0
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=float)
    return side_m * corners * [1.0, sign]


class Pilot:
    """Steers the robot by its own encoders alone: the true track drifts off as its odometry does.

    It knows where the robot stands when it takes over. by_sight: somebody who sees the robot steers
    it instead, and keeps it on the track.
    """

    def __init__(
        self, simulation: Simulation, driver: Driver | None = None, *, by_sight: bool = False
    ) -> None:
        self._simulation, self._driver = simulation, driver or Driver()
        self._by_sight = by_sight
        pose = simulation.truth().pose
        self._reckoning = DeadReckoning(pose, simulation.wheel_ticks())
        self._seen_heading_rad = float(pose[2])

    def follow(self, corners_m: np.ndarray) -> Iterator[SensorFrame]:
        """Drives through corners (T, 2) in the world [m], turning on the spot at each.

        Yields the frames; the robot stands at the last corner when they end.
        """
        for corner in corners_m:
            dx, dy = corner - self.pose[:2]
            if math.hypot(dx, dy) > _AT_CORNER_M:
                yield from self._turn_by(
                    math.remainder(math.atan2(dy, dx) - self.pose[2], math.tau)
                )
                yield from self._drive_to(corner)

    def turn(self, angle_rad: float) -> Iterator[SensorFrame]:
        """Turns on the spot by an angle, more than a full turn too; yields the frames."""
        yield from self._turn_by(angle_rad)

    @property
    def pose(self) -> np.ndarray:
        """(3,) where whoever steers believes the robot to be, x, y [m], heading [rad], not wrapped."""
        if self._by_sight:
            x, y, heading = self._simulation.truth().pose
            self._seen_heading_rad += math.remainder(heading - self._seen_heading_rad, math.tau)
            return np.array([x, y, self._seen_heading_rad])
        return self._reckoning.update(self._simulation.wheel_ticks())

    def _turn_by(self, angle_rad: float) -> Iterator[SensorFrame]:
        target, driver = self.pose[2] + angle_rad, self._driver
        rate = 0.0
        while abs(to_go := target - self.pose[2]) > 1e-4 or abs(rate) > 1e-3:
            rate = _ramped(
                rate, to_go, driver.turn_rate_radps, driver.turn_acceleration_radps2, driver
            )
            self._simulation.drive(0.0, rate)
            yield from self._simulation.frames(driver.control_period_s)
        yield from self._stop()

    def _drive_to(self, corner_m: np.ndarray) -> Iterator[SensorFrame]:
        """Drives straight to a corner (2,), holding the line to it from here."""
        start, driver, speed = self.pose[:2].copy(), self._driver, 0.0
        length_m = float(np.hypot(*(corner_m - start)))
        along = (corner_m - start) / max(length_m, 1e-9)
        heading = math.atan2(along[1], along[0])
        while True:
            offset = self.pose[:2] - start
            to_go_m = length_m - float(offset @ along)
            if to_go_m < 1e-4 and speed < 1e-2:
                break
            speed = _ramped(speed, to_go_m, driver.speed_mps, driver.acceleration_mps2, driver)
            aside_m = float(along[0] * offset[1] - along[1] * offset[0])
            error = math.remainder(heading - self.pose[2], math.tau) - 2.0 * aside_m
            self._simulation.drive(speed, driver.heading_gain_radps * error)
            yield from self._simulation.frames(driver.control_period_s)
        yield from self._stop()

    def _stop(self) -> Iterator[SensorFrame]:
        self._simulation.drive(0.0, 0.0)
        yield from self._simulation.frames(self._driver.stop_s)


def _ramped(now: float, to_go: float, limit: float, acceleration: float, driver: Driver) -> float:
    """The next speed on a trapezoid that ends at rest where nothing is left to go."""
    step = acceleration * driver.control_period_s
    # 0.8: brakes a little early, so that the last millimetres are not driven backwards
    braking = math.copysign(math.sqrt(2 * 0.8 * acceleration * abs(to_go)), to_go)
    wanted = max(-limit, min(limit, braking, abs(to_go) / driver.control_period_s), -abs(braking))
    return max(now - step, min(now + step, wanted))

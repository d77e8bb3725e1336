"""A simulated drive as recorded logs come: a CARMEN log, and the true map as a grid."""

import math
from dataclasses import dataclass

import numpy as np

from experiments.sources import MeasurementSource
from kitasap_sim.drive import Pilot
from kitasap_sim.simulation import SensorFrame, Simulation
from slam.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from slam.se2 import SE2


@dataclass
class Recorder:
    """Writes what the robot's sensors say as a CARMEN log; truth: pose at each scan."""

    simulation: Simulation
    interval_s: float = 1.0

    def __post_init__(self) -> None:
        assert self.simulation.laser is not None
        self._spec = self.simulation.laser
        self._source = MeasurementSource(self._spec, self.simulation.wheel_ticks())
        self._T_odom_base = SE2.identity()
        self.lines: list[str] = []
        self.truth: list[np.ndarray] = []
        self._last_s = -math.inf

    def take(self, frame: SensorFrame) -> None:
        """The wheels of every frame; a scan now and then."""
        self._T_odom_base = self._T_odom_base @ self._source.measurement(frame).motion
        if frame.time_s - self._last_s < self.interval_s:
            return
        self._last_s = frame.time_s
        T_odom_laser = self._T_odom_base @ SE2(*self._spec.mount_m[:2], 0.0)
        ranges_m = np.where(np.isfinite(frame.ranges_m), frame.ranges_m, 81.91)
        ranges = " ".join(f"{range_m:.3f}" for range_m in ranges_m)
        numbers = [*T_odom_laser.as_array(), *self._T_odom_base.as_array()]
        poses = " ".join(f"{number:.6f}" for number in numbers)
        stamp = f"{frame.time_s:.6f}"
        self.lines.append(f"FLASER {len(ranges_m)} {ranges} {poses} {stamp} sim {stamp}")
        self.truth.append(self.simulation.truth().pose)

    def drive(self, to_m: tuple[float, float]) -> None:
        """Looks around, drives to a point."""
        pilot = Pilot(self.simulation)
        for frame in pilot.turn(2.5):
            self.take(frame)
        for frame in pilot.follow(np.array([to_m])):
            self.take(frame)


def rasterised(simulation: Simulation, resolution_m: float = 0.05) -> OccupancyGrid:
    """The true surfaces at the laser's height as a grid of cells."""
    assert simulation.laser is not None
    points = simulation.place.map_at(simulation.laser.mount_m[2]).points_m(resolution_m / 5)
    lower = points.min(axis=0) - resolution_m
    columns, rows = np.floor((points - lower) / resolution_m).astype(int).T
    cells = np.full((rows.max() + 2, columns.max() + 2), FREE)
    cells[rows, columns] = OCCUPIED
    return OccupancyGrid(cells, resolution_m, SE2(lower[0], lower[1], 0.0))

"""One trial as a ROS bag: what the sensors said, the truth, and what one method made of it."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.bag_writer import BASE, FOOTPRINT, LASER, MAP, ODOM, BagWriter
from experiments.mapping import MappingResult
from experiments.methods import KnownPlace
from experiments.observer import TrialObserver
from experiments.sources import DRIVE, ODOMETRY_NOISE
from experiments.trials import Outcome, TrialConfig, TrialResult
from kitasap_sim import names
from kitasap_sim.free_space import Grid, flooded
from kitasap_sim.robot import KITASAP2
from kitasap_sim.simulation import SensorFrame, Simulation
from slam.measurements import LaserScan
from slam.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from slam.odometry import compose_covariance
from slam.ray_counts import TooManyCellsError
from slam.se2 import SE2
from slam.verdict import Status

_CELL_M = 0.025
_MOST_CELLS_ALONG = 3000
"""Chosen: Willow Garage has 2500; a hall of 200 m, 64 million cells otherwise, gets coarser ones."""
_MARGIN_M = 0.2
_WHEELS = [name.removeprefix(names.PREFIX) for name in names.WHEELS]


@dataclass
class _Seen:
    """A sweep with the truth at its end, and what the method made of it, None if nothing."""

    frame: SensorFrame
    true_pose: np.ndarray
    outcome: Outcome | None = None


class TrialRecorder(TrialObserver):
    """Keeps what a trial shows; `write` makes a bag of it. method: the one whose estimates it has."""

    def __init__(self, method: str) -> None:
        self._method = method
        self._seen: list[_Seen] = []

    def begins(self, simulation: Simulation, T_map_base: SE2) -> None:
        """Notes the laser, the encoders, and where the robot believes to be."""
        assert simulation.laser is not None
        self._laser, self._ticks = simulation.laser, simulation.wheel_ticks()
        self._start_s, self._T_map_start = simulation.time_s, T_map_base

    def frame(self, frame: SensorFrame, true_pose: np.ndarray) -> None:
        """Keeps one more sweep."""
        self._seen.append(_Seen(frame, true_pose))

    def estimates(self, outcomes: Mapping[str, Outcome]) -> None:
        """Keeps what the method made of it."""
        self._seen[-1].outcome = outcomes.get(self._method)

    def write(self, path: Path, config: TrialConfig, result: TrialResult | MappingResult) -> None:
        """Writes the bag. Of a place mapped, the poses are those of the finished map, in its frame."""
        T_world_map, made = SE2.identity(), None
        if isinstance(result, MappingResult):
            made = result.outcomes[self._method].made
            first = SE2.from_array(made.trajectory.poses[0])
            T_world_map = SE2.from_array(result.true_poses[0]) @ first.inverse()
            grid = _grid_of_points(made.points)
            if made.slam_map is not None:
                # where there are too many cells, walls alone are a map as well
                with suppress(TooManyCellsError):
                    grid = made.slam_map.grid()
        else:
            grid = grid_of_place(config.known_place)
        poses = None if made is None else made.trajectory.poses
        with BagWriter(path) as bag:
            self._write_start(bag)
            if made is None:
                bag.map(self._start_s, grid)
            self._write_drive(bag, T_world_map.inverse(), poses)
            if made is not None:
                bag.map(self._seen[-1].frame.time_s, grid)

    def _write_start(self, bag: BagWriter) -> None:
        bag.clock(self._start_s)
        x, y, z = self._laser.mount_m
        axle_m = KITASAP2.axle_height_m
        mounted = [
            (FOOTPRINT, BASE, SE2.identity(), axle_m),
            (BASE, LASER, SE2(x, y, 0.0), z - axle_m),
        ]
        bag.transforms("/tf_static", self._start_s, mounted)
        bag.transforms("/tf", self._start_s, [(MAP, ODOM, self._T_map_start, 0.0)])
        bag.odometry(self._start_s, SE2.identity(), np.zeros((3, 3)), np.zeros(3))

    def _write_drive(self, bag: BagWriter, T_map_world: SE2, poses: np.ndarray | None) -> None:
        """Sweep after sweep. poses: (N, 3) of all sweeps, if these were found after the drive."""
        limits_m = self._laser.range_min_m, min(self._laser.range_max_m, 1e3)
        T_odom_base, covariance = SE2.identity(), np.zeros((3, 3))
        last_s, ticks = self._start_s, self._ticks
        for number, seen in enumerate(self._seen):
            frame, time_s = seen.frame, seen.frame.time_s
            delta, passed_s = frame.wheel_ticks - ticks, time_s - last_s
            motion = DRIVE.motion(delta)
            noise = ODOMETRY_NOISE.covariance(DRIVE, delta)
            covariance = compose_covariance(covariance, motion, noise)
            T_odom_base, last_s, ticks = T_odom_base @ motion, time_s, frame.wheel_ticks
            to_rad = 2.0 * np.pi / DRIVE.ticks_per_turn
            bag.clock(time_s)
            bag.odometry(time_s, T_odom_base, covariance, motion.log() / passed_s)
            bag.wheels(time_s, _WHEELS, ticks * to_rad, delta * to_rad / passed_s)
            angles_rad = self._laser.angles_rad
            scan = LaserScan(time_s, angles_rad, frame.ranges_m, frame.beam_times_s)
            bag.scan(time_s, scan, limits_m, self._laser.period_s)
            bag.ground_truth(time_s, T_map_world @ SE2.from_array(seen.true_pose))
            found = SE2.from_array(poses[number]) if poses is not None else _believed(seen.outcome)
            if found is not None:
                claimed = None if seen.outcome is None else seen.outcome.covariance
                bag.pose_estimate(time_s, found, claimed)
                bag.transforms("/tf", time_s, [(MAP, ODOM, found @ T_odom_base.inverse(), 0.0)])


def _believed(outcome: Outcome | None) -> SE2 | None:
    """The pose that a method stands for; one that is lost has none."""
    if outcome is None or outcome.verdict.status is Status.LOST:
        return None
    return outcome.T_map_base


def grid_of_place(known: KnownPlace) -> OccupancyGrid:
    """The robot's map of a place as cells: walls, and what is free of them from the start on.

    Of a map that the robot made itself, which may be open, only walls are known.
    """
    segments_m = known.segment_map.segments
    cells = _grid_over(segments_m.reshape(-1, 2))
    walls = cells.walls(segments_m)
    values = np.full(cells.shape, UNKNOWN, dtype=np.int8)
    if not known.is_made:
        values[flooded(~walls, cells.cells(known.place.start[None, :2]))] = FREE
    values[walls] = OCCUPIED
    return OccupancyGrid(values.T, cells.cell_m, _at(cells.origin_m))


def _grid_of_points(points_m: np.ndarray) -> OccupancyGrid:
    """Cells with a point (K, 2) in them; of the others nothing is known."""
    cells = _grid_over(points_m)
    values = np.full(cells.shape, UNKNOWN, dtype=np.int8)
    values[tuple(cells.cells(points_m).T)] = OCCUPIED
    return OccupancyGrid(values.T, cells.cell_m, _at(cells.origin_m))


def _at(point_m: np.ndarray) -> SE2:
    return SE2(point_m[0], point_m[1], 0.0)


def _grid_over(points_m: np.ndarray) -> Grid:
    """Cells over points (K, 2) and what is around them, of which a large place gets larger ones."""
    bounds_m = np.zeros((2, 2))
    if len(points_m):
        bounds_m = np.array([points_m.min(axis=0), points_m.max(axis=0)])
    cell_m = max(_CELL_M, float(np.ptp(bounds_m, axis=0).max()) / _MOST_CELLS_ALONG)
    return Grid.over(bounds_m, cell_m, _MARGIN_M)

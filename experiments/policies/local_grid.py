"""What a robot remembers of the floor around it: an occupancy grid in the frame of its start."""

import math

import numpy as np

from experiments.policies import kernels
from experiments.policies.placing import nudged
from kitasap_sim.env.base import scan_range_m, seen_from
from kitasap_sim.laser import LaserSpec

CELL_M = 0.05
_HALF_M = 16.0
"""The grid reaches so far from the start to all sides; farther is not remembered. Chosen."""
_MARGIN_M = 1.0
"""Of the window around all that was seen, that is planned in."""
_CLEAR_M = 0.7
"""Chosen: farther from an obstacle it makes no difference how far."""
_NUDGE = np.array([0.004, 0.002])
"""Of a trial while a scan is placed: metres, radians; chosen: four of them outrun any drift."""
_PAIR_M, _MATCHED_M = 0.25, 4.0
"""Chosen: a beam's end pairs with hits so near it; longer beams are too uncertain."""
_LEAST_BEAMS, _LEAST_SHARE, _TRUST = 15, 0.5, 0.3
"""Chosen: fewer beams, or fewer that meet what was met before, tell no pose; and so much of what
one scan says is believed, as its noise would else shake the map."""


class LocalGrid:
    """Occupancy about the start of an episode, from the observation alone.

    laser: the robot's own, whose directions, mount and limits it knows. pose: (3,) of the robot, by
    its odometry, the heading held to what the beams met before. Beams that pass through a thing
    clear it away.
    """

    def __init__(self, laser: LaserSpec) -> None:
        self._angles_rad = laser.angles_rad
        # a period ends with the observation: so old is each beam then
        self._ages_s = laser.period_s - laser.delays_s()
        self._mount_m = laser.mount_m[:2]
        self._farthest_m = scan_range_m(laser) - 1e-3
        self._nearest_m = max(laser.range_min_m, 1e-3)
        self.reset()

    def reset(self) -> None:
        """Nothing is known."""
        count = round(2.0 * _HALF_M / CELL_M)
        self.evidence = np.zeros((count, count), dtype=np.int8)
        self.hits_m = np.zeros((count, count, 2), dtype=np.float32)
        self.is_seen = np.zeros((count, count), dtype=np.bool_)
        self.origin_m = np.array([-_HALF_M, -_HALF_M])
        self.pose = np.zeros(3)
        self._odometry = np.zeros(3)
        self._lower_m, self._upper_m = np.zeros(2), np.zeros(2)

    def update(self, observation: dict[str, np.ndarray]) -> None:
        """Marks the scan, each beam from where the robot was when it was fired."""
        ranges_m = observation["scan"].astype(float)
        starts_m, ends_m = self._beams_m(ranges_m, observation["velocity"])
        is_far = ranges_m >= self._farthest_m
        # a lost beam reads as far too: one alone among others that met something is taken for lost
        is_next_far = np.append(is_far[1:], False) | np.insert(is_far[:-1], 0, False)
        kinds = np.where(is_far, np.where(is_next_far, 2, 0), 1)
        kinds[ranges_m < self._nearest_m] = 0
        self.pose = self._placed(observation["odometry"].astype(float), ends_m[kinds == 1])
        starts_m, ends_m = self.from_robot(starts_m), self.from_robot(ends_m)
        kernels.mark_beams(
            self.evidence, self.hits_m, self.is_seen, self.origin_m, CELL_M, starts_m, ends_m, kinds
        )
        ends_m = ends_m[kinds > 0]
        self._lower_m = np.minimum(self._lower_m, ends_m.min(axis=0, initial=0.0))
        self._upper_m = np.maximum(self._upper_m, ends_m.max(axis=0, initial=0.0))

    def _beams_m(self, ranges_m: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Starts and ends (N, 2) of the beams in the robot's frame of now: it moved since each."""
        v, w = velocity.astype(float).tolist()
        turned = -w * self._ages_s
        c, s = np.cos(turned), np.sin(turned)
        (ahead_m, aside_m), along = self._mount_m, turned + self._angles_rad
        back_m = -v * self._ages_s
        starts_m = np.stack(
            [
                back_m * np.cos(0.5 * turned) + c * ahead_m - s * aside_m,
                back_m * np.sin(0.5 * turned) + s * ahead_m + c * aside_m,
            ],
            axis=1,
        )
        ways_m = ranges_m[:, None] * np.stack([np.cos(along), np.sin(along)], axis=1)
        return starts_m, starts_m + ways_m

    def _placed(self, odometry: np.ndarray, ends_m: np.ndarray) -> np.ndarray:
        """(3,) pose: the odometry's motion since the last one, held to what beams met."""
        predicted = _composed(self.pose, np.array(seen_from(self._odometry, odometry)))
        self._odometry = odometry
        near_m = ends_m[np.hypot(*ends_m.T) < _MATCHED_M]
        if len(near_m) < _LEAST_BEAMS:
            return predicted
        matched, share = nudged(
            self.evidence, self.hits_m, self.origin_m, CELL_M, near_m, predicted, _NUDGE, _PAIR_M, 4
        )
        if share < _LEAST_SHARE:
            return predicted
        # the heading alone: sparse beams hold back along walls, and wheels know lengths to 1 %
        predicted[2] += _TRUST * (matched[2] - predicted[2])
        return predicted

    def window(self, *points_m: np.ndarray) -> tuple[int, int, int, int]:
        """The part of the grid that holds all that was seen, the robot, and some points (2,)."""
        held_m = [self._lower_m, self._upper_m, self.pose[:2], *points_m]
        lower = self.cell(np.min(held_m, axis=0) - _MARGIN_M)
        upper = self.cell(np.max(held_m, axis=0) + _MARGIN_M)
        return int(lower[0]), int(lower[1]), int(upper[0]) + 1, int(upper[1]) + 1

    def cell(self, point_m: np.ndarray) -> np.ndarray:
        """(2,) the cell of a point (2,); the nearest one beyond the grid."""
        cell = np.floor((np.asarray(point_m) - self.origin_m) / CELL_M).astype(np.int64)
        result: np.ndarray = cell.clip(0, self.evidence.shape[0] - 1)
        return result

    def middles_m(self, cells: np.ndarray) -> np.ndarray:
        """(K, 2) middles of cells (K, 2) [m]."""
        return self.origin_m + (cells + 0.5) * CELL_M

    def clearance_m(self, window: tuple[int, int, int, int]) -> np.ndarray:
        """From the middles of a window's cells to the nearest obstacle, 0.7 m at most [m]."""
        result: np.ndarray = kernels.clearances(
            self.evidence, self.hits_m, self.origin_m, CELL_M, window, _CLEAR_M
        )
        return result

    def obstacles_near(self, reach_m: float) -> np.ndarray:
        """(K, 2) obstacles in a square about the robot, in its frame [m]."""
        result: np.ndarray = kernels.hits_near(
            self.evidence, self.hits_m, self.origin_m, CELL_M, self.pose, reach_m
        )
        return result

    def in_robot(self, point_m: np.ndarray) -> np.ndarray:
        """(2,) a point of the grid's frame in the robot's [m]."""
        c, s = math.cos(self.pose[2]), math.sin(self.pose[2])
        dx, dy = (point_m - self.pose[:2]).tolist()
        return np.array([c * dx + s * dy, c * dy - s * dx])

    def from_robot(self, points_m: np.ndarray) -> np.ndarray:
        """(..., 2) points of the robot's frame in the grid's [m]."""
        c, s = math.cos(self.pose[2]), math.sin(self.pose[2])
        result: np.ndarray = self.pose[:2] + points_m @ np.array([[c, s], [-s, c]])
        return result


def _composed(frame: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """(3,) where a pose (x, y, heading) given in a frame (3,) is: undoes `seen_from`."""
    c, s = math.cos(frame[2]), math.sin(frame[2])
    x = frame[0] + c * pose[0] - s * pose[1]
    y = frame[1] + s * pose[0] + c * pose[1]
    return np.array([x, y, math.remainder(frame[2] + pose[2], math.tau)])

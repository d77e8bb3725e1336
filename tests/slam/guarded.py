"""A robot in a room, and a localizer with a guard that is told of its way."""

import math

import numpy as np

from slam import SE2, FastMatcher, LimitMatcher, Localizer, Measurement, SegmentMap, SurfelGrid
from slam.known_map import KnownMap
from slam.lost import Guard
from slam.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from slam.relocalization import Relocalizer
from tests.slam.all_methods import MODEL, SIGMA_M
from tests.slam.synthetic import sampled, scan_of

LASER = SE2(0.1, 0.0, 0.0)
START = SE2(2.6, 1.9, 0.4)
STILL = SE2.identity()


def made(segments):
    walls = SegmentMap(segments)
    surfels = SurfelGrid.of(walls)
    matcher = LimitMatcher(walls, MODEL, FastMatcher(surfels, MODEL))
    return segments, matcher, Relocalizer.of(walls, surfels, MODEL)


def mapped_in_cells(segments, inside, corner_m):
    """A grid of 5 cm cells: walls (S, 2, 2), free boxes (left, lower, right, upper), its corner [m]."""
    corner, cell_m = np.array(corner_m), 0.05

    def cells_of(points):
        return np.floor((np.asarray(points) - corner) / cell_m).astype(int)

    columns, rows = cells_of(sampled(segments, 0.01)).T
    cells = np.full((rows.max() + 8, columns.max() + 8), UNKNOWN, dtype=np.int8)
    for left, lower, right, upper in inside:
        (first, low), (last, high) = cells_of([(left, lower), (right, upper)])
        cells[low : high + 1, first : last + 1] = FREE
    cells[rows, columns] = OCCUPIED
    return KnownMap.of_grid(OccupancyGrid(cells, cell_m, SE2(*corner_m, 0.0)))


class Robot:
    """Where it truly is, and a localizer that is told so much of it."""

    def __init__(self, room, believed, at=START, seed=0):
        self.segments, matcher, relocalizer = room
        self.at, self.time_s, self.rng = at, 0.0, np.random.default_rng(seed)
        self.localizer = Localizer(matcher, believed, LASER, None, Guard(relocalizer))

    def look(self, motion=STILL, told=None, scan=None):
        """A step, what the wheels told of it, and the scan that follows."""
        self.at, self.time_s = self.at @ motion, self.time_s + 0.1
        if scan is None:
            scan = scan_of(self.segments, self.at @ LASER, self.rng, SIGMA_M)
        noise = np.diag([1e-6, 1e-6, 1e-6])
        return self.localizer.update(
            Measurement(self.time_s, motion if told is None else told, scan, noise)
        )

    def is_right(self, estimate):
        off = self.at.inverse() @ estimate.T_map_base
        return math.hypot(off.x, off.y) < 0.05 and abs(off.theta) < math.radians(2)

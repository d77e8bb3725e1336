"""Compiled code, made or loaded before a robot drives, so that no scan of its waits for it."""

from __future__ import annotations

import numpy as np

from slam.frontend.witnesses import Witnesses
from slam.loop_closing import LoopConfig
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper
from slam.measurements import LaserScan, Measurement
from slam.se2 import SE2

_STEP_M = 0.3
_HALF_M = np.array([3.0, 2.0])
"""Of a room of 6 m by 4 m."""


def warm_up(*, is_continued: bool = False) -> None:
    """Runs once all that a `Mapper` runs: it compiles then, or loads what was compiled.

    is_continued: and all that one runs that continues a map, and searches it for where it is.
    Once on a machine that takes half a minute, and once in each process a fifth of a second, which
    the first scan would wait for otherwise.
    """
    loops = LoopConfig(every=1, least_way_m=0.0, apart=0)
    config = MapperConfig(loops=loops, solve_every=1)
    mapper, measurements = Mapper(SE2.identity(), config), list[Measurement]()
    angles_rad = np.radians(np.arange(-90.0, 91.0))
    directions = np.column_stack([np.cos(angles_rad), np.sin(angles_rad)])
    for k in range(4):
        to_walls = (_HALF_M * np.sign(directions) - [_STEP_M * k, 0.0]) / np.where(
            np.abs(directions) > 1e-9, directions, 1e-9
        )
        scan = LaserScan(0.2 * k, angles_rad, to_walls.min(axis=1))
        measurements.append(Measurement(0.2 * k, SE2(_STEP_M if k else 0.0, 0.0, 0.0), scan))
    # at rest, which makes no keyframe: finishing asks what was seen between two; a millimetre off,
    # since a laser that repeats itself to the bit is not believed
    rest = LaserScan(0.7, angles_rad, scan.ranges_m + 0.001)
    measurements.append(Measurement(0.7, SE2.identity(), rest))
    # all around, for a scan that lies where nobody expects it
    measurements.append(Measurement(0.8, SE2(0.0, 0.0, 0.6), scan))
    rest.likeness(scan)  # as a log's records are asked
    for measurement in measurements:
        mapper.update(measurement)
    slam_map = mapper.finish()
    _ = slam_map.surfaces
    # as finishing asks of scans that others saw through
    denial = config.front_end.denial
    witnesses = Witnesses(slam_map.keyframes, slam_map.poses, denial.margins, denial.aside_m)
    witnesses.passed(0, 1)
    if is_continued:
        later = Mapper.continued(slam_map, SE2.identity(), None, config)
        for measurement in measurements:
            later.update(measurement)

"""The drive by which a place is mapped: its track, or a round through all of it, by sight."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from experiments.sources import MeasurementSource
from kitasap_sim.drive import Driver, Pilot
from kitasap_sim.laser import LaserSpec
from kitasap_sim.places import Place
from kitasap_sim.simulation import SensorFrame, Simulation
from slam.arrays import FloatArray
from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.se2 import SE2
from slam.surface.surfaces import Surfaces

if TYPE_CHECKING:
    # it knows trials, which know this module
    from experiments.observer import TrialObserver

_TOUR_M = 1.5
"""Chosen: a round through a place comes so near to every spot of its free space."""
_MADE_MAP_KEY = 17
"""Seed of the drive that a robot's own map is made on: the same for all trials of all runs."""


def track_or_round(place: Place, rng: np.random.Generator) -> FloatArray:
    """(C, 2) corners of the place's track [m], or of a round through it if it has none."""
    return place.track_m if len(place.track_m) > 1 else round_through(place, rng)


def round_through(place: Place, rng: np.random.Generator) -> FloatArray:
    """(C, 2) corners of a way from the start that comes near to all of the free space, and back [m].

    Twice over its first part: a map is closed by coming back.
    """
    left_m = rng.permutation(place.free_centres_m)
    here_m = place.start[:2]
    stops = [here_m]
    while len(left_m := left_m[np.hypot(*(left_m - here_m).T) >= _TOUR_M]):
        # the nearest of what is left, by the way there and not through the walls
        off_m = np.hypot(*(left_m - here_m).T)
        # not all of them sorted: an office building has a million
        is_near = off_m <= np.partition(off_m, min(4, len(off_m) - 1))[:5].max()
        near = left_m[is_near][np.argsort(off_m[is_near], kind="stable")[:5]]
        lengths = [np.hypot(*np.diff(place.way(here_m, spot), axis=0).T).sum() for spot in near]
        here_m = near[int(np.argmin(lengths))]
        stops.append(here_m)
    stops += stops[:2]
    ways = [place.way(one, other)[1:] for one, other in itertools.pairwise(stops)]
    return np.concatenate([[stops[0]], *ways])


def measured(
    laser: LaserSpec,
    simulation: Simulation,
    corners_m: FloatArray,
    observer: TrialObserver | None = None,
) -> Iterator[tuple[Measurement, FloatArray]]:
    """The measurements of a drive along corners (C, 2) [m], each with the true pose (3,).

    laser: as the robot knows it. It starts at rest at the first corner.
    """
    start = simulation.place.start
    simulation.reset(np.array([*corners_m[0], start[2]]))
    source = MeasurementSource(laser, simulation.wheel_ticks())
    if observer is not None:
        observer.begins(simulation, SE2.identity())
    for frame in _driven(simulation, corners_m):
        true = simulation.truth().pose
        if observer is not None:
            observer.frame(frame, true)
        yield source.measurement(frame), true


def made_surfaces(place: Place, laser: LaserSpec) -> Surfaces:
    """What a robot as built has made of the place by itself, in the place's frame.

    It is told where it starts, and no more. Raises ValueError if the mapper calls its map failed.
    """
    way_rng, simulation_rng = np.random.default_rng(_MADE_MAP_KEY).spawn(2)
    simulation = Simulation(place, laser, rng=simulation_rng)
    corners_m = track_or_round(place, way_rng)
    mapper = Mapper(SE2(laser.mount_m[0], laser.mount_m[1], 0.0))
    true_poses = []
    for measurement, true in measured(laser, simulation, corners_m):
        mapper.update(measurement)
        true_poses.append(true)
    slam_map = mapper.finish()
    if not slam_map.verdict.is_good:
        raise ValueError(
            f"place {place.name}: the map that the robot made of it failed:"
            f" {'; '.join(slam_map.verdict.reasons)}"
        )
    first = SE2.from_array(slam_map.trajectory.poses[0])
    return slam_map.surfaces.moved(SE2.from_array(true_poses[0]) @ first.inverse())


def _driven(simulation: Simulation, corners_m: FloatArray) -> Iterator[SensorFrame]:
    yield simulation.next_frame()
    yield from Pilot(simulation, Driver(), by_sight=True).follow(corners_m)

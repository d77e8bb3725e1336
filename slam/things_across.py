"""What stands across a way: one thing of it may be a cart, or people, that go along."""

from __future__ import annotations

import numpy as np

from slam.arrays import FloatArray
from slam.surface_map import SurfaceMap

_FACING, _THING_M = 0.7, 0.75
"""Cosine to the way of what faces it, and how far about its middle a thing reaches, as a cart or two people. Chosen."""


def without_one_thing(
    surfaces: SurfaceMap, points: FloatArray, way_rad: float
) -> FloatArray | None:
    """Of faced points (N, 3) those without the one thing that most of what faces a way, towards that angle, is of;
    None where nothing faces it. surfaces: they are thinned as for these."""
    facing = np.cos(points[:, 2] - way_rad)
    across = surfaces.thinned(points[np.abs(facing) > _FACING, :2])
    if len(across) == 0:
        return None
    apart_m = np.hypot(*(across[:, None] - across).T)
    thing = across[np.argmax((apart_m < _THING_M).sum(axis=0))]
    rest: FloatArray = points[np.hypot(*(points[:, :2] - thing).T) > _THING_M]
    return rest

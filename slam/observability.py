"""Whether a scan holds a pose in every direction: what an ICP without normals cannot say itself."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.point_map import PointMap
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2, wrap_angle
from slam.surface.surface_map import faced

_SHIFT_M = 0.2
"""Chosen: far beyond the spacing of a map's points and the noise of a laser."""
_LEAST_SHARE = 0.0004
"""Chosen: the least of 600 scans of two real buildings that found their pose was 0.0005; corridors
in which scans slid have none."""
_LEAST_FACING = 0.01
"""Chosen: one of 100 points on a surface that faces along it. The least of 364 scans of two real
buildings that found their pose is 0.018."""
_MOST_POINTS = 200
_SQRT2 = math.sqrt(2.0)
_LEAST_EXTENT_M = 0.1
"""Chosen: a scan that all lies in one spot, as of a blocked laser, is a scan of nothing."""


def as_far_as_held(
    match: ScanMatch, beams: Beams, point_map: PointMap, T_predicted: SE2
) -> ScanMatch:
    """The match; where the scan leaves a direction open, the prediction along it, and no belief."""
    if not match.is_matched:
        return match
    T_map_base, is_open = held(
        # far along a wall points stand alone: facing the laser they would seem to hold the way there
        faced(beams.points, beams.middle_m, is_lone_told=False),
        point_map, T_predicted, match.T_map_base,
    )  # fmt: skip
    if not is_open:
        return match
    return replace(match, T_map_base=T_map_base, status=MatchStatus.DEGENERATE)


def held(
    faced_base: FloatArray, point_map: PointMap, T_predicted: SE2, T_map_base: SE2
) -> tuple[SE2, bool]:
    """The pose found, as far as the scan holds it; and whether it leaves a direction open.

    faced_base: (N, 3) of `surface_map.faced`. Along an open direction the prediction stands: one
    along which the mean squared distance to the map is less curved than 0.04 % of the points on a
    wall across would make it, by shifts and turns of 0.2 m to either side; or where that leaves
    none open, one along which no surface faces. A single wall, a corridor without an end, a round
    wall all around.
    """
    if len(faced_base) < 3 or len(point_map) == 0:
        return T_predicted, True
    sample = faced_base[:: max(1, len(faced_base) // _MOST_POINTS)]
    points = sample[:, :2]
    centre = points.mean(axis=0)
    lever_m = math.sqrt(float(np.mean(np.sum((points - centre) ** 2, axis=1))))
    if lever_m < _LEAST_EXTENT_M:
        return T_predicted, True
    points_map = T_map_base @ points
    open_ways = _open_to_shifts(points_map, lever_m, point_map)
    if not len(open_ways):
        facings_rad = sample[:, 2] + T_map_base.theta
        open_ways = _open_to_normals(points_map, facings_rad, lever_m, point_map)
    if not len(open_ways):
        return T_map_base, False
    centre_predicted = (T_predicted @ centre[np.newaxis])[0]
    moved_m = np.append(
        (T_map_base @ centre[np.newaxis])[0] - centre_predicted,
        lever_m * wrap_angle(T_map_base.theta - T_predicted.theta),
    )
    for direction in open_ways:
        moved_m -= direction * (direction @ moved_m)
    turned = SE2(0.0, 0.0, T_predicted.theta + moved_m[2] / lever_m)
    x, y = centre_predicted + moved_m[:2] - (turned @ centre[np.newaxis])[0]
    return SE2(x, y, turned.theta), True


def _open_to_shifts(points_map: FloatArray, lever_m: float, point_map: PointMap) -> FloatArray:
    """(D, 3) unit directions along which shifts of the points (N, 2) bring them no farther off."""
    rise = _rise_of(points_map, lever_m, point_map)
    shares, directions = np.linalg.eigh(_curvature(rise))
    # round walls bend the form over so wide a shift: what it takes for open is looked at itself
    is_open = [
        share < _LEAST_SHARE and rise(direction) < _LEAST_SHARE
        for share, direction in zip(shares, directions.T, strict=True)
    ]
    return np.asarray(directions.T[np.array(is_open)])


def _open_to_normals(
    points_map: FloatArray, facings_rad: FloatArray, lever_m: float, point_map: PointMap
) -> FloatArray:
    """(D, 3) unit directions along which no surface faces that the points (N, 2) lie on.

    So wide a shift may bring points to a surface that none of them has met, or show a circle's
    facets. Which way a surface faces is told by the scan (N,): the map's points about it may be
    those of a surface that stands beside it.
    """
    pairs = point_map.nearest(points_map, _SHIFT_M)
    facing_rad = facings_rad[pairs.scan_ids]
    normals = np.nan_to_num(np.column_stack([np.cos(facing_rad), np.sin(facing_rad)]))
    offsets = points_map[pairs.scan_ids] - points_map.mean(axis=0)
    turns = (offsets[:, 0] * normals[:, 1] - offsets[:, 1] * normals[:, 0]) / lever_m
    facing = np.column_stack([normals, turns])
    shares, directions = np.linalg.eigh(facing.T @ facing / len(points_map))
    return np.asarray(directions.T[shares < _LEAST_FACING])


Rise = Callable[[FloatArray], float]
"""From a unit direction (x, y, turn about the middle times the lever) to the curvature along it."""


def _rise_of(points_map: FloatArray, lever_m: float, point_map: PointMap) -> Rise:
    """How the mean squared distance rises by shifts to either side; 1: all on a wall across."""
    middle, here_m2 = points_map.mean(axis=0), _mean_squared_m2(points_map, point_map)

    def rise(direction: FloatArray) -> float:
        x, y, turn = _SHIFT_M * direction
        there_m2 = 0.0
        for sign in (1.0, -1.0):
            motion = SE2(sign * x, sign * y, sign * turn / lever_m)
            there_m2 += _mean_squared_m2(middle + motion @ (points_map - middle), point_map) / 2.0
        return (there_m2 - here_m2) / _SHIFT_M**2

    return rise


def _curvature(rise: Rise) -> FloatArray:
    """(3, 3) the quadratic form that rises so along the axes and between them."""
    form = np.diag([rise(axis) for axis in np.eye(3)])
    for j, k in itertools.combinations(range(3), 2):
        along, across = np.eye(3)[j] + np.eye(3)[k], np.eye(3)[j] - np.eye(3)[k]
        form[j, k] = form[k, j] = (rise(along / _SQRT2) - rise(across / _SQRT2)) / 2.0
    return form


def _mean_squared_m2(points_map: FloatArray, point_map: PointMap) -> float:
    """Mean of squared distances to the map [m2], each counted as twice the shift at most."""
    pairs = point_map.nearest(points_map, 2.0 * _SHIFT_M)
    squared_m2 = np.full(len(points_map), (2.0 * _SHIFT_M) ** 2)
    differences = points_map[pairs.scan_ids] - point_map.points[pairs.map_ids]
    squared_m2[pairs.scan_ids] = np.sum(differences**2, axis=1)
    return float(squared_m2.mean())

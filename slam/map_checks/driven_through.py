"""Walls of a map that the robot drove through: then the map is wrong there, whatever else agrees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from slam.arrays import BoolArray, FloatArray
from slam.frontend.keyframes import Keyframe
from slam.kernels.visibility import contradictions
from slam.se2 import SE2

_APART = 10
"""Chosen: keyframes so near in the drive lie right beside one another, whatever else is wrong."""
_ON_M = 0.1
"""Chosen: the robot's middle passes so near; its sides reach farther."""
_THICK_M = 0.25
"""Chosen: along the way, of what is one wall."""
_DOOR_M, _WIDE_M = 0.5, 1.0
"""To either side: half a door may have been closed then; what reaches farther is a wall."""
_FEW = 2
"""Points to either side, of one scan."""
_LONGEST_STEP_M = 2.0
"""Between keyframes farther apart the way is not known so well."""
_LOOKS = (-8, -6, -4, -3, -2, -1, 0, 1, 2, 3, 4, 5, 7, 9)
"""Chosen: keyframes about the crossing that are asked whether they look through the wall."""


@dataclass(frozen=True)
class DrivenThrough:
    """What stands on the way to a keyframe. scans: that saw it there, on the way itself and to both
    sides. walls: of these, that reach farther than a door, and of which scans from about there do not say
    that it was a closed one: that what is to its sides, farther than a door reaches, stands there still."""

    keyframe: int
    scans: int
    walls: int


def driven_through(
    keyframes: Sequence[Keyframe], poses: FloatArray, margins: tuple[float, float]
) -> list[DrivenThrough]:
    """What the robot drove through on a map of keyframes at poses (K, 3), in the order of the drive.

    margins: in metres and as a share of the distance, by which beams end farther that went through.
    """
    if len(keyframes) < 2:
        return []
    clouds = [SE2.from_array(pose) @ one.points for pose, one in zip(poses, keyframes, strict=True)]
    points = np.concatenate(clouds)
    owners = np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds])
    if len(points) == 0:
        return []
    tree, found = cKDTree(points), []
    for k in range(1, len(keyframes)):
        start_m, end_m = poses[k - 1, :2], poses[k, :2]
        length_m = math.hypot(*(end_m - start_m))
        if not keyframes[k].goes_on or not 0.0 < length_m <= _LONGEST_STEP_M:
            continue
        near = np.array(tree.query_ball_point((start_m + end_m) / 2.0, length_m / 2.0 + _ON_M), int)
        near = near[np.abs(owners[near] - k) > _APART]
        along = (end_m - start_m) / length_m
        on_way = _seen_from(points[near], start_m, along)
        is_on = (on_way[:, 0] >= 0.0) & (on_way[:, 0] < length_m) & (np.abs(on_way[:, 1]) < _ON_M)
        scans = walls = 0
        for owner in np.unique(owners[near[is_on]]).tolist():
            at_m = float(np.median(on_way[is_on & (owners[near] == owner), 0]))
            cloud = clouds[owner]
            sides = _sides(_seen_from(cloud, start_m, along), at_m)
            if min(np.count_nonzero(side) for side in sides[:2]) >= _FEW:
                scans += 1
                beyond = [cloud[one] for one in sides[2:] if np.count_nonzero(one) >= _FEW]
                asked = [_passed(one, keyframes, poses, k, margins) for one in beyond]
                # somebody beside the edge of a door reaches no farther than that
                walls += True in asked or (len(asked) > 0 and False not in asked)
        if scans:
            found.append(DrivenThrough(k, scans, walls))
    return found


def _seen_from(points: FloatArray, start_m: FloatArray, along: FloatArray) -> FloatArray:
    """(N, 2) along a way and to its left."""
    off = points - start_m
    return np.column_stack([off @ along, off @ np.array([-along[1], along[0]])])


def _sides(on_way: FloatArray, at_m: float) -> list[BoolArray]:
    """Of points (N, 2), those across the way there: beside it left and right, and beyond a door."""
    is_across = np.abs(on_way[:, 0] - at_m) < _THICK_M
    return [
        is_across & (side * on_way[:, 1] > near) & (side * on_way[:, 1] < far)
        for near, far in ((_ON_M, _DOOR_M), (_DOOR_M, _WIDE_M))
        for side in (1.0, -1.0)
    ]


def _passed(
    points: FloatArray,
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
    k: int,
    margins: tuple[float, float],
) -> bool | None:
    """Whether beams of a keyframe about there go through most of some points (N, 2); None: none of
    them says anything of these."""
    said = None
    for other in (k + step for step in _LOOKS):
        if not 0 <= other < len(keyframes) or keyframes[other].is_place_alone:
            continue
        beams = keyframes[other].beams
        T_other_map = SE2.from_array(poses[other]).inverse()
        seen, passed = contradictions(
            points, T_other_map.x, T_other_map.y, T_other_map.theta, beams.middle_m,
            beams.angles_rad, beams.ranges_m, *margins, 0.0,
        )  # fmt: skip
        if seen >= _FEW:
            if 2 * passed > seen:
                return True
            said = False
    return said

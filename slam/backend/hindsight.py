"""What is known of the steps of a drive once all of it is: before its map is finished."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slam.backend.drive import Drive
from slam.backend.rescaling import chained, rescaled
from slam.frontend.wheel_scale import ScaledSteps
from slam.map_checks.followers import with_followers_left
from slam.map_checks.jumped_scans import has_jumped_alone
from slam.map_checks.there_and_back import put_strays_back
from slam.map_checks.wheels_borne_out import believe_where_borne_out, told_to_keyframes
from slam.packed import each
from slam.se2 import SE2
from slam.slam_map import SlamMap


def look_back(drive: Drive) -> None:
    """Takes the steps between keyframes for as sure as all of the drive shows them to be, by the wheels'
    scale that is known at its end, and has keyframes where these lead that lie aside of the way."""
    _rescale(drive)
    is_doubted = drive.config.is_odometry_doubted
    if is_doubted:
        believe_where_borne_out(drive.graph, drive.front_end, drive.own_steps, drive.told)
    else:
        drive.weak_steps.loosen(drive.graph, drive.told_to_keyframes, drive.steps, drive.closer)
    right_strays(drive)
    if not drive.session.is_joined:
        drive.breaks.leave_apart(drive.session.first)
    if not is_doubted:
        drive.breaks.believe(drive.graph, drive.told_to_keyframes)


def right_strays_beside(drive: Drive, slam_map: SlamMap) -> bool:
    """Where scans of a map jumped alone, looks back once more: what lies beside a stray is where it
    belongs by now. Whether any keyframe was put back."""
    if not drive.session.is_joined:
        return False
    first_step = drive.session.first_step
    has_jumped = has_jumped_alone(slam_map.steps, first_step, drive.told, slam_map.poses)
    return has_jumped and right_strays(drive)


def right_strays(drive: Drive) -> bool:
    """Looks back at keyframes of the drive that lie aside of the way; whether any was put back."""
    front_end, first, config = drive.front_end, drive.session.first, drive.config
    by_wheels = told = drive.told_to_keyframes
    if config.is_odometry_doubted:
        by_wheels = told_to_keyframes(drive.own_steps, drive.told)
    strays = put_strays_back(drive.graph, told, by_wheels, config.strays, config.front_end.surfaces)
    if strays:
        _leave_followers(drive, strays)
    # these steps are no longer by the wheels' scale
    for at in {own for k in strays for own in (k - first, k + 1 - first)}:
        front_end.scaled_steps[at] = replace(front_end.scaled_steps[at], slope=np.zeros(3))
    return bool(strays)


def _rescale(drive: Drive) -> None:
    """Takes the drive's steps by the wheels' scale that is known at its end."""
    front_end, graph = drive.front_end, drive.graph
    scale = front_end.wheel_scale.scale
    keyframes, poses = rescaled(graph.keyframes, front_end.scaled_steps, scale), graph.poses
    by_scale = (replace(step, scale=scale) for step in front_end.scaled_steps)
    front_end.scaled_steps = ScaledSteps(by_scale)
    if not graph.loops:
        poses = chained(keyframes, poses, drive.session.first)
    graph.renew(keyframes, graph.loops, poses)


def _leave_followers(drive: Drive, moved: dict[int, SE2]) -> None:
    """Has scans stay that were seen from keyframes that moved, where these alone were drawn aside."""
    wheels, first = drive.front_end.wheel_scale, drive.session.first
    told = each(drive.told, wheels.scaled_step)
    left = with_followers_left(
        drive.steps, drive.session.first_step, told, drive.graph.poses, moved
    )
    ways = {k: dict[SE2, SE2]() for k in moved}
    for one, other in zip(drive.steps, left, strict=True):
        if one.keyframe in ways and one.T_keyframe_base != other.T_keyframe_base:
            ways[one.keyframe][one.T_keyframe_base] = other.T_keyframe_base
    for k, of_scans in ways.items():
        drive.front_end.glances[k - first].move(of_scans)
    drive.steps = left

"""What a drive says against its own map, in words: what its scans alone do not show."""

from __future__ import annotations

from functools import partial

from slam.backend.drive import Drive
from slam.map_checks.hanging_pieces import hanging_pieces
from slam.map_checks.lone_loops import breaks_in_doubt
from slam.map_checks.map_consistency import judged
from slam.map_checks.map_drift import too_far_adrift
from slam.map_checks.moved_things import moved_things
from slam.map_checks.open_ways import unknown_ways
from slam.map_checks.range_offset import said_of_ranges
from slam.map_checks.scan_places import unknown_places
from slam.map_checks.shown_jumps import shown_jumps
from slam.mapper_config import MapperConfig
from slam.slam_map import SlamMap


def objections_to(slam_map: SlamMap, drive: Drive) -> list[str]:
    """In words, why the map of a drive is not to be used; none of one that is."""
    said = _of_the_way(slam_map, drive) or _of_the_map(slam_map, drive)
    return said + said_of_ranges(slam_map.keyframes, slam_map.poses)


def _of_the_way(slam_map: SlamMap, drive: Drive) -> list[str]:
    """Where it is not known how the robot went."""
    front_end, session = drive.front_end, drive.session
    said = drive.monitor.objections(slam_map.steps, partial(session.between_m, slam_map))
    said += drive.jumps.objections(drive.own_steps, drive.config.is_odometry_doubted)
    said = said or unknown_ways(slam_map, front_end, drive.monitor.noise_ratio)
    return said or shown_jumps(slam_map.keyframes, slam_map.poses, drive.told_to_keyframes)


def _of_the_map(slam_map: SlamMap, drive: Drive) -> list[str]:
    """Where places may lie elsewhere than the map has them."""
    config, front_end = drive.config, drive.front_end
    said = moved_things(slam_map, config.front_end)
    said = said or unknown_places(
        slam_map, drive.session.first_step, drive.told, front_end.wheel_scale,
        config.is_odometry_doubted,
    )  # fmt: skip
    said = said or too_far_adrift(slam_map.drift_m, slam_map.poses)
    said = said or hanging_pieces(slam_map, config.front_end.break_sigma)
    if config.is_odometry_doubted:
        return said
    return said or breaks_in_doubt(slam_map, drive.told_to_keyframes, config)


def objections_of_drives(slam_map: SlamMap, config: MapperConfig) -> list[str]:
    """What the drives themselves said against a map that is continued: its scans are judged anew, and
    how far it drifted, what hangs, and what was moved; how far a robot went between walls that look the
    same nobody can say later."""
    if slam_map.verdict.is_good:
        return []
    told = slam_map.keyframes, slam_map.poses, slam_map.loops, slam_map.rejected
    anew = (
        *judged(*told, config.consistency).reasons,
        *too_far_adrift(slam_map.drift_m, slam_map.poses),
        *hanging_pieces(slam_map, config.front_end.break_sigma),
        *moved_things(slam_map, config.front_end),
    )
    return [reason for reason in slam_map.verdict.reasons if reason not in anew]

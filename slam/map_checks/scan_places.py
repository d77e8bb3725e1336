"""Whether it is known where each scan of a drive was taken, on a map that holds together."""

from __future__ import annotations

from collections.abc import Sequence

from slam.frontend.told_steps import ToldStep
from slam.frontend.wheel_scale import WheelScale
from slam.map_checks.blind_poses import unknown_blind_poses
from slam.map_checks.scan_jumps import scan_jumps
from slam.map_checks.wheels_borne_out import shown_noise, told_to_keyframes
from slam.packed import each
from slam.slam_map import SlamMap


def unknown_places(
    slam_map: SlamMap,
    first_step: int,
    told: Sequence[ToldStep],
    wheels: WheelScale,
    is_odometry_doubted: bool,
) -> list[str]:
    """In words, where nobody knows where scans of the last session were taken.

    first_step: with which that begins; told: the motion by the wheels to each of its scans, from the one
    before.
    """
    steps, poses, noise = slam_map.steps, slam_map.poses, wheels.noise
    if is_odometry_doubted:  # the front end did not ask how noisy wheels are
        to_keyframes = told_to_keyframes(steps[first_step:], told)
        noise = shown_noise(slam_map.keyframes, poses, to_keyframes) or noise
    scaled = each(told, wheels.scaled_step)
    said = scan_jumps(steps, first_step, scaled, poses, noise, is_odometry_doubted)
    is_whole = slam_map.verdict.is_good
    return said or unknown_blind_poses(steps, first_step, scaled, poses, noise, is_whole)

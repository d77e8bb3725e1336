"""How far a map may be off along walls that look the same all along: there the wheels alone tell how
far the robot went, with a scale that is known so well, and a noise of their own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray
from slam.backend.rescaling import chained, rescaled
from slam.frontend.front_end import FrontEnd
from slam.frontend.keyframes import Keyframe
from slam.frontend.wheel_scale import ScaledStep, WheelScale
from slam.map_checks.map_drift import drift_m
from slam.odometry import place_sigma_m
from slam.slam_map import SlamMap, graph_of

_MOST_M = 0.1
"""Chosen: of a map's poses, as root mean square, for one standard deviation of the wheels' scale and
the noise that they have shown, together: maps that say 0.1 m are off by up to 0.16."""
_MOST = 0.0025
"""Of the distance between the corners of what was driven, where that makes more. Chosen on simulated
buildings with ways of 15 to 200 m."""
_LITTLE_TOLD = 0.8
"""Share of the wheels' variance of a step that a scan leaves which tells hardly how far it went. Chosen: of
104 simulated buildings, most of them corridors, it told the one apart that was wrong and called good."""
_KNOWN = np.diag([1e-6, 1e-6, 1e-8])
_KNOWN_SIGMA = 1e-3, 1e-3, 1e-4
"""[m, m, rad] of steps of which scans tell enough. Chosen: little, beside what scans leave open."""


def unknown_ways(slam_map: SlamMap, front_end: FrontEnd, noise_ratio: float | None) -> list[str]:
    """In words, that a map may be too long or short, or wrong in its parts: scans left open how far
    the robot went, and the wheels tell it not well enough. front_end: of its last session;
    noise_ratio: see `ComparedWays`; of a way too short for it, wheels are as noisy as scan after scan shows."""
    if len(slam_map.keyframes) < 2:
        return []
    most_m = max(_MOST_M, _MOST * float(np.hypot(*np.ptp(slam_map.poses[:, :2], axis=0))))
    scale = front_end.wheel_scale
    if noise_ratio is None:
        noise_ratio = math.sqrt(scale.noise)
    longer = _longer(slam_map, front_end.scaled_steps, scale)
    told = _told(slam_map, front_end)
    # one step after the other; loops but lessen it, and most maps need no second look
    first = len(slam_map.keyframes) - len(front_end.scaled_steps)
    before, after = (chained(one, slam_map.poses, first) for one in (slam_map.keyframes, longer))
    variance_m2 = sum(float(np.trace(one.covariance[:2, :2])) for one in told)
    if math.hypot(_spread_m(after - before), noise_ratio * math.sqrt(variance_m2)) < most_m:
        return []
    before, after = (
        graph_of(one, slam_map.loops, slam_map.poses).solve().poses
        for one in (slam_map.keyframes, longer)
    )
    by_scale_m = _spread_m(after - before)
    graph = graph_of(told, slam_map.loops, slam_map.poses, _KNOWN_SIGMA)
    by_noise_m = noise_ratio * drift_m(graph, np.arange(len(told)))
    off_m = math.hypot(by_scale_m, by_noise_m)
    if off_m < most_m:
        return []
    if all(one.told.is_guess for one in slam_map.keyframes[first + 1 :]):
        told_by = "no wheels tell how far the robot went between them"
    else:
        known = f"whose scale is known to {100.0 * scale.sigma:.1f} %"
        noisy = "which by how they agree with scans elsewhere are off by as much"
        told_by = (
            "how far the robot went between them the wheels alone tell,"
            f" {known if by_scale_m > by_noise_m else noisy}"
        )
    return [
        f"walls along the way look the same all along, and {told_by}: the map may be off by {off_m:.2f} m"
    ]


def _longer(
    slam_map: SlamMap, steps: Sequence[ScaledStep], wheel_scale: WheelScale
) -> list[Keyframe]:
    """The keyframes by a scale one standard deviation larger; steps: of the last ones, from a
    session's first on."""
    off = [ScaledStep(wheel_scale.scale - wheel_scale.sigma, step.slope) for step in steps]
    return rescaled(slam_map.keyframes, off, wheel_scale.scale)


def _told(slam_map: SlamMap, front_end: FrontEnd) -> list[Keyframe]:
    """The keyframes, as sure as can be of each step of the last session but those of which the scan
    does not tell how far it went, or hardly, and those past others that were let go. One that wheels
    contradicted, and which is less sure for that than the front end was, tells all the same."""
    session = slam_map.session_count - 1
    is_open = {
        step.keyframe
        for step in slam_map.steps
        if step.session == session and step.is_keyframe and step.is_open
    }
    first = len(slam_map.keyframes) - len(front_end.keyframes)
    is_open |= {
        k
        for k, keyframe in enumerate(slam_map.keyframes[first + 1 :], start=first + 1)
        if (
            not keyframe.is_break  # what is known over these, loops say
            and min(
                place_sigma_m(one.covariance) for one in (keyframe, front_end.keyframes[k - first])
            )
            > math.sqrt(_LITTLE_TOLD) * place_sigma_m(keyframe.told.covariance)
        )
        or keyframe.is_after_gap
    }
    # what the scan itself tells of the way to these, their ties say
    is_open |= {loop.later for loop in (*slam_map.loops, *slam_map.rejected) if loop.is_tie}
    return [
        one if k in is_open else replace(one, covariance=_KNOWN)
        for k, one in enumerate(slam_map.keyframes)
    ]


def _spread_m(moved: FloatArray) -> float:
    """How far poses have moved (K, 3) against one another, as root mean square [m]."""
    return math.sqrt(float(np.var(moved[:, 0]) + np.var(moved[:, 1])))

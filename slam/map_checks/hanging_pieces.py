"""Pieces of a map that were come to blind, and hang by loops far from there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from slam.arrays import FloatArray, IntArray
from slam.frontend.keyframes import StepStatus
from slam.map_checks.map_drift import sigmas_m
from slam.pose_graph import PoseGraph
from slam.slam_map import SlamMap, graph_of

_LOOSER, _LEAST_M = 3.0, 0.3
"""Times what a map knows elsewhere of two places as far apart, up to which the way over a break is known;
and standard deviation of that, up to which it is no matter. Chosen on maps of mit-csail with a laser that
froze: 3.1 and 0.34 m in one that was 0.23 m off."""
_OPEN_M = 0.7
"""As _LEAST_M, of a break that was not come to blind. Chosen: odometry of aces stuck for 10 s, 0.85 m where the map
was 0.8 m off, 0.5 and 0.6 m where it was right."""
_MOST_ADDED = 0.99
"""Share of a variance that may have been added; chosen: a map file may say that a break is known for sure."""
_ROWS, _PAIRS, _LEAST_PAIRS = 96, 60, 10
"""Keyframes from which others are looked for, pairs of them that are asked, and fewer that say nothing.
Chosen."""
_AS_FAR, _AS_FAR_M = 0.2, 0.3
"""By how much these may be nearer or farther apart: share of the distance, and beside that. Chosen."""


def hanging_pieces(slam_map: SlamMap, break_sigma: tuple[float, float, float]) -> list[str]:
    """In words, that what came after a way driven blind, or one that no wheels told, may lie elsewhere as seen from
    before it: where loops tie the two from so far away that nobody knows, by far less than of other places as far apart.

    A scan or two may be off on the way to these loops, and no other saw the same. What the map says of
    itself is its own measure, since by which share it is too cautious is another for each log. Wheels
    count for what they say: break_sigma (m, m, rad), by which they were taken for less sure, does not.
    """
    keyframes = slam_map.keyframes
    came_blind = {
        step.keyframe: before.status is StepStatus.CARRIED
        for before, step in pairwise(slam_map.steps)
        if step.is_keyframe and keyframes[step.keyframe].is_break
        if before.session == step.session == keyframes[step.keyframe - 1].session
    }
    blind = [k for k, is_blind in came_blind.items() if is_blind]
    seen = [k for k in came_blind if k not in blind]
    for breaks, as_told, least_m, words in (
        (blind, blind, _LEAST_M, "no scan told where the robot is"),
        (seen, [*blind, *seen], _OPEN_M, "nothing told how far the robot went"),
    ):
        if breaks:
            graph = _as_wheels_say(slam_map, as_told, break_sigma)
            said = _hanging(slam_map, graph, breaks, least_m, words)
            if said:
                return said
    return []


def _hanging(
    slam_map: SlamMap, graph: PoseGraph, breaks: Sequence[int], least_m: float, words: str
) -> list[str]:
    """In words, what is less known over one of the breaks than elsewhere, by the graph; words: of what came before."""
    keyframes, poses, solution = slam_map.keyframes, slam_map.poses, graph.solve()
    over_m = sigmas_m(solution, np.array([(k - 1, k) for k in breaks]))
    for k, sigma_m in zip(breaks, over_m, strict=True):
        if sigma_m <= least_m:
            continue
        pairs = _as_far(poses, float(np.hypot(*(poses[k] - poses[k - 1])[:2])))
        if len(pairs) < _LEAST_PAIRS:
            continue
        usual_m = float(np.median(sigmas_m(solution, pairs)))
        if sigma_m > _LOOSER * usual_m:
            return [
                f"until {keyframes[k].time_s:.2f} s {words}, and loops tie what"
                f" came after to what was before from so far away that it may lie {sigma_m:.1f} m elsewhere:"
                f" other places as far apart are known to {usual_m:.2f} m"
            ]
    return []


def _as_wheels_say(
    slam_map: SlamMap, breaks: Sequence[int], break_sigma: tuple[float, float, float]
) -> PoseGraph:
    """The map's pose graph, as sure of breaks as the wheels are."""
    keyframes = list(slam_map.keyframes)
    for k in breaks:
        covariance = keyframes[k].covariance
        if (
            np.diag(covariance) < np.square(break_sigma)
        ).all():  # see `slam.map_checks.breaks_borne_out`
            continue
        added = np.minimum(np.square(break_sigma), _MOST_ADDED * np.diag(covariance))
        told = covariance - np.diag(added)
        if np.linalg.eigvalsh(told)[0] <= 0.0:  # its errors go together
            told = (1.0 - float(np.max(added / np.diag(covariance)))) * covariance
        keyframes[k] = replace(keyframes[k], covariance=told)
    return graph_of(keyframes, (*slam_map.loops, *slam_map.rejected), slam_map.poses)


def _as_far(poses: FloatArray, apart_m: float) -> IntArray:
    """(P, 2) keyframes at poses (K, 3) that are about so far apart."""
    rows = np.linspace(0, len(poses) - 1, min(len(poses), _ROWS)).round().astype(np.int64)
    away_m = np.hypot(*(poses[rows, None, :2] - poses[None, :, :2]).transpose(2, 0, 1))
    found = np.argwhere(np.abs(away_m - apart_m) < _AS_FAR * apart_m + _AS_FAR_M)
    pairs = np.column_stack([rows[found[:, 0]], found[:, 1]])
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    asked = np.linspace(0, len(pairs) - 1, min(len(pairs), _PAIRS)).round().astype(np.int64)
    result: IntArray = pairs[asked]
    return result

"""Loops that stand alone against the wheels, over breaks.

Where scans broke off one loop may say where what came after lies, be it that of a corridor which looks the same a
metre on.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray
from slam.frontend.keyframes import Keyframe
from slam.frontend.told_steps import ToldStep
from slam.loop_closing import Loop
from slam.map_checks.ways_over_breaks import seen_ways, sure_ways
from slam.mapper_config import MapperConfig
from slam.pose_graph import PoseGraphSolution
from slam.slam_map import SlamMap, graph_of

LEAST_NOISE = 0.25
"""Of wheels that are taken for noisier than they are; chosen."""
_DENIED_NIS, _AGREED_NIS = 30.0, 11.3
"""Of the wheels' way over a break against what the rest of a map knows of it: from which one of them is wrong, chosen;
and up to which both may be right: three degrees of freedom, 1 % of right ones."""
_ALONE = 0.5
"""Share of what is known of how two keyframes lie that a loop tells, and no others say as much. Chosen."""


@dataclass(frozen=True, eq=False)
class LoneLoop:
    """A loop over the break before a keyframe that alone denies the wheels, by off_m. is_denied: the others lead where
    wheels do; else they tell nothing."""

    loop: Loop
    keyframe: int
    off_m: float
    is_denied: bool


def lone_loops(
    keyframes: Sequence[Keyframe],
    loops: Sequence[Loop],
    solution: PoseGraphSolution,
    sure: Mapping[int, FloatArray],
    step_sigma: tuple[float, float, float],
) -> list[LoneLoop]:
    """Of a map's loops, one of each break at most. solution: of its graph; sure: by the keyframe after each break,
    the covariance (3, 3) of wheels, see `sure_ways`; step_sigma: as in `graph_of`."""
    found = list[LoneLoop]()
    for k, seen in seen_ways(keyframes, solution, sure).items():
        if seen.squared(sure[k]) <= _DENIED_NIS:
            continue
        over = [loop for loop in loops if loop.earlier < k <= loop.later]
        for loop in _telling_alone(over, solution):
            others = [one for one in loops if one is not loop]
            without = graph_of(keyframes, others, solution.poses, step_sigma).solve()
            rest = seen_ways(keyframes, without, [k]).get(k)
            if rest is None or rest.squared(sure[k]) <= _AGREED_NIS:
                found.append(LoneLoop(loop, k, seen.off_m, rest is not None))
                break
    return found


def breaks_in_doubt(slam_map: SlamMap, told: Sequence[ToldStep], config: MapperConfig) -> list[str]:
    """In words, that nobody knows whether wheels or the one loop over a break are right; told: see `sure_ways`."""
    keyframes, loops, poses = slam_map.keyframes, slam_map.loops, slam_map.poses
    sure = sure_ways(keyframes, poses, told, config.front_end.break_sigma, LEAST_NOISE)
    if not sure or not loops:
        return []
    solution = graph_of(keyframes, loops, poses, config.step_sigma).solve()
    return [
        f"the scans broke off at {keyframes[one.keyframe].time_s:.2f} s, and one loop alone has what came after"
        f" {one.off_m:.1f} m from where the wheels lead"
        for one in lone_loops(keyframes, loops, solution, sure, config.step_sigma)
    ]


def _telling_alone(loops: Sequence[Loop], solution: PoseGraphSolution) -> Iterator[Loop]:
    """Those that tell most of what is known of how the two they lie between do, the most first."""
    pairs = np.array([(one.earlier, one.later) for one in loops]).reshape(-1, 2)
    known = solution.relative_covariances(pairs)
    shares = [
        float(np.max(np.linalg.eigvals(seen @ one.information).real))
        for one, seen in zip(loops, known, strict=True)
    ]
    for at in np.argsort(shares)[::-1].tolist():
        if shares[at] > _ALONE:
            yield loops[at]

"""Scans between two keyframes that jumped, matched once more with all that was seen before and after.

By scans alone, somebody in view draws one along a wall; and where surfaces across a corridor are few, scans after a
keyframe that saw no more of them seem to stand while the robot drives on, until the next keyframe is 2 m ahead at
once. The keyframes that follow saw what they lacked.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from slam.arrays import BoolArray, FloatArray
from slam.beams import POINTS_WITHIN_M
from slam.frontend.keyframes import FrontEndStep, Keyframe, Steps, keyframe_ways
from slam.frontend.strays import (
    StrayConfig,
    apart_m,
    standing_on_way,
    surfaces_beside,
)
from slam.frontend.told_steps import ToldStep
from slam.map_checks.followers import share_of_way
from slam.map_checks.scan_jumps import APART_M, jumps_between
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMap, SurfaceMapConfig
from slam.surface.surface_match import SurfaceMatch
from slam.surface.views import Glance

_UNEVEN_M, _WORSE = 0.2, 0.02
"""How far a scan lies from where an even way leads from the one before, and by how much more its match costs, that are
as unlikely: standard deviation and mean."""
_BETTER = 0.01
"""Cost by which a scan may fit worse on the way than where it was."""
_FITS, _SEEN = 0.9, 0.75
"""Share of a scan that must lie on surfaces where any were seen; and that must have been seen. Chosen, all of these."""


def has_jumped_alone(
    steps: Sequence[FrontEndStep], first_step: int, told: Sequence[ToldStep], poses: FloatArray
) -> bool:
    """Whether scans of the last session jumped that nothing but scans placed; otherwise as `with_jumped_put_back`."""
    # where wheels tell of all, there are none, which takes longer to find
    is_told = not any(one.is_guess for one in told[1:])
    return not is_told and bool(_jumped_alone(steps[first_step:], told, poses).any())


def with_jumped_put_back(
    steps: Steps,
    first_step: int,
    told: Sequence[ToldStep],
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
    glances: Mapping[int, Sequence[Glance]],
    surfaces: SurfaceMapConfig,
    config: StrayConfig | None = None,
) -> Steps:
    """All steps, those of the last session that jumped by scans alone where they fit on a way that does not.

    first_step: with which the session begins; told: the motion by the wheels to each of its scans, from the one
    before. poses: (K, 3) of the keyframes [m, rad]; glances: scans of the session since each of them.
    """
    config = config or StrayConfig()
    if not has_jumped_alone(steps, first_step, told, poses):
        return steps
    found, left = copy(steps), set[int]()
    runs = _jumped_runs(steps, first_step, told, keyframes, poses)
    for start, end in runs:
        k = steps[start].keyframe
        known = _placed_again(
            (start, end), steps, keyframes, poses, glances.get(k, ()), SurfaceMap(surfaces), config
        )
        T_map_keyframe = SE2.from_array(poses[k])
        for at in range(start + 1, end) if known else ():
            step, T_keyframe_base = steps[at], T_map_keyframe.between(_between(known, steps, at))
            T_session_base = step.T_map_base @ step.T_keyframe_base.between(T_keyframe_base)
            found[at] = replace(step, T_map_base=T_session_base, T_keyframe_base=T_keyframe_base)
        left |= {at for at in range(start + 1, end) if known and at not in known}
    # those that nothing places may hide a jump between those on either side
    kept = [at for at in range(first_step, len(steps)) if at not in left]
    jumps = jumps_between(
        [found[at] for at in kept], [told[at - first_step] for at in kept], poses, 1.0
    )
    for start, end in runs:
        way = slice(bisect_left(kept, start), bisect_left(kept, end))
        if (jumps.apart_m[way] > APART_M).any():
            for at in range(start, end):  # it is not known any better now
                found[at] = steps[at]
    return found


def _jumped_runs(
    steps: Sequence[FrontEndStep],
    first_step: int,
    told: Sequence[ToldStep],
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
) -> list[tuple[int, int]]:
    """The steps of two keyframes between which there are scans, none of them told of by wheels, that jumped."""
    has_jumped = _jumped_alone(steps[first_step:], told, poses)
    return [
        (start, end)
        for start, end in keyframe_ways(steps, first_step)
        if end > start + 1
        and has_jumped[start - first_step : end - first_step].any()
        and all(one.is_guess for one in told[start + 1 - first_step : end + 1 - first_step])
        and not keyframes[steps[end].keyframe].is_break
    ]


def _jumped_alone(
    own: Sequence[FrontEndStep], told: Sequence[ToldStep], poses: FloatArray
) -> BoolArray:
    """(N - 1,) of each way from one of N scans of a session to the next; how noisy wheels are is of no matter there."""
    return jumps_between(own, told, poses, 1.0).by_scans_alone


def _placed_again(
    run: tuple[int, int],
    steps: Sequence[FrontEndStep],
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
    glances: Sequence[Glance],
    surfaces: SurfaceMap,
    config: StrayConfig,
) -> dict[int, SE2]:
    """Where two steps lie, and the scans between them on the likeliest way from one to the other that tell where they
    are; nothing where none does, or one fits nowhere."""
    start, end = run
    T_start, T_end = (steps[at].placed(poses) for at in run)
    k, twist = steps[start].keyframe, T_start.between(T_end).log()
    surfaces_beside(surfaces, keyframes, poses, (k, k + 1), config)
    left = list(glances)
    shares, offered = [0.0], [[(T_start, 0.0)]]
    kept = list[int]()
    for at in range(start + 1, end):
        # several may have been taken from one pose, in their order
        ways = [one.T_keyframe_base for one in left]
        if not steps[at].is_seen or steps[at].T_keyframe_base not in ways:
            continue
        scan = left.pop(ways.index(steps[at].T_keyframe_base))
        share = share_of_way(steps, start, at, end)
        T_way = T_start @ SE2.exp(share * twist)
        one = _as_keyframe(scan, T_way)
        points = standing_on_way(one, T_way, keyframes, poses, (k, k + 1), config)
        reach_m = config.reach_m + 0.5 * apart_m(T_start, T_end)
        reach_rad = config.reach_rad + 0.5 * abs(float(twist[2]))
        stays = surfaces.match_alone(points, steps[at].placed(poses))
        searched = surfaces.searched(points, T_way, reach_m, reach_rad, most=5)
        matches = [stays, *(surfaces.match_alone(points, one) for one in (T_way, *searched))]
        good = [one for one in matches if _fits(one) and one.cost < stays.cost + _BETTER]
        if not good:
            return {}
        if max(one.least_facing for one in good) < config.least_facing:
            continue
        kept.append(at)
        shares.append(share)
        offered.append([(one.T_map_base, one.cost) for one in good])
    if not kept:
        return {}
    way = _likeliest([*offered, [(T_end, 0.0)]], np.array([*shares, 1.0]))
    return {start: T_start, **dict(zip(kept, way[1:-1], strict=True)), end: T_end}


def _as_keyframe(scan: Glance, T_map_base: SE2) -> Keyframe:
    """A scan at a pose, of which nothing else is asked."""
    beams = scan.view(SE2.identity()).beams
    points = beams.points_within(POINTS_WITHIN_M)
    return Keyframe(0.0, T_map_base, SE2.identity(), np.zeros((3, 3)), points, beams, False)


def _fits(match: SurfaceMatch) -> bool:
    return match.inlier_ratio >= _FITS and match.seen_ratio >= _SEEN


def _likeliest(offered: Sequence[Sequence[tuple[SE2, float]]], shares: FloatArray) -> list[SE2]:
    """Of poses offered for each scan, with what it costs there, those along the evenest way that cost least (Viterbi).

    shares: (N,) of the whole way, after which each would lie on an even one.
    """
    places = [np.array([[T.x, T.y] for T, _ in one]) for one in offered]
    whole = places[-1][0] - places[0][0]
    total, come_from = np.zeros(1), list[np.ndarray]()
    for k in range(1, len(offered)):
        off_m = places[k][np.newaxis] - places[k - 1][:, np.newaxis]
        off_m = off_m - whole * (shares[k] - shares[k - 1])
        unlikely = total[:, np.newaxis] + 0.5 * (off_m**2).sum(axis=2) / _UNEVEN_M**2
        come_from.append(unlikely.argmin(axis=0))
        total = unlikely.min(axis=0) + np.array([cost for _, cost in offered[k]]) / _WORSE
    best = [int(total.argmin())]
    for back in reversed(come_from):
        best.append(int(back[best[-1]]))
    return [one[at][0] for one, at in zip(offered, reversed(best), strict=True)]


def _between(known: Mapping[int, SE2], steps: Sequence[FrontEndStep], at: int) -> SE2:
    """Where a scan lies, or would on an even way from the last known one to the next."""
    if at in known:
        return known[at]
    before, after = max(k for k in known if k < at), min(k for k in known if k > at)
    twist = known[before].between(known[after]).log()
    return known[before] @ SE2.exp(share_of_way(steps, before, at, after) * twist)

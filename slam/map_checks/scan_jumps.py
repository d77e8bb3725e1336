"""Scans alone that have the robot jump: farther within a step than it drives, before and after.

Without wheels nothing but the scans says how far the robot went. Somebody who stands in view once more
draws one of them along a wall, and back, or the next door of a corridor is taken for this one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from slam.arrays import BoolArray, FloatArray
from slam.frontend.keyframes import FrontEndStep, StepStatus, scan_poses
from slam.frontend.told_steps import ToldStep
from slam.se2 import SE2

_MOVES_MPS = 0.05
"""Slower, the robot stands."""
_BRIEF_S = 0.001
"""No laser is faster. Chosen."""
_LEAST = 20
"""Steps by which it is known how fast the robot drives. Chosen."""
_USUAL = 0.95
"""Share of them that are no faster than that. Chosen."""
_FASTER, APART_M = 2.0, 0.3
"""Times that speed, and how far a step ends from where it would have as fast as those before and after it.
Chosen: of 32 simulated drives without wheels, jumps of right maps that were called good were 0.0 m so fast,
of wrong ones 0.6 to 0.7 m."""
_BACK_M = 0.5
"""As `APART_M`, of a step no faster than the others, but the other way, to a scan that leaves it open or was
searched for: few turn back at once. Chosen: 1 m of a real log played backwards, and 0.3 m of a scan of a right map."""
_AGAINST = 60.0
"""Normalised error squared of what was told of a step, beyond which it is not the one that scans show. As
`FrontEndConfig.surely_wrong`."""
_ALIKE, _BESIDE = 20.0, 3
"""The same, up to which wheels tell what scans show, and steps on either side of one, of all of which they do: then
doubted wheels are right. Chosen: those that slip, lag or stick are wrong of more than one."""
_FITS = 0.94
"""Share of scans that fits, above which they, and those beside them, are right rather than wheels that are
doubted. Chosen: of 37 second looks at drives with people and wheels that slip, lag and stick, no wrong one was
called good, and 11 of 16 right ones were; two without it."""


def scan_jumps(
    steps: Sequence[FrontEndStep],
    first_step: int,
    told: Sequence[ToldStep],
    poses: FloatArray,
    noise: float,
    is_odometry_doubted: bool = False,
) -> list[str]:
    """In words, that scans jumped that nothing but scans placed, or far from where wheels that went on led.

    first_step: with which the last session begins; told: what was measured of the motion to each of its
    scans, by the wheels' scale, and noise: its variance, as a multiple of what was told.
    poses: (K, 3) of the keyframes [m, rad]. is_odometry_doubted: it was not believed as they were
    placed. Scans that broke off are another matter: see `slam.map_checks.pieces`.
    """
    own = steps[first_step:]
    jumps = jumps_between(own, told, poses, noise, is_odometry_doubted)
    if not jumps.has_jumped.any():
        return []
    worst = int(np.argmax(np.where(jumps.has_jumped, jumps.apart_m, 0.0)))
    by = "by scans against the wheels" if jumps.is_denied[worst] else "by scans alone"
    return [
        f"at {own[worst + 1].time_s:.2f} s the robot would have gone"
        f" {jumps.ways_m[worst]:.1f} m in {jumps.intervals_s[worst]:.2f} s, {by}, and"
        " neither before nor after: somebody in view may have drawn one of them"
    ]


@dataclass(frozen=True, eq=False)
class Jumps:
    """Of each way from one of N scans to the next, (N - 1,): whether it is a jump, and against wheels; how long it is
    [m], took [s], and how far it ends from where it would have as fast as those before and after [m]."""

    has_jumped: BoolArray
    is_denied: BoolArray
    ways_m: FloatArray
    intervals_s: FloatArray
    apart_m: FloatArray

    @property
    def by_scans_alone(self) -> BoolArray:
        """(N - 1,) those that nothing but scans tells of."""
        result: BoolArray = self.has_jumped & ~self.is_denied
        return result


def jumps_between(
    own: Sequence[FrontEndStep],
    told: Sequence[ToldStep],
    poses: FloatArray,
    noise: float,
    is_odometry_doubted: bool = False,
) -> Jumps:
    """The jumps between the scans of a session; none, where those are too few to tell. Otherwise as `scan_jumps`."""
    if len(own) < _LEAST:
        return _no_jumps(len(own))
    times_s, found = scan_poses(own, poses)
    velocities_mps, intervals_s = _driven(found[:, :2], times_s)
    speeds_mps = np.hypot(*velocities_mps.T)
    is_seen, is_guess = _is_seen(own), np.array([one.is_guess for one in told[1:]])
    ways = pairwise(SE2.from_array(pose) for pose in found)
    off = np.array([one.squared(*ends) for one, ends in zip(told[1:], ways, strict=True)])
    is_denied = ~is_guess & _is_on_the_way(told, intervals_s) & (off > _AGAINST * noise)
    if is_odometry_doubted:
        is_alone = _is_alone(~is_guess & (off < _ALIKE * noise))
        is_denied &= (_fit(own) < _FITS) | is_alone
    apart_mps = np.where(
        is_denied,
        _apart_mps(velocities_mps, is_seen),
        # how fast it went before and after says nothing of a robot of which odometry told until it was lifted
        _apart_mps(velocities_mps, is_seen & is_guess),
    )
    apart_m = apart_mps * intervals_s
    # what jumped says nothing of how fast the robot drives, nor does where it was found after a break
    usual_mps = speeds_mps[is_seen & (speeds_mps > _MOVES_MPS) & ~(apart_m > APART_M)]
    if len(usual_mps) < _LEAST:
        return _no_jumps(len(own))
    fast_mps = _FASTER * np.quantile(usual_mps, _USUAL)
    has_jumped = (speeds_mps > fast_mps) & (apart_m > APART_M)
    is_vague = np.array([one.is_open or one.status is StepStatus.SEARCHED for one in own[1:]])
    has_jumped |= is_vague & (apart_mps > fast_mps) & (apart_m > _BACK_M)
    return Jumps(has_jumped, is_denied, speeds_mps * intervals_s, intervals_s, apart_m)


def _no_jumps(count: int) -> Jumps:
    """Of so many scans."""
    none, zeros = np.zeros(max(count - 1, 0), bool), np.zeros(max(count - 1, 0))
    return Jumps(none, none, zeros, zeros, zeros)


def _driven(places_m: FloatArray, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N - 1, 2) velocities [m/s] from each of N places (N, 2) to the next, and (N - 1,) the time that took [s];
    of stamps (N,) that stand, or go back, half as long as usual."""
    intervals_s = np.diff(times_s)
    intervals_s = np.maximum(intervals_s, max(0.5 * float(np.median(intervals_s)), _BRIEF_S))
    return np.diff(places_m, axis=0) / intervals_s[:, np.newaxis], intervals_s


def _is_seen(steps: Sequence[FrontEndStep]) -> BoolArray:
    """(N - 1,) of each way from one of N scans to the next, whether both were matched."""
    is_seen = np.array([one.is_seen for one in steps])
    result: BoolArray = is_seen[:-1] & is_seen[1:]
    return result


def _is_on_the_way(told: Sequence[ToldStep], intervals_s: FloatArray) -> BoolArray:
    """(N - 1,) of each way between two of N scans, whether wheels went on. Whoever was lifted may have gone farther: but
    then these stand."""
    told_m = np.array([math.hypot(one.motion.x, one.motion.y) for one in told[1:]])
    result: BoolArray = told_m > _MOVES_MPS * intervals_s
    return result


def _is_alone(is_alike: BoolArray) -> BoolArray:
    """(N,) of steps whether wheels tell what scans show of all beside it, (N,) of which they do."""
    beside = np.lib.stride_tricks.sliding_window_view(np.pad(is_alike, _BESIDE), 2 * _BESIDE + 1)
    return np.asarray(np.delete(beside, _BESIDE, axis=1).all(axis=1))


def _fit(steps: Sequence[FrontEndStep]) -> FloatArray:
    """(N - 1,) how well those of N scans fit, beside each way from one to the next, that fit worst."""
    ratios = np.array([1.0, *(one.inlier_ratio for one in steps), 1.0])
    result: FloatArray = np.lib.stride_tricks.sliding_window_view(ratios, 4).min(axis=1)
    return result


def _apart_mps(velocities_mps: FloatArray, is_placed: BoolArray) -> FloatArray:
    """(N,) how far each velocity (N, 2) is from the mean of those beside it [m/s], or of the one that scans
    placed; nan where these placed neither, or not itself."""
    beside = np.full((2, *velocities_mps.shape), np.nan)
    beside[0, 1:] = np.where(is_placed[:-1, np.newaxis], velocities_mps[:-1], np.nan)
    beside[1, :-1] = np.where(is_placed[1:, np.newaxis], velocities_mps[1:], np.nan)
    count = np.isfinite(beside).sum(axis=0)
    mean_mps = np.nansum(beside, axis=0) / np.where(count > 0, count, np.nan)
    result: FloatArray = np.where(is_placed, np.hypot(*(velocities_mps - mean_mps).T), np.nan)
    return result

"""Scans alone that have the robot jump: farther within a step than it drives, before and after.

Without wheels nothing but the scans says how far the robot went. Somebody who stands in view once more
draws one of them along a wall, and back, or the next door of a corridor is taken for this one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slam.arrays import BoolArray, FloatArray
from slam.keyframes import FrontEndStep, StepStatus
from slam.strays import ToldStep

_MOVES_MPS = 0.05
"""Slower, the robot stands."""
_BRIEF_S = 0.001
"""No laser is faster. Chosen."""
_LEAST = 20
"""Steps by which it is known how fast the robot drives. Chosen."""
_USUAL = 0.95
"""Share of them that are no faster than that. Chosen."""
_FASTER, _APART_M = 2.0, 0.3
"""Times that speed, and how far a step ends from where it would have as fast as those before and after it.
Chosen: of 32 simulated drives without wheels, jumps of right maps that were called good were 0.0 m so fast,
of wrong ones 0.6 to 0.7 m."""


def scan_jumps(
    steps: Sequence[FrontEndStep], first_step: int, told: Sequence[ToldStep], poses: FloatArray
) -> list[str]:
    """In words, that scans jumped that nothing but scans placed.

    first_step: with which the last session begins; told: what was measured of the motion to each of its
    scans. poses: (K, 3) of the keyframes [m, rad]. Scans that broke off are another matter: see
    `slam.pieces`.
    """
    own = steps[first_step:]
    if len(own) < _LEAST:
        return []
    velocities_mps, intervals_s = _driven(own, poses)
    speeds_mps = np.hypot(*velocities_mps.T)
    apart_m = _apart_mps(velocities_mps, _is_placed_by_scans(own, told)) * intervals_s
    # what jumped says nothing of how fast the robot drives
    usual_mps = speeds_mps[(speeds_mps > _MOVES_MPS) & ~(apart_m > _APART_M)]
    if len(usual_mps) < _LEAST:
        return []
    is_fast = speeds_mps > _FASTER * np.quantile(usual_mps, _USUAL)
    has_jumped = is_fast & (apart_m > _APART_M)
    if not has_jumped.any():
        return []
    worst = int(np.argmax(np.where(has_jumped, apart_m, 0.0)))
    return [
        f"at {own[worst + 1].time_s:.2f} s the robot would have gone"
        f" {speeds_mps[worst] * intervals_s[worst]:.1f} m in {intervals_s[worst]:.2f} s, by scans"
        " alone, and neither before nor after: somebody in view may have drawn one of them"
    ]


def _driven(steps: Sequence[FrontEndStep], poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N - 1, 2) velocities [m/s] from each of N scans to the next, in the map's frame, and (N - 1,) the
    time that took [s]; of stamps that stand, or go back, half as long as usual."""
    placed = [step.placed(poses) for step in steps]
    intervals_s = np.diff([step.time_s for step in steps])
    intervals_s = np.maximum(intervals_s, max(0.5 * float(np.median(intervals_s)), _BRIEF_S))
    moved_m = np.diff([(pose.x, pose.y) for pose in placed], axis=0)
    return moved_m / intervals_s[:, np.newaxis], intervals_s


def _is_placed_by_scans(steps: Sequence[FrontEndStep], told: Sequence[ToldStep]) -> BoolArray:
    """(N - 1,) of each way from one of N scans to the next, whether both were matched, and nothing else
    measured it."""
    is_seen = np.array([one.status in (StepStatus.MATCHED, StepStatus.SEARCHED) for one in steps])
    is_guess = np.array([one.is_guess for one in told])
    result: BoolArray = is_seen[:-1] & is_seen[1:] & is_guess[1:]
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

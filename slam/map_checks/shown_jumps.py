"""Odometry that jumps here and there, as the scans show that see where they are.

It may be no odometry at all, but where a localizer has the robot, put right now and then. Along a corridor a scan
bears a jump of half a metre, and nobody sees it.
"""

from __future__ import annotations

from collections.abc import Sequence

from slam.arrays import FloatArray
from slam.frontend.keyframes import Keyframe
from slam.frontend.strays import apart_m
from slam.frontend.told_steps import ToldStep
from slam.map_checks.wheels_borne_out import showing, shown_noise
from slam.se2 import SE2

_FAR_M, _JUMP_NIS = 0.2, 25.0
"""By which a jump leads aside of where a scan is, and beyond which wheels as noisy as most steps show them do not.
Chosen."""
_FEW, _MOST_JUMPS = 5, 0.02
"""As many are slips, and share of steps. Chosen: 0.5 % of those of `mit-csail`, none of `aces`, `fr101` and `intel`, 0.5 %
at most of ten damaged logs and none of eight simulated buildings; 9 to 12 % where a localizer's pose jumps by 0.3 m each
quarter minute."""


def shown_jumps(
    keyframes: Sequence[Keyframe], poses: FloatArray, told: Sequence[ToldStep]
) -> list[str]:
    """In words, that odometry jumps too often to be believed where scans tell nothing. poses: (K, 3) of the keyframes
    [m, rad]; told: of the last of them, the step to each."""
    noise, ks = shown_noise(keyframes, poses, told), showing(keyframes, told)
    if noise is None:
        return []
    first, jumps = len(keyframes) - len(told), 0
    for k in ks:
        step, (T_before, T_there) = told[k - first], map(SE2.from_array, poses[k - 1 : k + 1])
        is_far = apart_m(T_before @ step.motion, T_there) > _FAR_M
        jumps += is_far and step.squared(T_before, T_there) > _JUMP_NIS * noise
    if jumps <= max(_FEW, _MOST_JUMPS * len(ks)):
        return []
    return [
        f"odometry jumps, at {jumps} of {len(ks)} scans that see where they are: where others do not, it may have"
        " jumped as well"
    ]

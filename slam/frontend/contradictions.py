"""What two scans say against each other, where each saw what the other looked through."""

from __future__ import annotations

from slam.frontend.keyframes import Keyframe
from slam.kernels.visibility import contradictions
from slam.se2 import SE2


def passed(
    one: Keyframe,
    other: Keyframe,
    T_other_one: SE2,
    margins: tuple[float, float],
    aside_m: float = 0.0,
) -> tuple[int, int]:
    """Of both scans' points, to and fro: how many are in the other's view, and how many of these
    its beams went through: ended farther by margins, in metres and as a share of the distance, and
    none went by nearer than aside_m and did not."""
    seen = through = 0
    if one.is_place_alone or other.is_place_alone:
        return 0, 0
    for points, beams, pose in (
        (one.points, other.beams, T_other_one),
        (other.points, one.beams, T_other_one.inverse()),
    ):
        counts = contradictions(
            points, pose.x, pose.y, pose.theta, beams.middle_m, beams.angles_rad, beams.ranges_m,
            *margins, aside_m,
        )  # fmt: skip
        seen, through = seen + counts[0], through + counts[1]
    return seen, through

"""Where a robot that may be at several places had best turn to."""

from __future__ import annotations

import math

import numpy as np

from slam.beams import Beams
from slam.relocalization import Hypothesis, Relocalizer
from slam.se2 import SE2


def most_telling_turn(
    relocalizer: Relocalizer, rivals: tuple[Hypothesis, ...], beams: Beams, step_rad: float
) -> float:
    """The turn on the spot [rad] after which a scan would tell the best of rivals from the others.

    By the beams whose walls would be at other ranges, of the rival that it tells least of; of equals
    the smaller turn, and step_rad where nothing tells. No more than three others are looked at.
    """
    poses = [rival.T_map_base for rival in rivals[:4]]
    best, most = step_rad, -1.0
    for count in range(1, int(math.pi / step_rad) + 1):
        for turn in (count * step_rad, -count * step_rad):
            seen = [
                relocalizer.segment_map.ranges(
                    beams, pose @ SE2(0.0, 0.0, turn), relocalizer.laser.range_max_m
                )[0]
                for pose in poses
            ]
            told = [_apart(seen[0], other, relocalizer.laser.range_max_m) for other in seen[1:]]
            least = min(told, default=0.0)
            if least > most + 1e-9:
                best, most = turn, least
    return best


def _apart(a: np.ndarray, b: np.ndarray, range_max_m: float) -> float:
    """Share of beams whose ranges would differ by more than noise and map explain."""
    a, b = np.minimum(a, range_max_m), np.minimum(b, range_max_m)
    return float(np.mean(np.abs(a - b) > 0.2 + 0.05 * np.minimum(a, b)))

"""Wheels that slip or spin: what they tell against what the scans say."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray
from slam.se2 import SE2, wrap_angle

_MATCH_SIGMA = np.array([0.01, 0.01, 0.01])
"""Chosen: of one match, x, y [m] and heading [rad], on the widest walls that wheels are checked by."""


@dataclass(frozen=True)
class SlipConfig:
    """When wheels slip.

    way_m: of such a way they are compared with the scans; anchors: poses on it, apart_m or apart_rad
    from one to the next, so that it is as long however slow the robot or fast the laser is.
    off_m, off_rad: by which the two may differ. max_nis: normalised innovation squared by the
    wheels' own noise that is no chance: 30 is exceeded once in a million. Chosen, all of these.
    """

    way_m: float = 0.5
    anchors: int = 10
    apart_m: float = 0.015
    apart_rad: float = math.radians(3.0)
    off_m: float = 0.05
    off_rad: float = math.radians(3.0)
    max_nis: float = 30.0


class SlipMonitor:
    """Compares what wheels and scans say of the last stretch of the way."""

    def __init__(self, config: SlipConfig | None = None) -> None:
        self.config = config or SlipConfig()
        self._way: deque[tuple[SE2, SE2, FloatArray]] = deque(maxlen=self.config.anchors)
        self._motion, self._noise = SE2.identity(), np.zeros((3, 3))

    def clear(self) -> None:
        """Forgets the way: after it no scan tells where the robot was."""
        self._way.clear()
        self._motion, self._noise = SE2.identity(), np.zeros((3, 3))

    def take(self, T_matched: SE2, told: SE2, noise: FloatArray) -> str:
        """That wheels and scans have gone different ways, in words; or nothing.

        T_matched: where the scan says the robot is. told: its motion since the last scan by the
        wheels, noise: (3, 3) of its tangent.
        """
        way, config = self._way, self.config
        if not way:
            way.append((T_matched, SE2.identity(), np.zeros((3, 3))))
            return ""
        self._motion, self._noise = self._motion @ told, self._noise + noise
        motion, bound = self._motion, self._noise + 2.0 * np.diag(np.square(_MATCH_SIGMA))
        went_m = math.hypot(motion.x, motion.y)
        T_then = way[-1][0]
        for k in range(len(way) - 1, 0, -1):
            if went_m > config.way_m:  # scans far apart: not the drift of ten metres
                break
            _, step, spread = way[k]
            motion, bound, T_then = step @ motion, bound + spread, way[k - 1][0]
            went_m += math.hypot(step.x, step.y)
        if not self._motion.is_near(SE2.identity(), config.apart_m, config.apart_rad):
            way.append((T_matched, self._motion, self._noise))
            self._motion, self._noise = SE2.identity(), np.zeros((3, 3))
        seen = T_then.inverse() @ T_matched
        off = (motion.inverse() @ seen).log()
        if math.hypot(off[0], off[1]) < config.off_m and abs(off[2]) < config.off_rad:
            return ""
        if float(off @ np.linalg.solve(bound, off)) < config.max_nis:
            return ""
        return _in_words(motion, seen)

    def is_moved(self, told: SE2, seen: SE2) -> bool:
        """Whether the robot moved as no slip of its wheels explains: something moved it.

        told, seen: the motion since the last scan, by the wheels and by the scan.
        """
        off = (told.inverse() @ seen).log()
        is_off = math.hypot(off[0], off[1]) > self.config.off_m or abs(off[2]) > self.config.off_rad
        return is_off and not self.of_one_step(told, seen)

    def of_one_step(self, told: SE2, seen: SE2) -> str:
        """That the robot moved less than its wheels, along the way they told, in words; or nothing.

        told, seen: the motion since the last scan, by the wheels and by the scan.
        """
        told_m = math.hypot(told.x, told.y)
        # the point of the way told that is nearest to where the scan says
        share = (told.x * seen.x + told.y * seen.y) / max(told_m * told_m, 1e-12)
        share = min(max(share, 0.0), 1.0)
        beside_m = math.hypot(seen.x - share * told.x, seen.y - share * told.y)
        turned, turn_told = wrap_angle(seen.theta), wrap_angle(told.theta)
        beyond_rad = max(turned - max(turn_told, 0.0), min(turn_told, 0.0) - turned, 0.0)
        if beside_m > self.config.off_m or beyond_rad > self.config.off_rad:
            return ""
        return _in_words(told, seen)


def _in_words(told: SE2, seen: SE2) -> str:
    return (
        f"wheels slip or spin: they told {math.hypot(told.x, told.y):.2f} m and"
        f" {math.degrees(told.theta):.0f} degrees, the scans {math.hypot(seen.x, seen.y):.2f} m and"
        f" {math.degrees(seen.theta):.0f} degrees"
    )

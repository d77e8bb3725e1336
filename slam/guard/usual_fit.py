"""What of a scan's fit is not as usual: for the map and the laser, and for the way so far."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from slam.beams import Beams
from slam.evidence import Evidence
from slam.guard.verdict_limits import VerdictLimits
from slam.in_steps import Steps, all_at_once
from slam.relocalization import Relocalizer
from slam.se2 import SE2

_MEMORY = 50
_LARGER = 1.5
"""Chosen: a laser whose sweeps differ by a few beams is learnt once; the stump of a first sweep, or
a fan of half the room, does not stand for the whole one."""


@dataclass(frozen=True)
class UsualFitConfig:
    """slack: by which a fit may be worse than usual. drop: of the share that fits, below its mean
    over the last scans, that is not usual where a map is poor. Chosen, both."""

    slack: float = 0.02
    drop: float = 0.15


class UsualFit:
    """Follows how well scans fit, and says what is unusual about one."""

    def __init__(self, relocalizer: Relocalizer, config: UsualFitConfig | None = None) -> None:
        self.config = config or UsualFitConfig()
        self._relocalizer = relocalizer
        self._limits: VerdictLimits | None = None
        self._learnt_of = (0, 0.0)
        self._beam_count = 0
        self._mean_inliers = 1.0
        self._taken = 0

    def beam_count(self, beams: Beams) -> int:
        """Of the laser: the most that a scan has had so far, this one among them."""
        self._beam_count = max(self._beam_count, len(beams))
        return self._beam_count

    def limits(self, beams: Beams) -> VerdictLimits:
        """What is usual on this map for the laser, by the largest of its scans so far."""
        return all_at_once(self.limits_in_steps(beams))

    def limits_in_steps(self, beams: Beams) -> Steps[VerdictLimits]:
        """The same, a piece at a time."""
        count, view_rad = self._learnt_of
        sees_rad = float(np.ptp(beams.angles_rad)) if len(beams) else 0.0
        is_larger = len(beams) > _LARGER * count or sees_rad > _LARGER * view_rad
        if self._limits is None or is_larger:
            self._limits = yield from VerdictLimits.usual_in_steps(self._relocalizer, beams)
            self._learnt_of = len(beams), sees_rad
        return self._limits

    def limits_here(self, beams: Beams) -> VerdictLimits:
        """The same, made wider where the map's scans have fitted less than it promised."""
        limits = self.limits(beams)
        if self._relocalizer.segment_map.is_exact:
            return limits  # a fault that lasts must not become usual
        usual = min(limits.usual_inlier_ratio, self._mean_inliers - self.config.drop)
        return replace(limits, usual_inlier_ratio=usual)

    def take(self, evidence: Evidence) -> None:
        """Learns from a scan where the robot is."""
        self._taken += 1
        share = 1.0 / min(self._taken, _MEMORY)
        self._mean_inliers += share * (evidence.inlier_ratio - self._mean_inliers)

    def misfits(self, evidence: Evidence, limits: VerdictLimits) -> tuple[str, ...]:
        """What is not as usual, in words."""
        slack, found = self.config.slack, []
        if evidence.inlier_ratio < limits.usual_inlier_ratio - slack:
            found.append(
                f"{100 * evidence.inlier_ratio:.0f} % of the beams fit the map,"
                f" usually {100 * limits.usual_inlier_ratio:.0f} % and more"
            )
        if evidence.violation_ratio > limits.usual_violation_ratio + slack:
            found.append(
                f"{100 * evidence.violation_ratio:.0f} % of the beams went through walls,"
                f" usually {100 * limits.usual_violation_ratio:.0f} % and less"
            )
        return tuple(found)

    def has_violations(self, evidence: Evidence, limits: VerdictLimits) -> bool:
        """Whether so many beams went through walls that a place is not to be believed."""
        if not self._relocalizer.segment_map.is_exact:
            return False
        return evidence.violation_ratio > 2.0 * limits.usual_violation_ratio + self.config.slack


class BestHere:
    """The last scan that a search of the map found to fit best where the robot believes to be.

    It is not searched for again before one fits so much worse (drop, a share of the beams), or the
    robot went so far (way_m).
    """

    def __init__(self, drop: float, way_m: float) -> None:
        self._drop, self._way_m = drop, way_m
        self._found: tuple[float, SE2] | None = None

    def take(self, inlier_ratio: float, T_map_base: SE2) -> None:
        """Notes what was found."""
        self._found = inlier_ratio, T_map_base

    def clear(self) -> None:
        """Forgets it: the robot is elsewhere."""
        self._found = None

    def holds(self, inlier_ratio: float, T_map_base: SE2) -> bool:
        """Whether it tells of a scan as well."""
        if self._found is None:
            return False
        then, T_then = self._found
        went_m = math.hypot(T_map_base.x - T_then.x, T_map_base.y - T_then.y)
        return inlier_ratio >= then - self._drop and went_m < self._way_m

"""What of a scan's fit is not as usual: for the map and the laser, and for the way so far."""

from __future__ import annotations

from dataclasses import dataclass, replace

from slam.beams import Beams
from slam.evidence import Evidence
from slam.relocalization import Relocalizer
from slam.verdict_limits import VerdictLimits

_MEMORY = 50


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
        self._mean_inliers = 1.0
        self._taken = 0

    def limits(self, beams: Beams) -> VerdictLimits:
        """What is usual on this map for the laser of the first scan."""
        if self._limits is None:
            self._limits = VerdictLimits.usual_for(self._relocalizer, beams)
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

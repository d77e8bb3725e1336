"""What a drive itself says against its map: long ways blind, scans that turn against the wheels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from slam.front_end import FrontEndStep, StepStatus
from slam.measurements import Measurement
from slam.se2 import SE2

_MIRRORED = -0.5
"""Turns by scans per turn by the wheels: 1 where both are right, -1 where one of them counts the
other way round. Chosen, as the turns [rad] that it takes to say so."""
_TURNED = 2.0 * math.pi


class DriveMonitor:
    """Follows what scans and wheels of one session tell, scan by scan.

    most_blind_m: by the wheels alone; after more, nobody knows how far these were off.
    """

    def __init__(self, most_blind_m: float) -> None:
        self._most_blind_m = most_blind_m
        self._turned_together = self._turned_by_wheels = 0.0
        self._unknown_m2 = 0.0

    def take(self, measurement: Measurement, T_before: SE2, step: FrontEndStep) -> None:
        """Notes a scan; T_before: where the front end had placed the one before it."""
        self._unknown_m2 += float(measurement.motion_covariance[0, 0])
        if _tells(step):
            self._unknown_m2 = 0.0
        if step.status in (StepStatus.MATCHED, StepStatus.SEARCHED):
            turn_rad = (T_before.inverse() @ step.T_map_base).theta
            self._turned_together += math.copysign(1.0, measurement.motion.theta) * turn_rad
            self._turned_by_wheels += abs(measurement.motion.theta)

    def objections(self, steps: Sequence[FrontEndStep]) -> list[str]:
        """In words, why the map of all these scans, of this session and those before, is no good."""
        said = blind_stretches(steps, self._most_blind_m)
        if self._unknown_m2 > self._most_blind_m**2:
            said.append("neither scans nor wheels tell where the robot is at the end")
        is_mirrored = self._turned_together < _MIRRORED * self._turned_by_wheels
        if is_mirrored and self._turned_by_wheels > _TURNED:
            said.append(
                "the scans turn the other way round than the wheels: the map may be mirrored"
                " (is the laser mounted upside down, or a wheel's sign wrong?)"
            )
        return said


def blind_stretches(steps: Sequence[FrontEndStep], most_blind_m: float) -> list[str]:
    """In words, where sessions began or ended blind for more than so far: the wheels alone say where
    the robot went. Between two scans that tell something the front end breaks off by itself."""
    said = []
    if steps and not any(step.is_keyframe for step in steps):
        said.append("no scan tells anything: there is nothing on the map")
    for session in sorted({step.session for step in steps}):
        own = [step for step in steps if step.session == session]
        tells = [_tells(step) for step in own]
        parts = [own]
        if any(tells):
            parts = [own[: tells.index(True) + 1], own[-1 - tells[::-1].index(True) :]]
        for part in parts:
            places = np.array([(step.T_map_base.x, step.T_map_base.y) for step in part])
            way_m = float(np.hypot(*np.diff(places, axis=0).T).sum())
            if way_m > most_blind_m:
                said.append(told_by_wheels_alone(part[0].time_s, part[-1].time_s, way_m))
    return said


def told_by_wheels_alone(from_s: float, to_s: float, way_m: float) -> str:
    """That no scan says where the robot was, in words."""
    return (
        f"from {from_s:.2f} to {to_s:.2f} s, over {way_m:.0f} m, no scan tells where the robot is:"
        " these poses are the wheels' alone"
    )


def _tells(step: FrontEndStep) -> bool:
    return step.is_keyframe or step.status is not StepStatus.CARRIED

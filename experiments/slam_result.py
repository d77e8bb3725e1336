"""What mapping a recorded log gave: its numbers, and what is said of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.evaluation import Evaluation
from experiments.slam_wheels import wheels_line
from slam.arrays import FloatArray
from slam.frontend.keyframes import StepStatus
from slam.loop_closing import without_ties
from slam.map_checks.range_offset import off_by
from slam.pose_lookup import PoseLookup
from slam.se2 import SE2
from slam.slam_map import SlamMap
from slam.trajectory import Trajectory

_FEW = 3
"""Reasons that are told of a map that failed; chosen: one whose units are wrong breaks off at each scan."""


@dataclass(frozen=True)
class SlamLog:
    """What mapping a log gave.

    trajectory: of every record, odometry alone too. online_cpu_s, finish_cpu_s: processor time of all
    updates, the reading of the log among them, and of the end; slowest_update_cpu_s: of one scan;
    warm_up_cpu_s: of loading compiled code before the first. memory_mb: by which the
    process had grown at most when the map was finished, None where the system does not tell.
    evaluation: against a reference, where there is one. reference: its poses as told. continued: name of the map that the log's
    session continued, None: of none; joined_at: the scan with which it was joined, from 1, None: with
    none, but at the end, if at all; start: pose of its first scan there as it was told, None: searched for.
    wheels: what calibrating them from the drive gave, where the log tells their ticks.
    is_odometry_doubted: whether odometry was taken for a guess alone, since the map by it as told did
    not hold together. range_offset_m: by which all ranges were taken to be too long, since a map by them as
    told had shown it; range_offset_sigma_m: standard deviation of that. notes: what of the log was taken, in words. used_pass: which pass over the log
    this is, from 0, where it was mapped more than once; other_passes_cpu_s: what the others took.
    """

    name: str
    slam_map: SlamMap
    trajectory: Trajectory
    online_cpu_s: float
    finish_cpu_s: float
    slowest_update_cpu_s: float
    warm_up_cpu_s: float
    memory_mb: float | None
    evaluation: Evaluation | None = None
    reference: Trajectory | None = None
    continued: str | None = None
    joined_at: int | None = None
    start: SE2 | None = None
    wheels: dict[str, Any] | None = None
    is_odometry_doubted: bool = False
    range_offset_m: float = 0.0
    range_offset_sigma_m: float = 0.0
    notes: tuple[str, ...] = ()
    used_pass: int = 0
    other_passes_cpu_s: float = 0.0

    @property
    def way_m(self) -> float:
        """Along the trajectory."""
        return float(np.hypot(*np.diff(self.trajectory.poses[:, :2], axis=0).T).sum())

    def reference_way(self) -> FloatArray | None:
        """(N, 2) the reference in the order of time, laid on the map as the ATE is taken, map frame [m];
        nan where the trajectory has no pose; None without any reference."""
        if self.reference is None or self.evaluation is None or self.evaluation.absolute is None:
            return None
        told = self.reference.in_order()
        T_map_reference = self.evaluation.absolute.T_true_estimated.inverse()
        poses = PoseLookup(self.trajectory).at(told.times_s)
        is_covered = np.isfinite(poses).all(axis=1, keepdims=True)
        return np.where(is_covered, T_map_reference @ told.poses[:, :2], math.nan)

    def summary(self) -> dict[str, Any]:
        """Plain numbers, for `summary.json`."""
        slam_map, verdict = self.slam_map, self.slam_map.verdict
        session = slam_map.session_count - 1
        counts = Counter(step.status.value for step in slam_map.steps if step.session == session)
        return {
            "experiment": "slam",
            "log": self.name,
            "verdict": "good" if verdict.is_good else "failed",
            "reasons": list(verdict.reasons),
            "continued": self.continued,
            "joined_at": self.joined_at,
            "start": None if self.start is None else self.start.as_array().tolist(),
            "sessions": [self._session(number) for number in range(slam_map.session_count)],
            "scans": counts.total(),
            **{status.value: counts[status.value] for status in StepStatus},
            "records": len(self.trajectory),
            "duration_s": float(np.ptp(self.trajectory.times_s)),
            "way_m": self.way_m,
            "keyframes": len(slam_map.keyframes),
            "loops": len(without_ties(slam_map.loops)),
            "loops_rejected": len(without_ties(slam_map.rejected)),
            "contradicted": verdict.passed_ratio,
            "drift_m": slam_map.drift_m if math.isfinite(slam_map.drift_m) else None,
            "cpu_s": {
                "online": self.online_cpu_s,
                "finish": self.finish_cpu_s,
                "slowest_update": self.slowest_update_cpu_s,
                "warm_up": self.warm_up_cpu_s,
                "other_passes": self.other_passes_cpu_s,
            },
            "memory_mb": self.memory_mb,
            "wheels": self.wheels,
            "odometry_doubted": self.is_odometry_doubted,
            "range_offset_m": self.range_offset_m,
            "range_offset_sigma_m": self.range_offset_sigma_m,
            "evaluation": None if self.evaluation is None else self.evaluation.summary(),
        }

    @property
    def said_of_map(self) -> str:
        """Whether the map is good, and why it is not; the first few reasons of many."""
        reasons = few_of(self.slam_map.verdict.reasons)
        return "FAILED: " + "; ".join(reasons) if reasons else "good"

    def _session(self, number: int) -> dict[str, Any]:
        """A session of the map, from 0."""
        times_s = self.slam_map.trajectory_of(number).times_s
        return {
            "scans": len(times_s),
            "from_s": float(times_s[0]) if len(times_s) else None,
            "to_s": float(times_s[-1]) if len(times_s) else None,
            "joined": number not in self.slam_map.unjoined,
        }


def few_of(reasons: Sequence[str]) -> list[str]:
    """As many reasons as one reads, and how many more there are."""
    if len(reasons) <= _FEW:
        return list(reasons)
    return [*reasons[: _FEW - 1], f"and {len(reasons) - _FEW + 1} more in summary.json"]


def _grown(memory_mb: float | None) -> str:
    """By how much memory grew, in words."""
    if memory_mb is None:
        return "memory grew by an unknown amount"
    return f"memory grew by {memory_mb:.0f} MB" if memory_mb >= 0.5 else "memory did not grow"


def _never_joined(is_start_told: bool) -> str:
    if is_start_told:
        return (
            "never joined (nothing that it saw confirms the --start that was told, which has to hold"
            " within half a metre: without it, the place is searched for)"
        )
    return "never joined (nothing that it saw was found on the map beyond doubt)"


def _said_of_map(summary: dict[str, Any]) -> list[str]:
    """What is wrong with a map; of a good one, how far it may have drifted."""
    drift_m = summary["drift_m"]
    if summary["reasons"] or drift_m is None or summary["keyframes"] < 2:
        return few_of(summary["reasons"])
    return [f"by its own account poses are off by some {drift_m:.2f} m (RMS)"]


def _of_what(summary: dict[str, Any]) -> tuple[str, str]:
    """What the map's numbers are of, and what the log's, where the map has more sessions than that of the log."""
    count = len(summary["sessions"])
    return (f" of {count} sessions", " of this session") if count > 1 else ("", "")


def table(summary: dict[str, Any]) -> str:
    """The summary for people to read."""
    cpu, (of_all, of_this) = summary["cpu_s"], _of_what(summary)
    lines = [
        f"{summary['log']}: {summary['scans']} scans, {summary['way_m']:.0f} m in"
        f" {summary['duration_s']:.0f} s",
        f"map{of_all}: {summary['verdict']}"
        + "".join(f"; {said}" for said in _said_of_map(summary)),
        f"on it: {summary['keyframes']} keyframes, {summary['loops']} loops"
        f" ({summary['loops_rejected']} rejected)",
        f"scans{of_this}: {summary['matched']} matched, {summary['searched']} found by search,"
        f" {summary['carried']} placed by no scan (the first one among them), {summary['broken']} broke"
        " off",
        f"CPU{of_this}: {cpu['online']:.1f} s online ({1000 * cpu['slowest_update']:.0f} ms at most for a"
        f" scan), {cpu['finish']:.1f} s to finish; {_grown(summary['memory_mb'])}",
    ]
    if summary["continued"] is not None:
        number, at = len(summary["sessions"]), summary["joined_at"]
        if not summary["sessions"][-1]["joined"]:
            joined = _never_joined(summary["start"] is not None)
        elif at is None:
            joined = "joined at its end"
        else:
            joined = f"joined at scan {at} of {summary['scans']}"
        lines.insert(1, f"session {number}, on {summary['continued']}: {joined}")
    if cpu["other_passes"] > 0.0:
        lines[-1] += f"; {cpu['other_passes']:.1f} s for another pass over the log"
    if summary["odometry_doubted"]:
        lines.append(
            "odometry: a guess alone; by it as the log tells it, the map did not hold together"
        )
    if summary["range_offset_m"] != 0.0:
        lines.append(
            f"ranges: {off_by(summary['range_offset_m'])} in the log (standard deviation"
            f" {summary['range_offset_sigma_m']:.3f} m), and put right where it was mapped once more: what"
            " else uses this laser has to be told"
        )
    if summary["wheels"] is not None:
        lines.append(wheels_line(summary["wheels"]))
    return "\n".join(lines)

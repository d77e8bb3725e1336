"""A recorded log mapped: trajectory, map, pose graph, and how far all of it is to be believed."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.evaluation import Evaluation, evaluated
from experiments.trial_log import write_atomically
from slam.front_end import StepStatus
from slam.map_files import write_map
from slam.mapping import Mapper, MapperStep
from slam.metrics import read_relations
from slam.pose_graph import write_g2o
from slam.pose_lookup import PoseLookup
from slam.readers.log import Log, MotionSinceScan
from slam.readers.recognition import read_log
from slam.slam_map import SlamMap
from slam.slam_map_files import write_slam_map
from slam.trajectory import Trajectory, read_tum, write_tum

OnScan = Callable[[int, int, MapperStep], None]


@dataclass(frozen=True)
class SlamLog:
    """What mapping a log gave.

    trajectory: of every record, odometry alone too. online_cpu_s, finish_cpu_s: processor time of all
    updates, the reading of the log among them, and of the end; slowest_update_cpu_s: of one scan.
    evaluation: against a reference, where there is one.
    """

    name: str
    slam_map: SlamMap
    trajectory: Trajectory
    online_cpu_s: float
    finish_cpu_s: float
    slowest_update_cpu_s: float
    evaluation: Evaluation | None = None

    @property
    def way_m(self) -> float:
        """Along the trajectory."""
        return float(np.hypot(*np.diff(self.trajectory.poses[:, :2], axis=0).T).sum())

    def summary(self) -> dict[str, Any]:
        """Plain numbers, for `summary.json`."""
        slam_map, verdict = self.slam_map, self.slam_map.verdict
        counts = Counter(step.status.value for step in slam_map.steps)
        return {
            "experiment": "slam",
            "log": self.name,
            "verdict": "good" if verdict.is_good else "failed",
            "reasons": list(verdict.reasons),
            "scans": len(slam_map.steps),
            **{status.value: counts[status.value] for status in StepStatus},
            "records": len(self.trajectory),
            "duration_s": float(np.ptp(self.trajectory.times_s)),
            "way_m": self.way_m,
            "keyframes": len(slam_map.keyframes),
            "loops": len(slam_map.loops),
            "loops_rejected": len(slam_map.rejected),
            "contradicted": verdict.passed_ratio,
            "cpu_s": {
                "online": self.online_cpu_s,
                "finish": self.finish_cpu_s,
                "slowest_update": self.slowest_update_cpu_s,
            },
            "evaluation": None if self.evaluation is None else self.evaluation.summary(),
        }


def run(
    log_path: Path,
    reference: Path | None = None,
    relations: Path | None = None,
    on_scan: OnScan | None = None,
) -> SlamLog:
    """Maps a log, with one set of parameters for all.

    on_scan: told of each scan's number, how many there are, and its step. Raises ValueError for
    files that are not what they should be, OSError for unreadable ones.
    """
    # refused now rather than after the log
    against = None if reference is None else read_tum(reference)
    related = None if relations is None else read_relations(relations)
    log = read_log(log_path)
    mapper, index, slowest_s = Mapper(log.T_base_laser), 0, 0.0
    started_s = time.process_time()
    motion = MotionSinceScan(log.noise)
    times_s, odometry, scan_rows = [], [], []
    for row, record in enumerate(log.records):
        times_s.append(record.time_s)
        odometry.append(record.T_odom_base.as_array())
        measurement = motion.add(record)
        if measurement is None:
            continue
        update_s = time.process_time()
        step = mapper.update(measurement)
        slowest_s = max(slowest_s, time.process_time() - update_s)
        scan_rows.append(row)
        if on_scan is not None:
            on_scan(index, log.scan_count, step)
        index += 1
    online_s = time.process_time() - started_s
    slam_map = mapper.finish()
    finish_s = time.process_time() - started_s - online_s
    trajectory = _of_records(
        log, np.array(times_s), np.array(odometry), np.array(scan_rows), slam_map.trajectory
    )
    evaluation = None
    if against is not None or related is not None:
        name = None if relations is None else relations.name
        evaluation = evaluated(trajectory, against, related, relations_of=name)
    return SlamLog(log.name, slam_map, trajectory, online_s, finish_s, slowest_s, evaluation)


def _of_records(
    log: Log,
    times_s: np.ndarray,
    odometry: np.ndarray,
    scan_rows: np.ndarray,
    of_scans: Trajectory,
) -> Trajectory:
    """The pose of every record from the first scan to the last; of scans alone without odometry."""
    if not log.has_odometry:
        return of_scans
    # by the rows of the log: stamps may go back
    rows = np.arange(len(times_s), dtype=np.float64)
    lookup = PoseLookup(
        Trajectory(scan_rows.astype(np.float64), of_scans.poses), Trajectory(rows, odometry),
        max_gap_s=float(len(times_s)),
    )  # fmt: skip
    poses = lookup.at(rows)
    is_placed = np.isfinite(poses).all(axis=1)
    return Trajectory(times_s[is_placed], poses[is_placed])


def write_results(result: SlamLog, folder: Path) -> None:
    """Writes summary.json, trajectory.tum, pose_graph.g2o, map.kitasap, map.yaml, map.pgm.

    Raises OSError if it cannot.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_tum(folder / "trajectory.tum", result.trajectory)
    write_g2o(folder / "pose_graph.g2o", result.slam_map.graph)
    write_slam_map(folder / "map.kitasap", result.slam_map)
    write_map(folder / "map.yaml", result.slam_map.grid())
    write_atomically(folder / "summary.json", json.dumps(result.summary(), indent=2) + "\n")


def table(summary: dict[str, Any]) -> str:
    """The summary for people to read."""
    cpu = summary["cpu_s"]
    lines = [
        f"{summary['log']}: {summary['scans']} scans, {summary['way_m']:.0f} m in"
        f" {summary['duration_s']:.0f} s; {summary['keyframes']} keyframes, {summary['loops']} loops"
        f" ({summary['loops_rejected']} rejected)",
        f"map: {summary['verdict']}" + "".join(f"; {reason}" for reason in summary["reasons"]),
        f"scans: {summary['matched']} matched, {summary['searched']} found by search,"
        f" {summary['carried']} by the wheels alone, {summary['broken']} broke off",
        f"CPU: {cpu['online']:.1f} s online ({1000 * cpu['slowest_update']:.0f} ms at most for a"
        f" scan), {cpu['finish']:.1f} s to finish",
    ]
    return "\n".join(lines)

"""Localisation on real logs: the odd scans, on the map that the even ones make.

The reference poses of every second scan make the point map. The scans between are then localised
by the same `Localizer` as the simulated robot, from odometry alone: its first pose is the
reference's, later the reference only judges.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.known_maps import LogConfig, points_of_scans
from experiments.protocols import DEFAULT_METHOD
from experiments.reference_files import read_reference
from experiments.trial_log import write_atomically
from slam.arrays import BoolArray, FloatArray
from slam.icp import CoarseToFineConfig
from slam.known_map import KnownMap
from slam.localization import Estimate, Localizer
from slam.measurements import Measurement
from slam.metrics import pose_errors
from slam.odometry import compose_covariance
from slam.readers.carmen import CarmenConfig, read_carmen
from slam.readers.log import Log
from slam.se2 import SE2
from slam.trajectory import Trajectory, write_tum

# A scan that is farther off than this, yet called matched, was lost silently.
LOST_POSITION_M = 0.5
LOST_HEADING_RAD = math.radians(10.0)

# Stamps are written with six decimals in both files.
_SAME_STAMP_S = 1e-4
# Finer than where whole maps are searched: what is known of these logs was measured with it.
_SURFEL_CELL_M = 0.02


@dataclass(frozen=True)
class RealLogConfig(LogConfig):
    """What the trial needs to know beside what is assumed of every log.

    map_spacing_m: chosen: about the error of a reference pose; finer would store the same wall
    several times.
    """

    method: str = DEFAULT_METHOD["real-log"]
    map_spacing_m: float = 0.05
    carmen: CarmenConfig = field(default_factory=CarmenConfig)
    matching: CoarseToFineConfig = field(default_factory=CoarseToFineConfig)


@dataclass(frozen=True)
class RealLogResult:
    """The estimates of the odd scans, in order, with their reference poses (N, 3).

    map_points: (K, 2) of the map that the even scans made [m].
    """

    name: str
    config: RealLogConfig
    map_points: FloatArray
    estimates: tuple[Estimate, ...]
    reference: FloatArray

    def trajectory(self) -> Trajectory:
        """The poses reported."""
        return Trajectory(
            np.array([estimate.time_s for estimate in self.estimates]),
            np.array([estimate.T_map_base.as_array() for estimate in self.estimates]),
        )

    @property
    def is_told(self) -> BoolArray:
        """(N,) whether the scan was called unsure or lost."""
        return np.array([not estimate.is_matched for estimate in self.estimates], dtype=bool)

    @property
    def is_believed_wrongly(self) -> BoolArray:
        """(N,) whether its pose was believed, far off the reference."""
        position_m, heading_rad = self._errors()
        is_off = (position_m > LOST_POSITION_M) | (heading_rad > LOST_HEADING_RAD)
        return ~self.is_told & is_off

    def _errors(self) -> tuple[FloatArray, FloatArray]:
        """(N,) how far [m] and how much turned [rad] each is off the reference."""
        errors = np.abs(pose_errors(self.trajectory().poses, self.reference))
        return np.hypot(errors[:, 0], errors[:, 1]), errors[:, 2]

    def summary(self) -> dict[str, Any]:
        """Counts, and the errors against the reference over all scans, matched or not."""
        position_m, heading_rad = self._errors()
        is_told, is_believed_wrongly = self.is_told, self.is_believed_wrongly
        return {
            "experiment": "real_logs",
            "log": self.name,
            "method": self.config.method,
            "scans": len(self.estimates),
            "tracked": int(np.sum(~is_told & ~is_believed_wrongly)),
            "lost_said": int(np.sum(is_told)),
            "lost_silently": int(np.sum(is_believed_wrongly)),
            "position_error_m": _percentiles(position_m),
            "heading_error_deg": _percentiles(np.degrees(heading_rad)),
            "map_points": len(self.map_points),
            "config": asdict(self.config),
        }


def run(
    log_path: str | Path,
    reference_path: str | Path,
    config: RealLogConfig | None = None,
    on_scan: Callable[[int, int, Estimate], None] | None = None,
) -> RealLogResult:
    """The odd scans of a CARMEN log localised on the map of the even ones.

    on_scan: told of each, with its number and how many there are.

    Only scans that have a reference pose (by stamp) count; the motion over others is composed.
    Raises ValueError for files that are not what they should be, OSError for unreadable ones.
    """
    config = config or RealLogConfig()
    log, reference = read_carmen(log_path, config.carmen), read_reference(Path(reference_path))
    log.check_sees()
    rows = list(referenced(log, reference, config.range_max_m))
    if len(rows) < 2:
        raise ValueError(
            f"{log.told_as}: {len(rows)} of {log.scan_count} scans have a pose of the same"
            f" stamp in {reference_path}; the trial needs at least two"
        )
    points = points_of_scans(rows[::2], log.T_base_laser, config.map_spacing_m)
    known = KnownMap(
        points, config.laser, spacing_m=config.map_spacing_m, surfel_cell_m=_SURFEL_CELL_M
    )
    odd = list(joined_pairwise(rows))
    # The first odd scan starts at its reference: its own motion is undone beforehand.
    start = odd[0][1] @ odd[0][0].motion.inverse()
    localizer = Localizer(known.matcher(config.method, config.matching), start, log.T_base_laser)
    estimates: list[Estimate] = []
    for index, (measurement, _) in enumerate(odd):
        estimates.append(localizer.update(measurement))
        if on_scan is not None:
            on_scan(index, len(odd), estimates[-1])
    poses = np.array([T_reference.as_array() for _, T_reference in odd])
    return RealLogResult(log.name, config, points, tuple(estimates), poses)


def referenced(
    log: Log, reference: Trajectory, range_max_m: float
) -> Iterator[tuple[Measurement, SE2]]:
    """The measurements whose stamps have a reference pose, with that pose, ranges cut.

    Scans without one are passed over; their motion goes into that of the next.
    """
    order = np.argsort(reference.times_s, kind="stable")
    times_s = reference.times_s[order]
    passed_over: list[Measurement] = []
    for measurement in log.measurements():
        passed_over.append(measurement)
        place = int(np.searchsorted(times_s, measurement.time_s - _SAME_STAMP_S))
        if place < len(times_s) and times_s[place] <= measurement.time_s + _SAME_STAMP_S:
            joined = join(passed_over)
            cut = replace(joined, scan=joined.scan.cut(range_max_m))
            yield cut, SE2.from_array(reference.poses[order[place]])
            passed_over = []


def joined_pairwise(
    rows: Sequence[tuple[Measurement, SE2]],
) -> Iterator[tuple[Measurement, SE2]]:
    """The odd rows, each with the motion since the odd row before."""
    for i in range(1, len(rows), 2):
        yield join([rows[i - 1][0], rows[i][0]]), rows[i][1]


def join(measurements: Iterable[Measurement]) -> Measurement:
    """The last measurement, with the motion and covariance over all of them."""
    first, *others = measurements
    motion, covariance, last = first.motion, first.motion_covariance, first
    for last in others:
        covariance = compose_covariance(covariance, last.motion, last.motion_covariance)
        motion = motion @ last.motion
    return Measurement(last.time_s, motion, last.scan, covariance)


def write_results(result: RealLogResult, folder: Path) -> None:
    """Writes summary.json and trajectory.tum into a folder that has none of them, or where they are
    written over: see `results_together`. Raises OSError when the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_tum(folder / "trajectory.tum", result.trajectory())
    write_atomically(folder / "summary.json", json.dumps(result.summary(), indent=2) + "\n")


def table(summary: dict[str, Any]) -> str:
    """The summary for people to read."""
    position, heading = summary["position_error_m"], summary["heading_error_deg"]
    return "\n".join(
        [
            f"{summary['log']}: {summary['scans']} odd scans on the map of the even ones"
            f" ({summary['map_points']} points), method {summary['method']}",
            f"  tracked {summary['tracked']}, unsure or lost, and said so, {summary['lost_said']},"
            f" lost silently {summary['lost_silently']}",
            "  error against the reference   median      p95      max",
            f"    position [m]             {_columns(position)}",
            f"    heading [deg]            {_columns(heading)}",
        ]
    )


def main(arguments: Sequence[str]) -> int:
    """What `python -m experiments.real_logs` does: `kitasap real-log`; the exit status."""
    from experiments.cli import main as kitasap

    return kitasap(["real-log", *arguments])


def _percentiles(values: FloatArray) -> dict[str, float]:
    median, p95, largest = np.percentile(values, [50.0, 95.0, 100.0])
    return {"median": float(median), "p95": float(p95), "max": float(largest)}


def _columns(values: dict[str, float]) -> str:
    return " ".join(f"{values[name]:8.3f}" for name in ("median", "p95", "max"))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

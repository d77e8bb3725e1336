"""Recorded logs with no idea of the start: scans asked one by one, or a robot that is teleported.

`each`: the even scans' reference poses make the map; each odd scan is asked for its pose with no
prior. `jumps`: the first half makes the map; the second half is cut into pieces that are put in
another order, so that the robot is somewhere else from one scan to the next, the wheels silent.
"""

from __future__ import annotations

import itertools
import json
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.known_maps import map_of_scans
from experiments.protocols import PROTOCOLS
from experiments.real_logs import RealLogConfig, referenced
from experiments.reference_files import read_reference
from experiments.trial_log import write_atomically
from slam.guard.guard_config import GuardConfig
from slam.guard.hypotheses_config import HypothesesConfig
from slam.known_map import KnownMap
from slam.localization import Estimate, Localizer
from slam.measurements import Measurement
from slam.readers.carmen import read_carmen
from slam.se2 import SE2, wrap_angle
from slam.verdict import Status

RIGHT_M, RIGHT_RAD = 0.15, math.radians(3.0)
"""As far off a reference as a pose found on a map may be: both are other methods' results."""
WRONG_M, WRONG_RAD = 0.5, math.radians(10.0)
"""Another place, whatever the reference's own error."""
_NOTICED_WITHIN = 2
_JUMP_S = 1.0
"""How long the robot is carried. chosen: what it says after that may not hang on it."""
_COVERED_M, _COVERED_SHARE = 0.3, 0.6
"""A scan lies on the map where so many of its points are so near to a point of it."""

Rows = Sequence[tuple[Measurement, SE2]]
OnScan = Callable[[int, int], None]


@dataclass(frozen=True)
class Asked:
    """One scan: where it was taken, what was said, and the CPU time of it [s]."""

    estimate: Estimate
    T_reference: SE2
    cpu_s: float
    is_covered: bool

    @property
    def error(self) -> tuple[float, float]:
        """Distance [m] and turn [rad] from the reference."""
        found, true = self.estimate.T_map_base, self.T_reference
        off_m = math.hypot(found.x - true.x, found.y - true.y)
        return off_m, abs(wrap_angle(found.theta - true.theta))

    @property
    def is_right(self) -> bool:
        """Whether the pose is the reference's, within what maps and references leave open."""
        return self.error[0] <= RIGHT_M and self.error[1] <= RIGHT_RAD

    @property
    def is_elsewhere(self) -> bool:
        """Whether the pose is of another place."""
        return self.error[0] > WRONG_M or self.error[1] > WRONG_RAD

    @property
    def is_sure(self) -> bool:
        """Whether it is believed."""
        return self.estimate.verdict.status is Status.TRACKING

    def record(self) -> dict[str, Any]:
        """As plain numbers."""
        return {
            "time_s": self.estimate.time_s,
            "status": self.estimate.verdict.status.value,
            "reasons": list(self.estimate.verdict.reasons),
            "error_m": self.error[0],
            "error_rad": self.error[1],
            "is_covered": self.is_covered,
        }


@dataclass(frozen=True)
class Relocalized:
    """All scans asked, in order. jumps: numbers of the scans before which the robot was moved."""

    name: str
    protocol: str
    config: RealLogConfig
    known: KnownMap
    asked: tuple[Asked, ...]
    jumps: tuple[int, ...] = field(default=())

    def summary(self) -> dict[str, Any]:
        """Counts."""
        asked = self.asked
        sure = [one for one in asked if one.is_sure]
        cpu_ms = 1000.0 * np.array([one.cpu_s for one in asked])
        summary: dict[str, Any] = {
            "experiment": f"real_relocalization_{self.protocol}",
            "log": self.name,
            "method": self.config.method,
            "scans": len(asked),
            "right": sum(one.is_right for one in asked),
            "sure": len(sure),
            "sure_not_right": sum(not one.is_right for one in sure),
            "sure_elsewhere": sum(one.is_elsewhere for one in sure),
            "covered": sum(one.is_covered for one in asked),
            "query_cpu_ms": {
                "median": float(np.median(cpu_ms)),
                "p99": float(np.percentile(cpu_ms, 99.0)),
            },
        }
        if self.jumps:
            summary |= self._of_jumps()
        return summary

    def _of_jumps(self) -> dict[str, Any]:
        """Which jumps were noticed, and after how many scans the robot had found itself."""
        noticed, took, lost_for_good = 0, [], 0
        ends = [*self.jumps[1:], len(self.asked)]
        for start, end in zip(self.jumps, ends, strict=True):
            piece = self.asked[start:end]
            noticed += any(
                not one.is_sure or not one.is_elsewhere for one in piece[:_NOTICED_WITHIN]
            )
            found = [n for n, one in enumerate(piece) if one.is_sure and not one.is_elsewhere]
            if found:
                took.append(found[0] + 1)
            elif sum(one.is_covered for one in piece) > len(piece) / 2:
                lost_for_good += 1
        return {
            "jumps": len(self.jumps),
            "noticed": noticed,
            "recovered": len(took),
            "not_recovered_on_the_map": lost_for_good,
            "scans_to_recover": {"median": float(np.median(took or [0])), "max": max(took or [0])},
        }


def run(
    log_path: Path,
    reference_path: Path,
    protocol: str,
    config: RealLogConfig | None = None,
    jumps: int = 10,
    seed: int = 0,
    on_scan: OnScan | None = None,
) -> Relocalized:
    """A log asked by a protocol, `each` or `jumps`.

    on_scan: told of each scan, with its number and how many there are. Raises ValueError for a
    protocol that is unknown, files that are not what they should be, OSError for unreadable ones.
    """
    config = config or RealLogConfig()
    if protocol not in ("each", "jumps"):
        raise ValueError(f"no protocol called '{protocol}'; there are: {', '.join(PROTOCOLS)}")
    log, reference = read_carmen(log_path, config.carmen), read_reference(reference_path)
    log.check_sees()
    rows = list(referenced(log, reference, config.range_max_m))
    # of each piece of the half that is driven, two scans at least
    needed = 2 if protocol == "each" else 4 * (jumps + 1)
    if len(rows) < needed:
        raise ValueError(
            f"{log.told_as}: {len(rows)} scans have a reference pose in {reference_path}, this"
            f" needs {needed}"
        )
    mount = log.T_base_laser
    starts: tuple[int, ...] = ()
    if protocol == "each":
        of_map, order = rows[::2], rows[1::2]
    else:
        half = len(rows) // 2
        of_map = rows[:half]
        order, starts = teleported(rows[half:], jumps, np.random.default_rng(seed))
    known = map_of_scans(of_map, mount, config.map_spacing_m, config.laser)
    if protocol == "each":
        localizers = _new_localizers(known, mount, config.method)
    else:
        localizers = itertools.repeat(known.localizer(config.method, None, mount))
    # compiled, or loaded, before the first query is timed: a search, and a scan that follows
    unheard = known.localizer(config.method, None, mount)
    for measurement, _ in order[:2]:
        unheard.update(measurement)
    asked = []
    for index, (row, localizer) in enumerate(zip(order, localizers, strict=False)):
        asked.append(_asked(known, localizer, *row))
        if on_scan is not None:
            on_scan(index, len(order))
    return Relocalized(log.name, protocol, config, known, tuple(asked), starts)


def teleported(
    rows: Rows, jumps: int, rng: np.random.Generator
) -> tuple[list[tuple[Measurement, SE2]], tuple[int, ...]]:
    """The rows cut into pieces in another order; the wheels tell nothing of the way between.

    The stamps start at 0; a jump takes a second, all else as long as it did. Returns the numbers
    of the scans that come first after a jump as well. Raises ValueError for fewer rows than pieces.
    """
    if len(rows) <= jumps:
        raise ValueError(f"{len(rows)} scans cannot be cut into {jumps + 1} pieces")
    pieces = np.array_split(np.arange(len(rows)), jumps + 1)
    order = rng.permutation(len(pieces))
    while any(b == a + 1 for a, b in itertools.pairwise(order)):
        order = rng.permutation(len(pieces))
    mixed: list[tuple[Measurement, SE2]] = []
    starts, time_s = [], -_JUMP_S
    for place in order:
        starts.append(len(mixed))
        for n, row in enumerate(pieces[place]):
            measurement, T_reference = rows[row]
            if n == 0:
                time_s += _JUMP_S
                measurement = replace(
                    measurement, motion=SE2.identity(), motion_covariance=np.zeros((3, 3))
                )
            else:
                # the stamps of some logs go back
                time_s += max(measurement.time_s - rows[row - 1][0].time_s, 0.0)
            mixed.append((replace(measurement, time_s=time_s), T_reference))
    return mixed, tuple(starts[1:])


def _new_localizers(known: KnownMap, T_base_laser: SE2, method: str) -> Iterator[Localizer]:
    """Localizers without an end, each of which knows nothing."""
    usual = HypothesesConfig.fit_for(known.walls)
    of_one_scan = GuardConfig(hypotheses=replace(usual, min_views=1))
    while True:
        yield known.localizer(method, None, T_base_laser, of_one_scan)


def _asked(
    known: KnownMap, localizer: Localizer, measurement: Measurement, T_reference: SE2
) -> Asked:
    started_s = time.process_time()
    estimate = localizer.update(measurement)
    cpu_s = time.process_time() - started_s
    points = T_reference @ measurement.scan.points(localizer.T_base_laser)
    near = known.point_map.nearest(points, _COVERED_M)
    is_covered = len(points) > 0 and len(near) > _COVERED_SHARE * len(points)
    return Asked(estimate, T_reference, cpu_s, is_covered)


def write_results(result: Relocalized, folder: Path) -> None:
    """Writes summary.json, and asked.jsonl, a line for each scan, into a folder that has none of them,
    or where they are written over: see `results_together`. Raises OSError if it cannot.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lines = "".join(json.dumps(one.record()) + "\n" for one in result.asked)
    write_atomically(folder / "asked.jsonl", lines)
    write_atomically(folder / "summary.json", json.dumps(result.summary(), indent=2) + "\n")


def table(summary: dict[str, Any]) -> str:
    """The summary for people to read."""
    scans, cpu = summary["scans"], summary["query_cpu_ms"]
    lines = [
        f"{summary['log']}, method {summary['method']}: {scans} scans,"
        f" {summary['covered']} of them on the map",
        f"  within 15 cm and 3 degrees of the reference: {summary['right']}"
        f" ({summary['right'] / scans:.1%})",
        f"  sure {summary['sure']} ({summary['sure'] / scans:.1%}), of these not within that"
        f" {summary['sure_not_right']}, at another place {summary['sure_elsewhere']}",
        f"  CPU time of a query {cpu['median']:.0f} ms in the median, {cpu['p99']:.0f} ms at p99",
    ]
    if "jumps" in summary:
        took = summary["scans_to_recover"]
        lines.append(
            f"  {summary['jumps']} jumps: {summary['noticed']} noticed within two scans,"
            f" {summary['recovered']} recovered, in {took['median']:.0f} scans, {took['max']} at"
            f" most; {summary['not_recovered_on_the_map']} not recovered though on the map"
        )
    return "\n".join(lines)

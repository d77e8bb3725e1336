"""Whether changed logs end in a right map, or in one that is called failed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.bench.log_changes import Change
from experiments.bench.map_end import MOST_M, MOST_RMSE_M, MapEnd, table_of
from experiments.evaluation import evaluated
from experiments.progress import CountProgress
from experiments.reference_files import read_reference
from experiments.slam_log import check_same_time, default_mapped
from experiments.tables import wide_console
from slam.readers.log import Log
from slam.readers.recognition import read_log
from slam.trajectory import Trajectory

_CAPTION = (
    f"Position error of the scans against the reference; right: at most {MOST_RMSE_M:g} m"
    f" (RMS) and below {MOST_M:g} m."
)


@dataclass(frozen=True)
class Case:
    """One way to change a log, in words, and where its scans were taken."""

    of: str
    change: Change
    against: Trajectory


def read_referenced(log_path: Path, reference: Path) -> tuple[Log, Trajectory]:
    """A log and where its scans were taken. Raises ValueError for files that are not that."""
    against, log = read_reference(reference), read_log(log_path)
    log.check_sees()
    check_same_time(log, against.times_s, reference)
    return log, against


def print_ends(
    log: Log,
    against: Trajectory,
    cases: Sequence[Case],
    repeats: int,
    seed: int,
    bench: str,
    title: str,
) -> bool:
    """Changes, maps and prints the table; whether no wrong map was called good. bench: its name."""
    found = measured(log, against, cases, repeats, seed, bench)
    wide_console().print(table_of(found, bench, title, _CAPTION))
    return not any(one.is_deceptive for one in found)


def measured(
    log: Log, against: Trajectory, cases: Sequence[Case], repeats: int, seed: int, bench: str
) -> list[MapEnd]:
    """Each case, drawn anew in each repeat; the log as it is first."""
    found = [_ended(log, against, "none")]
    with CountProgress(bench, len(cases) * repeats) as progress:
        for children in np.random.SeedSequence(seed).spawn(repeats):
            for case, own in zip(cases, children.spawn(len(cases)), strict=True):
                changed = case.change(log, np.random.default_rng(own))
                found.append(_ended(changed, case.against, case.of))
                progress.update(len(found) - 1, case.of)
    return found


def _ended(log: Log, against: Trajectory, of: str) -> MapEnd:
    """How the log is mapped, by the one set of parameters."""
    slam_map = default_mapped(log).slam_map
    absolute = evaluated(slam_map.trajectory, against).absolute
    assert absolute is not None
    return MapEnd.judged(of, slam_map, absolute.position_m, MOST_RMSE_M, MOST_M)

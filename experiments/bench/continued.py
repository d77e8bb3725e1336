"""`kitasap bench continued LOG`: its second half on the first half's map, beside the log in one go."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

from rich.table import Table

from experiments.evaluation import Evaluation, evaluated
from experiments.reference_files import read_reference, read_related
from experiments.slam_log import check_same_time, default_mapped
from experiments.tables import wide_console
from slam.files.slam_map_files import read_slam_map, write_slam_map
from slam.metrics import Relations
from slam.readers.log import Log, LogRecords
from slam.readers.log_record import LogRecord
from slam.readers.recognition import read_log
from slam.trajectory import Trajectory


@dataclass(frozen=True)
class Continued:
    """A log in one go and in two sessions. Both judged by the poses of their scans, all of them.

    joined_at: scan of the second session, from 1, with which it was joined; None: never.
    is_same_again: the map of the first half read and written once more has the same bytes.
    """

    whole: Evaluation
    halves: Evaluation
    joined_at: int | None
    scans: int
    is_same_again: bool
    reasons: tuple[str, ...]

    def record(self) -> dict[str, Any]:
        """The same as plain numbers; either map's errors as in `evaluation.json`."""
        return {
            "scans": self.scans,
            "joined_at": self.joined_at,
            "verdict": "failed" if self.reasons else "good",
            "reasons": list(self.reasons),
            "same_bytes_again": self.is_same_again,
            "in_one_go": self.whole.summary(),
            "in_two_sessions": self.halves.summary(),
        }


def print_benchmark(
    log_path: Path, reference: Path, relations: Path | None, out: Path | None
) -> bool:
    """Maps, prints the table, and writes it as JSON where asked; whether the second half was joined,
    and the map is called good.

    Raises ValueError for files that are not what they should be, or a log of one scan.
    """
    against, log = read_reference(reference), read_log(log_path)
    related = None if relations is None else read_related(relations)
    log.check_sees()
    check_same_time(log, against.times_s, reference)
    if log.scan_count < 2:
        raise ValueError(f"{log_path}: expected two scans and more, one for each half")
    found = measured(log, against, related, None if relations is None else relations.name)
    wide_console().print(_table(log.name, found))
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(json.dumps({"log": log.name, **found.record()}, indent=2) + "\n")
    return found.joined_at is not None and not found.reasons


def measured(
    log: Log,
    against: Trajectory,
    related: Relations | None = None,
    relations_of: str | None = None,
) -> Continued:
    """Maps the log whole, and in halves with a file in between. relations_of: their file's name."""
    first, second = halves(log)
    whole = default_mapped(log).slam_map
    with tempfile.TemporaryDirectory() as folder:
        path, again = Path(folder) / "first.kitasap", Path(folder) / "again.kitasap"
        write_slam_map(path, default_mapped(first).slam_map)
        known = read_slam_map(path)
        write_slam_map(again, known)
        is_same_again = path.read_bytes() == again.read_bytes()
    continued = default_mapped(second, known)
    both = continued.slam_map
    in_one_go, in_two = (
        evaluated(one.trajectory, against, related, relations_of=relations_of)
        for one in (whole, both)
    )
    return Continued(
        in_one_go, in_two, continued.joined_at, second.scan_count, is_same_again, both.verdict.reasons,
    )  # fmt: skip


def halves(log: Log) -> tuple[Log, Log]:
    """The log cut before the scan in its middle."""
    count = log.scan_count // 2
    row = _row_of_scan(log.records, count)
    parts = (0, row, count), (row, len(log.records), log.scan_count - count)
    first, second = (_part(log, start, stop, scans) for start, stop, scans in parts)
    return first, second


def _part(log: Log, start: int, stop: int, scan_count: int) -> Log:
    records = LogRecords(stop - start, lambda: islice(log.records, start, stop))
    return replace(log, records=records, scan_count=scan_count)


def _row_of_scan(records: Iterable[LogRecord], number: int) -> int:
    rows: Iterator[int] = (row for row, record in enumerate(records) if record.scan is not None)
    return next(islice(rows, number, None))


def _table(name: str, found: Continued) -> Table:
    joined = "never joined" if found.joined_at is None else f"joined with scan {found.joined_at}"
    called = "good" if not found.reasons else f"failed: {found.reasons[0]}"
    same = "has the same bytes" if found.is_same_again else "has OTHER bytes"
    table = Table(
        title=f"{name}, its second half on the map that the first one left",
        caption=f"{joined} of {found.scans}, start unknown; the map is called {called}. The first"
        f" half's map read and written again {same}.",
    )
    for column in (
        "poses of the scans",
        "relations: mean and spread, most",
        "rotation",
        "ATE, most",
    ):
        table.add_column(column, justify="left" if column.startswith("poses") else "right")
    for words, one in (("in one go", found.whole), ("in two sessions", found.halves)):
        assert one.absolute is not None
        position_m, errors = one.absolute.position_m, one.relations["all"].errors
        moved_m, turned_rad = errors.translation_m, errors.rotation_rad
        table.add_row(
            words, f"{moved_m.mean:.4f} +- {moved_m.std:.4f} m, {moved_m.max:.2f} m",
            f"{math.degrees(turned_rad.mean):.3f} degrees",
            f"{position_m.rmse:.3f} m, {position_m.max:.2f} m",
        )  # fmt: skip
    return table

"""The log of a run's trials on disk: a line each, appended as it finishes; nothing is lost.

`trials.jsonl` is what a run resumes from. `timings.jsonl` beside it has what differs from one
repetition to the next, so that the log itself is the same to the byte, and of each line a checksum.
"""

import csv
import io
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from experiments.json_lines import CHECKSUM, TrialLines, checksum, replaced

CSV_FIELDS = (
    *("index", "status", "method", "match", "success"),
    *("x_error_m", "y_error_m", "theta_error_rad"),
    *("x_m", "y_m", "theta_rad", "x_true_m", "y_true_m", "theta_true_rad"),
    *("iterations", "error_m2", "pair_count", "nees"),
    *("time_s", "crlb_position_m", "crlb_heading_rad", "people_in_view", "error"),
)

MAP_FIELDS = (
    *("ate_m", "ate_max_m", "map_rmse_m", "map_precision", "map_recall", "map_points"),
    *("keyframes", "loops", "loops_rejected", "people", "scans", "way_m"),
)
"""Columns more, of mapping trials."""


class TrialLog:
    """The trials of one run in one folder, by their index; `trials` and `timings` are their lines.

    is_kept: nothing of the folder is changed. mended: what a crash had left and was cut off.
    Raises ValueError if the folder already holds trials of another configuration.
    """

    def __init__(
        self, folder: Path, experiment: str, config_hash: str, *, is_kept: bool = False
    ) -> None:
        self.folder, self.config_hash = folder, config_hash
        key = {"experiment": experiment, "config": config_hash}
        self._fields = CSV_FIELDS + (MAP_FIELDS if experiment == "mapping" else ())
        if not is_kept:
            folder.mkdir(parents=True, exist_ok=True)
        self.timings = TrialLines(folder / "timings.jsonl", key, is_kept=is_kept)
        self.trials = TrialLines(folder / "trials.jsonl", key, self.timings, is_kept=is_kept)
        self.mended = self.trials.mended

    def append(self, index: int, record: dict[str, Any], timing: dict[str, Any]) -> None:
        """Puts a finished trial on disk."""
        line = self.trials.as_line(index, record)
        # in this order: a trial that is there has its checksum
        told = self.timings.as_line(index, timing | {CHECKSUM: checksum(line)})
        self.timings.append_line(index, told)
        self.trials.append_line(index, line)

    def finish(self, asked: Iterable[int]) -> None:
        """Brings the lines into the trials' order; writes `trials.csv` from those asked for."""
        self.timings.sort()
        self.trials.sort()
        there = [index for index in sorted(asked) if index in self.trials]
        with replaced(self.folder / "trials.csv") as file:
            text = io.TextIOWrapper(file, encoding="utf-8", newline="")
            writer = csv.DictWriter(text, self._fields, lineterminator="\n")
            writer.writeheader()
            for record in self.trials.records(there):
                writer.writerows(csv_rows(record))
            text.detach()

    def close(self) -> None:
        """Nothing more is appended."""
        self.timings.close()
        self.trials.close()


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keeps every other run out of a folder; one that dies, however, lets go of it.

    Raises ValueError if another run is at work there.
    """
    handle: int | None = None
    try:
        while handle is None:
            folder.mkdir(parents=True, exist_ok=True)
            if os.name != "posix":  # nothing to lock with
                break
            try:
                handle = os.open(folder, os.O_RDONLY)
            except FileNotFoundError:  # taken away since: made once more
                continue
            _lock(handle, folder)
            if not _is_there(handle, folder):  # who had it took it away, once done
                os.close(handle)
                handle = None
        yield
    finally:
        if handle is not None:
            os.close(handle)


def _is_there(handle: int, folder: Path) -> bool:
    """Whether a folder is still the one that was opened."""
    return folder.exists() and os.path.samestat(os.fstat(handle), os.stat(folder))


def _lock(handle: int, folder: Path) -> None:
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise ValueError(f"another run is at work in {folder}: wait for its end") from None
    except OSError:
        return  # some network file systems have no locks: as good as they can


def write_atomically(path: Path, text: str) -> None:
    """Writes a file so that at any moment there is the old one or the new one, whole."""
    with replaced(path) as file:
        file.write(text.encode())


def csv_rows(record: dict[str, Any]) -> list[dict[str, Any]]:
    """The rows of `trials.csv`: one for each method, or one for a trial that raised; of a drive, for
    each sample."""
    trial = {"index": record["index"], "status": record["status"]}
    if record["status"] != "ok":
        return [trial | {"error": record["error"]}]
    return [
        trial | row for sample in record.get("samples", [record]) for row in _method_rows(sample)
    ]


def _method_rows(sample: dict[str, Any]) -> list[dict[str, Any]]:
    truth = dict(
        zip(("x_true_m", "y_true_m", "theta_true_rad"), sample["true_poses"][-1], strict=True)
    )
    bound = {f"crlb_{name}": value for name, value in sample.get("crlb", {}).items()}
    fields = CSV_FIELDS + MAP_FIELDS
    common = truth | bound | {name: sample[name] for name in fields if name in sample}
    return [
        common
        | {field: outcome[field] for field in fields if field in outcome}
        | {"method": name, "match": outcome["status"], "status": "ok"}
        for name, outcome in sample["methods"].items()
    ]

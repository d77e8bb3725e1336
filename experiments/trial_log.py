"""The log of a run's trials on disk: a line each, appended as it finishes; nothing is lost.

`trials.jsonl` is what a run resumes from. `timings.jsonl` beside it has what differs from one
repetition to the next, so that the log itself is the same to the byte.
"""

import csv
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

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
    """The trials of one run in one folder, by their index.

    Raises ValueError if the folder already holds trials of another configuration.
    """

    def __init__(self, folder: Path, experiment: str, config_hash: str) -> None:
        self.folder = folder
        self._key = {"experiment": experiment, "config": config_hash}
        self._fields = CSV_FIELDS + (MAP_FIELDS if experiment == "mapping" else ())
        folder.mkdir(parents=True, exist_ok=True)
        self.records = self._loaded(folder / "trials.jsonl")
        self.timings = self._loaded(folder / "timings.jsonl")

    def append(self, index: int, record: dict[str, Any], timing: dict[str, Any]) -> None:
        """Puts a finished trial on disk."""
        self.timings[index] = self._key | {"index": index} | timing
        _append_line(self.folder / "timings.jsonl", _line(self.timings[index]))
        self.records[index] = self._key | {"index": index} | record
        _append_line(self.folder / "trials.jsonl", _line(self.records[index]))

    def finish(self, trials: int) -> None:
        """Brings the lines into the trials' order; writes `trials.csv` from the first ones."""
        for name, lines in (("trials", self.records), ("timings", self.timings)):
            text = "".join(_line(lines[index]) for index in sorted(lines))
            write_atomically(self.folder / f"{name}.jsonl", text)
        asked = [index for index in sorted(self.records) if index < trials]
        rows = [row for index in asked for row in csv_rows(self.records[index])]
        partial = self.folder / "trials.csv.partial"
        with partial.open("w", newline="") as file:
            writer = csv.DictWriter(file, self._fields, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
        partial.replace(self.folder / "trials.csv")

    def _loaded(self, path: Path) -> dict[int, dict[str, Any]]:
        """The whole lines of a log; what a crash left of a last one is cut off."""
        if not path.exists():
            return {}
        text = path.read_bytes()
        whole = text[: text.rfind(b"\n") + 1]
        if len(whole) < len(text):
            with path.open("r+b") as file:
                file.truncate(len(whole))
        loaded: dict[int, dict[str, Any]] = {}
        for number, line in enumerate(whole.splitlines(), start=1):
            try:
                record = json.loads(line)
                key, index = {name: record[name] for name in self._key}, int(record["index"])
            except (ValueError, KeyError, TypeError) as error:
                raise ValueError(f"{path} line {number} is not a trial: {error!r}") from None
            if key != self._key:
                raise ValueError(
                    f"{path.parent} holds trials of another configuration, seed or version of "
                    "the code: choose another --out, or remove that folder"
                )
            loaded[index] = record
        return loaded


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keeps every other run out of a folder; one that dies, however, lets go of it.

    Raises ValueError if another run is at work there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if os.name != "posix":  # nothing to lock with
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        _lock(handle, folder)
        yield
    finally:
        os.close(handle)


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
    partial = path.with_name(path.name + ".partial")
    with partial.open("w") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)


def _append_line(path: Path, line: str) -> None:
    with path.open("a") as file:
        file.write(line)


def _line(record: dict[str, Any]) -> str:
    return json.dumps(record, allow_nan=False) + "\n"


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

"""`kitasap bench mismatch`: what is left of accuracy and honesty where assumptions do not hold.

Each mismatch of `experiments.worlds` at rest, one scan at random poses, and moving in circles at
0.2 m/s and 0.5 rad/s, method `limit`, against the bound of one scan by the sensor as it truly is.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

from rich.table import Table

from experiments.figures import mismatch_figure
from experiments.runs import recorded_trial
from experiments.statistics import samples_of, summarised
from experiments.tables import wide_console
from experiments.trials import TrialConfig
from experiments.worlds import MISMATCHES

METHOD = "limit"
_DRIVE_S = 20.0


def print_benchmark(
    place: str, laser: str, trials: int, drives: int, seed: int, out: Path
) -> list[dict[str, Any]]:
    """Measures, prints the table, writes `mismatch.json` and the figure into a folder; the rows."""
    base = TrialConfig(
        poses="random", place=place, laser=laser, methods=(METHOD,), duration_s=_DRIVE_S
    ).checked()
    console = wide_console()
    rows = [_row(base, name, trials, drives, seed, console.log) for name in MISMATCHES]
    out.mkdir(parents=True, exist_ok=True)
    (out / "mismatch.json").write_text(json.dumps(rows, indent=2) + "\n")
    figure = mismatch_figure(out / "mismatch.png", rows)
    console.print(_table(rows, f"{place}, {laser}, seed {seed}"))
    console.print(f"results and figure: {figure.parent}")
    return rows


def _row(
    base: TrialConfig,
    mismatch: str,
    trials: int,
    drives: int,
    seed: int,
    tell: Callable[[str], None],
) -> dict[str, Any]:
    config = replace(base, mismatch=mismatch)
    tell(f"{mismatch}: {MISMATCHES[mismatch]}")
    return {
        "mismatch": mismatch,
        "still": _figures("localization", config, seed, trials),
        "moving": _figures("tracking", config, seed, drives),
    }


def _figures(experiment: str, config: TrialConfig, seed: int, trials: int) -> dict[str, Any]:
    """The figures of so many trials, of all samples together where each has several."""
    finished = [recorded_trial(experiment, config, seed, index) for index in range(trials)]
    records: list[dict[str, Any]] = [{"index": index} | record for index, record, _ in finished]
    samples = samples_of(records)
    result = summarised(samples, config.methods)[METHOD]
    # what each trial ended with
    warnings = [
        record["methods"][METHOD]["warnings"] for record in records if record["status"] == "ok"
    ]
    keys = (
        "rmse_mm",
        "rmse_mrad",
        "crlb_mm",
        "crlb_ratio",
        "crlb_ratio_theta",
        "nees",
        "nees_band95",
    )
    return {key: result[key] for key in keys} | {
        "failures": result["failures"],
        "confident_wrong": result["confident_wrong"],
        "samples": len(samples),
        "trials": trials,
        "warned": sum(map(bool, warnings)),
        "warnings": sorted(set(chain.from_iterable(warnings)))[:3],
    }


def _table(rows: list[dict[str, Any]], what: str) -> Table:
    table = Table(
        title=f"{METHOD} where the assumptions do not hold\n{what}",
        caption="RMSE in mm, in units of the bound of one scan by the sensor as it is, and NEES (3 is"
        " honest, less is cautious). Failed: of all samples. Warned: trials that end with a warning.",
    )
    table.add_column("what is not as assumed")
    for name in ("still", "moving"):
        for column in ("mm", "/ bound", "NEES", "failed", "warned"):
            table.add_column(f"{name}\n{column}", justify="right")
    for row in rows:
        cells = [
            cell
            for name in ("still", "moving")
            for figures in (row[name],)
            for cell in (
                _number(figures["rmse_mm"]),
                _number(figures["crlb_ratio"]),
                _number(figures["nees"]),
                f"{figures['failures']} of {figures['samples']}",
                f"{figures['warned']} of {figures['trials']}",
            )
        ]
        table.add_row(MISMATCHES[row["mismatch"]], *cells)
    return table


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"

"""Errors along the drives of a tracking run, scan by scan, against the bound of each scan."""

import json
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from experiments.figures.canvas import BOUND_STYLE, colour, label_decades, line_style, saved
from experiments.tables import title_of

_CENTRAL = (0.1, 0.9)
"""The quantiles of the trials between which the band lies."""


def over_time_figure(folder: Path) -> Path:
    """RMS of the errors of all trials at each scan, failures included, and the bound's.

    Reads `trials.jsonl` and `config.json` of the folder; writes `over_time.png` and `.svg`.
    """
    return saved(over_time_drawn(folder), folder / "over_time")


def over_time_drawn(folder: Path) -> Figure:
    """The figure of `over_time_figure`."""
    config = json.loads((folder / "config.json").read_text())
    with (folder / "trials.jsonl").open() as file:
        records = [json.loads(line) for line in file]
    series = [
        record["series"]
        for record in records
        if record["status"] == "ok" and record["index"] < config["trials"]
    ]
    methods = config["config"]["methods"]
    times_s = max((np.array(one["time_s"]) for one in series), key=len, default=np.zeros(0))
    figure, axes = plt.subplots(2, 1, figsize=(11, 8), sharex=True, layout="constrained")
    has_band = len(series) > 1
    for axis, quantity, bound in (
        (axes[0], "position_error_m", "crlb_position_m"),
        (axes[1], "heading_error_rad", "crlb_heading_rad"),
    ):
        errors = {
            name: _aligned(times_s, series, [one["methods"][name][quantity] for one in series])
            for name in methods
        }
        bounds = _aligned(times_s, series, [one[bound] for one in series])
        _panel(axis, times_s, errors, bounds, has_band)
    axes[0].set_ylabel("position error [mm]")
    axes[1].set(ylabel="heading error [mrad]", xlabel="time [s]")
    figure.suptitle(
        f"{title_of(config['experiment'], config['config']['poses'])}\n"
        f"error at each scan, lost or not, against its bound; {_drives(len(series))}; lower is better"
    )
    _legend(figure, methods, len(series), has_band)
    return figure


def _aligned(
    times_s: np.ndarray, series: list[dict[str, Any]], values: list[list[float | None]]
) -> np.ndarray:
    """(trials, T) magnitudes [mm, mrad] at the stamps nearest to times_s (T,); nan where none is.

    Each trial's scans come at its own stamps, and some trials end earlier.
    """
    table = np.full((len(series), times_s.size), np.nan)
    reach_s = 0.5 * float(np.median(np.diff(times_s))) if times_s.size > 1 else np.inf
    for row, one, own in zip(table, series, values, strict=True):
        stamps_s = np.array(one["time_s"])
        if not stamps_s.size:
            continue
        right = np.clip(np.searchsorted(times_s, stamps_s), 1, max(times_s.size - 1, 1))
        right = np.minimum(right, times_s.size - 1)
        left = np.maximum(right - 1, 0)
        nearest = np.where(stamps_s - times_s[left] < times_s[right] - stamps_s, left, right)
        is_near = np.abs(times_s[nearest] - stamps_s) <= reach_s
        numbers = np.array([np.nan if value is None else 1000 * abs(value) for value in own])
        row[nearest[is_near]] = numbers[is_near]
    return table


def _panel(
    axis: Axes,
    times_s: np.ndarray,
    errors: dict[str, np.ndarray],
    bounds: np.ndarray,
    has_band: bool,
) -> None:
    axis.set_yscale("log")
    axis.grid(color="#e4e4e4", lw=0.7)
    axis.grid(which="minor", color="#f2f2f2", lw=0.5)
    axis.set_axisbelow(True)
    lines = [_rms(bounds)]
    axis.plot(times_s, lines[0], **BOUND_STYLE)
    for name, table in errors.items():
        lines.append(_rms(table))
        axis.plot(times_s, lines[-1], **line_style(name))
        seen = np.isfinite(table).any(axis=0)
        if has_band and seen.any():
            low, high = np.nanquantile(table[:, seen], _CENTRAL, axis=0)
            axis.fill_between(times_s[seen], low, high, color=colour(name), alpha=0.12, lw=0)
    drawn = np.concatenate(lines)
    drawn = drawn[np.isfinite(drawn) & (drawn > 0)]
    if drawn.size:
        # the lines decide, but for their luckiest moments: a band may reach decades further down
        axis.set_ylim(0.5 * np.quantile(drawn, 0.01), 1.6 * drawn.max())
    label_decades(axis.yaxis)
    if times_s.size > 1:
        axis.set_xlim(0.0, times_s[-1])


def _rms(table: np.ndarray) -> np.ndarray:
    """(T,) over the trials that have a number there; nan where none has."""
    count = np.isfinite(table).sum(axis=0)
    total = np.nansum(table**2, axis=0)
    result: np.ndarray = np.sqrt(
        np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0)
    )
    return result


def _legend(figure: Any, methods: list[str], trials: int, has_band: bool) -> None:
    handles: list[Any] = [Line2D([], [], **BOUND_STYLE)]
    rms = " (RMS)" if has_band else ""
    labels = [f"Cramer-Rao bound of one scan{rms}"]
    for name in methods:
        handles.append(Line2D([], [], **line_style(name)))
        labels.append(f"{name}{rms}")
    if has_band:
        handles.append(Patch(color="#999999", alpha=0.25, lw=0))
        labels.append(f"band: central 80 % of the {_drives(trials)}")
    figure.legend(
        handles, labels, loc="outside lower center", ncols=min(len(labels), 4), handlelength=2.6,
        fontsize=9,
    )  # fmt: skip


def _drives(count: int) -> str:
    return f"{count} drive" + "s" * (count != 1)

"""All methods of a run against the Cramer-Rao bound: how often an error stays below what."""

import csv
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from experiments.figures.canvas import BOUND_STYLE, label_decades, line_style, saved
from experiments.tables import title_of

BOUND = "Cramer-Rao bound: what an efficient estimator of one scan would do"
_BEYOND = "of the ranges' slopes; edges, odometry and earlier scans can bring a method left of it"
"""See `slam.beam_likelihood.cramer_rao_bound`."""
_LOWEST_SHARE = 0.02
"""Chosen: where the picture begins; the luckiest errors of all would stretch it by decades."""
_GRID = 400
_ERF_Z = np.linspace(0.0, 6.0, 4001)
_ERF = np.array([math.erf(z / math.sqrt(2.0)) for z in _ERF_Z])


@dataclass(frozen=True)
class _Errors:
    """One quantity of a run: errors of the successes per method, and the bound of every sample.

    counts: how many samples each method was given, failures included. bounds: inf where blind.
    """

    of_method: dict[str, np.ndarray]
    counts: dict[str, int]
    bounds: np.ndarray


def bound_figure(folder: Path) -> Path:
    """The share of all trials with an error below x, per method, and what the bound allows.

    A trial that failed has no error, so that a curve ends at the method's success rate. Reads
    `trials.csv`, `summary.json` and `config.json` of the folder; writes `bound.png` and `bound.svg`.
    """
    return saved(bound_drawn(folder), folder / "bound")


def bound_drawn(folder: Path) -> Figure:
    """The figure of `bound_figure`."""
    summary = json.loads((folder / "summary.json").read_text())
    poses = json.loads((folder / "config.json").read_text())["config"]["poses"]
    with (folder / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    position, heading = _errors(rows, list(summary["methods"]))
    figure, axes = plt.subplots(1, 2, figsize=(11.5, 6.6), sharey=True, layout="constrained")
    _panel(axes[0], position, _within_position)
    _panel(axes[1], heading, _within_heading)
    axes[0].set(xlabel="position error [mm]", ylabel=f"share of all {_unit(summary)} below it")
    axes[1].set(xlabel="heading error, either side [mrad]")
    figure.suptitle(
        f"{title_of(summary['experiment'], poses)}\n"
        "errors of each method against the bound of one scan: further left is better"
    )
    _legend(figure, summary, position.bounds, heading.bounds)
    return figure


def _errors(rows: list[dict[str, str]], methods: list[str]) -> tuple[_Errors, _Errors]:
    """Position [mm] and heading [mrad] of the rows of `trials.csv`."""
    of_method = {m: [row for row in rows if row["method"] == m] for m in methods}
    raised = sum(row["status"] != "ok" for row in rows)
    counts = {m: len(of_method[m]) + raised for m in methods}
    found = {m: [row for row in of_method[m] if row["success"] == "True"] for m in methods}
    position_mm = {m: 1000 * np.hypot(*_columns(found[m], "x_error_m", "y_error_m")) for m in found}
    heading_mrad = {m: 1000 * np.abs(_columns(found[m], "theta_error_rad")[0]) for m in found}
    # every method has a row for every sample, with the sample's bound in it
    bounds = 1000 * _columns(of_method[methods[0]], "crlb_position_m", "crlb_heading_rad")
    return _Errors(position_mm, counts, bounds[0]), _Errors(heading_mrad, counts, bounds[1])


def _columns(rows: list[dict[str, str]], *names: str) -> np.ndarray:
    """(C, R) numbers; inf where nothing is written."""
    return np.array([[float(row[name] or "inf") for row in rows] for name in names])


def _within_position(x: float, bounds: np.ndarray) -> np.ndarray:
    """The chance of a position error below x where the bound's standard deviation is so large.

    The norm of a planar Gaussian. How its variance is split between the axes is not recorded, only
    the root of the trace: taken as isotropic, sigma = bound / sqrt(2), it is Rayleigh's.
    """
    return -np.expm1(-((x / bounds) ** 2))


def _within_heading(x: float, bounds: np.ndarray) -> np.ndarray:
    """The chance that a Gaussian of that standard deviation stays within x to either side."""
    result: np.ndarray = np.interp(x / bounds, _ERF_Z, _ERF)
    return result


def _panel(axis: Axes, errors: _Errors, within: Callable[[float, np.ndarray], np.ndarray]) -> None:
    low, high = _limits(errors)
    axis.set(xscale="log", xlim=(low, high), ylim=(0.0, 1.02))
    label_decades(axis.xaxis)
    axis.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axis.grid(color="#e4e4e4", lw=0.7)
    axis.grid(which="minor", axis="x", color="#f2f2f2", lw=0.5)
    axis.set_axisbelow(True)
    axis.axhline(0.5, color="#999999", lw=1.0, ls=":", zorder=1)
    axis.annotate(
        "median", (0.0, 0.5), (3, 2), xycoords=("axes fraction", "data"),
        textcoords="offset points", color="#777777", fontsize=8,
    )  # fmt: skip
    if errors.bounds.size:
        grid = np.geomspace(low, high, _GRID)
        axis.plot(grid, [within(x, errors.bounds).mean() for x in grid], **BOUND_STYLE)
    for method, values in errors.of_method.items():
        if not values.size:
            continue
        ordered = np.sort(values)
        share = np.arange(values.size + 1) / errors.counts[method]
        steps = np.concatenate([[min(low, ordered[0])], ordered, [high]])
        axis.step(steps, np.append(share, share[-1]), where="post", **line_style(method))


def _limits(errors: _Errors) -> tuple[float, float]:
    """Of the x axis: from the bound's and the methods' best to the worst success."""
    seen = errors.bounds[np.isfinite(errors.bounds)]
    lists = [values[values > 0] for values in (*errors.of_method.values(), 0.2 * seen, 3 * seen)]
    lists = [values for values in lists if values.size]
    if not lists:
        return 0.1, 100.0
    low = min(np.quantile(values, _LOWEST_SHARE) for values in lists)
    return 0.8 * float(low), 1.25 * float(max(values.max() for values in lists))


def _legend(
    figure: Any, summary: dict[str, Any], position_mm: np.ndarray, heading_mrad: np.ndarray
) -> None:
    """A table with a line of each curve before its row."""
    width = max(len("method"), *(len(name) for name in summary["methods"]))
    blank = Line2D([], [], color="none")
    seen = np.isfinite(position_mm)
    bound = BOUND
    if seen.any():
        bound += f" (RMS {_rms(position_mm[seen]):.2f} mm, {_rms(heading_mrad[seen]):.2f} mrad)"
    if not seen.all():
        bound += f"; blind in {(~seen).sum()} of {seen.size}"
    handles, labels = [Line2D([], [], **BOUND_STYLE), blank, blank], [bound, _BEYOND]
    labels.append(
        f"{'method':{width}}  {'RMSE of the successes, ratio to bound':^40}  "
        f"{'NEES (3: honest; 95 % band)':^28}  {'failed':>12}"
    )
    for name, result in summary["methods"].items():
        handles.append(Line2D([], [], **line_style(name)))
        labels.append(f"{name:{width}}  {_row(result, _total(summary, result))}")
    figure.legend(
        handles, labels, loc="outside lower center", ncols=1, handlelength=2.6,
        prop={"family": "DejaVu Sans Mono", "size": 8.5},
    )  # fmt: skip


def _row(result: dict[str, Any], total: int) -> str:
    errors = "-"
    if result["rmse_mm"] is not None:
        errors = (
            f"{result['rmse_mm']:7.2f} mm ={_number(result['crlb_ratio'])} x  "
            f"{result['rmse_mrad']:6.2f} mrad ={_number(result['crlb_ratio_theta'])} x"
        )
    nees = "-"
    if result["nees"] is not None:
        low, high = result["nees_band95"]
        digits = 2 if result["nees"] < 1000 else 0
        nees = f"{result['nees']:>7.{digits}f} ({low:.2f} to {high:.2f})"
    return f"{errors:^40}  {nees:^28}  {result['failures']:>5} of {total}"


def _total(summary: dict[str, Any], result: dict[str, Any]) -> int:
    """All that a method was asked: the samples, and the trials that raised."""
    return int(summary["samples"]) + int(result["raised"])


def _unit(summary: dict[str, Any]) -> str:
    return "samples" if summary["experiment"] == "tracking" else "trials"


def _number(value: float | None) -> str:
    return f"{'-' if value is None else format(value, '.2f'):>6}"


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))

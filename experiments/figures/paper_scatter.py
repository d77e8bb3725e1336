"""The paper's Fig. 5: where the trials of a run ended, around the truth."""

import csv
import json
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle

from experiments.figures.canvas import colour, legend_below, saved
from experiments.tables import title_of

_LIMIT_CM = 4.0
_LEAST_WIDTH_IN = 5.5
"""Chosen: half of the title fits."""
_MOST_COLUMNS = 3
"""Chosen: six side by side cannot be read on paper, let alone on a phone."""


def scatter(folder: Path) -> Path:
    """Like the paper's Fig. 5: the error of every trial in x and y [cm], a panel for each method.

    Reads `trials.csv`, `summary.json` and `config.json` of the folder; writes `scatter.png` and
    `scatter.svg`.
    """
    return saved(scatter_drawn(folder), folder / "scatter")


def scatter_drawn(folder: Path) -> Figure:
    """The figure of `scatter`."""
    summary = json.loads((folder / "summary.json").read_text())
    poses = json.loads((folder / "config.json").read_text())["config"]["poses"]
    with (folder / "trials.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["status"] == "ok"]
    methods = list(summary["methods"])
    columns = min(len(methods), _MOST_COLUMNS)
    rows_of_panels = -(-len(methods) // columns)
    figure, axes = plt.subplots(
        rows_of_panels, columns, figsize=(max(3.4 * columns, _LEAST_WIDTH_IN), 3.8 * rows_of_panels + 0.8),
        squeeze=False, layout="constrained",
    )  # fmt: skip
    for axis in axes.flat[len(methods) :]:
        axis.set_visible(False)
    for axis, method in zip(axes.flat, methods, strict=False):
        errors_cm = 100 * np.array(
            [
                [float(row["x_error_m"]), float(row["y_error_m"])]
                for row in rows
                if row["method"] == method
            ]
        ).reshape(-1, 2)
        _scatter_panel(axis, method, errors_cm, summary, poses)
    for axis in axes[:, 0]:
        axis.set_ylabel("error in Y [cm]")
    # fewer panels are narrower than the title in one line
    between = ": " if columns > 2 else ":\n"
    figure.suptitle(
        f"{title_of(summary['experiment'], poses)}{between}estimated minus true position"
    )
    legend_below(figure, axes[0][0], ncols=3)
    return figure


def _scatter_panel(
    axis: Axes, method: str, errors_cm: np.ndarray, summary: dict[str, Any], poses: str
) -> None:
    trials, result = summary["trials"], summary["methods"][method]
    is_inside = (np.abs(errors_cm) <= _LIMIT_CM).all(axis=1)
    axis.add_patch(
        Rectangle((-3, -3), 6, 6, fill=False, ls="--", ec="#999999", label="paper's ±3 cm")
    )
    paper = summary["paper_values"]
    if poses == "paper":  # of which alone it tells
        axis.add_patch(
            Ellipse(
                (paper["x_cm"]["mean"], paper["y_cm"]["mean"]),
                *(4 * paper[key]["std"] for key in ("x_cm", "y_cm")),
                fc="#ffbb66", ec="#cc7700", alpha=0.5, label="paper's mean, ±2 sd",
            )
        )  # fmt: skip
    axis.plot(
        *errors_cm[is_inside].T, "o", ms=3.5, mew=0, alpha=0.6,
        color=colour(method), label="ours, a dot for each trial",
    )  # fmt: skip
    axis.axhline(0, color="#cccccc", lw=0.8, zorder=0)
    axis.axvline(0, color="#cccccc", lw=0.8, zorder=0)
    axis.set(xlim=(-_LIMIT_CM, _LIMIT_CM), ylim=(-_LIMIT_CM, _LIMIT_CM), xlabel="error in X [cm]")
    axis.set_aspect("equal")
    outside = len(errors_cm) - int(is_inside.sum())
    axis.set_title(
        f"{method}\n{trials - result['failures']} of {trials} succeed, {outside} off this picture",
        fontsize=9,
    )

"""Expression (1) along the search: how fast each ICP of a run converges, and to what."""

import json
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from experiments.figures.canvas import colour, label_decades, saved
from experiments.paper import PAPER_ICP
from experiments.tables import title_of

_OF_EXPRESSION_1 = ("paper", "open3d")
"""Methods whose search goes down it; the straight lines of `line` have a distance of their own."""
_MOST_LINES, _FEW_LINES = 200, 10
"""Chosen: more hide each other, and as few may be strong. Medians and counts are of all trials."""


def convergence_figure(folder: Path) -> Path | None:
    """Expression (1) and the position error after each pass of the search, and how many it took.

    Reads `config.json` and `trials.jsonl` of the folder; writes `convergence.png` and `.svg`. None,
    and no file, where no method of the run goes down expression (1), or no trial kept its passes.
    """
    figure = convergence_drawn(folder)
    return None if figure is None else saved(figure, folder / "convergence")


def convergence_drawn(folder: Path) -> Figure | None:
    """The figure of `convergence_figure`."""
    config = json.loads((folder / "config.json").read_text())
    with (folder / "trials.jsonl").open() as file:
        records = [json.loads(line) for line in file]
    searches = _searches(records, config)
    if not searches:
        return None
    figure, axes = plt.subplots(
        len(searches), 3, figsize=(12.0, 2.9 * len(searches) + 0.9), squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for row, (name, steps) in zip(axes, searches.items(), strict=True):
        _curves(row[0], name, [one["error_m2"] for one in steps], 1.0)
        _curves(row[1], name, [one["position_error_m"] for one in steps], 1000.0)
        _passes(row[2], name, np.array([len(one["error_m2"]) for one in steps]))
        row[0].set_ylabel(f"{name}: expression (1) [m²]")
        row[1].set_ylabel("off the true position [mm]")
        row[2].set_ylabel("trials")
        if name == "paper":
            row[0].axhline(PAPER_ICP.threshold_m2, color="#000000", ls="--", lw=1.0)
            row[0].annotate(
                "threshold, below which it ends", (1.0, PAPER_ICP.threshold_m2), (-3, 3),
                xycoords=("axes fraction", "data"), textcoords="offset points", ha="right",
                fontsize=8,
            )  # fmt: skip
    for row in axes:
        for axis, label in zip(row, ("pass", "pass", "passes until it ended"), strict=True):
            axis.set_xlabel(label)
    figure.suptitle(
        f"{title_of(config['experiment'], config['config']['poses'])}\n"
        "a line for each trial, a star where it ends; thick: their median, ended ones included"
    )
    return figure


def _searches(
    records: list[dict[str, Any]], config: dict[str, Any]
) -> dict[str, list[dict[str, Any]]]:
    """The passes of every trial, by method, in the order of the trials."""
    asked = [one for one in records if one["status"] == "ok" and one["index"] < config["trials"]]
    asked.sort(key=lambda record: int(record["index"]))
    names = [name for name in config["config"]["methods"] if name in _OF_EXPRESSION_1]
    kept = {name: [one["methods"][name].get("steps") for one in asked] for name in names}
    return {name: found for name, steps in kept.items() if (found := [s for s in steps if s])}


def _curves(axis: Axes, name: str, values: list[list[float | None]], scale: float) -> None:
    curves = [scale * np.array([np.nan if v is None else v for v in one]) for one in values]
    longest = max(len(one) for one in curves)
    # a search that has ended stays where it is
    table = np.array([np.pad(one, (0, longest - len(one)), mode="edge") for one in curves])
    lines = [np.column_stack([np.arange(len(one)), one]) for one in curves[:_MOST_LINES]]
    fewness = min(_FEW_LINES / len(lines), 1.0)
    style: dict[str, Any] = {"colors": colour(name), "rasterized": True}
    axis.add_collection(
        LineCollection(lines, linewidths=0.5 + fewness, alpha=0.3 + 0.5 * fewness, **style)
    )
    ends = np.array([line[-1] for line in lines])
    axis.plot(
        *ends.T, "*", ms=6 + 4 * fewness, mew=0, alpha=0.5 + 0.4 * fewness, color=colour(name),
        rasterized=True, zorder=3,
    )  # fmt: skip
    middle = np.nanmedian(table, axis=0) if np.isfinite(table).any(axis=0).all() else table[0]
    axis.plot(middle, color="#000000", lw=2.0)
    seen = table[np.isfinite(table) & (table > 0)]
    last = max(longest - 1, 1)
    axis.set(yscale="log", xlim=(-0.03 * last, 1.03 * last))  # stars are not to lie on the frame
    if seen.size:
        axis.set_ylim(0.7 * seen.min(), 1.4 * seen.max())
    if scale != 1.0:
        label_decades(axis.yaxis)
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis.grid(color="#e4e4e4", lw=0.7)
    axis.set_axisbelow(True)


def _passes(axis: Axes, name: str, counts: np.ndarray) -> None:
    width = max(1, int(counts.max()) // 25)
    edges = np.arange(0.5, counts.max() + width + 0.5, width)
    axis.hist(counts, bins=edges.tolist(), color=colour(name))
    axis.set_title(f"median {np.median(counts):g}, most {counts.max()}", fontsize=9)
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis.yaxis.set_major_locator(MaxNLocator(integer=True))

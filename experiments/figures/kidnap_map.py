"""Where on the map, how far and how far turned a kidnap is found out: a run's trials from above."""

import math
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter
from matplotlib.transforms import ScaledTranslation

from experiments.figures.canvas import line_style, saved
from experiments.figures.kidnaps import Ending, Kidnaps, ending, set_down
from experiments.statistics import wilson_interval
from kitasap_sim.laser import laser
from kitasap_sim.places import Place
from slam.se2 import wrap_angle

_MARKS: dict[Ending, dict[str, Any]] = {
    Ending.FOUND: {"color": "#1f77b4", "marker": "o", "ms": 4.5, "mew": 0},
    Ending.SAID: {"color": "#ff8c1a", "marker": "o", "ms": 5.5, "mew": 1.4, "mfc": "none"},
    Ending.BELIEVED: {"color": "#d62728", "marker": "X", "ms": 7, "mew": 0},
}
"""Told apart by shape too."""
_MOST_MARKS = 150
"""Chosen: more robots than these hide each other, and their rates are shown instead."""
_TRIALS_PER_CELL = 8
_STEPS = tuple(digit * 10.0**power for power in range(-2, 4) for digit in (1.0, 2.0, 5.0))
_MOST_BINS = 8
_ARROW = 0.035
"""Of a robot's heading, as a share of the place's width."""


def kidnap_map(folder: Path) -> Path | None:
    """The place from above with what became of the robot wherever it was set down, by method.

    Where it was carried anywhere, below it the share of successes over the way and the turn.
    Reads `config.json` and `trials.jsonl` of the folder; writes `kidnap_map.png` and `.svg`.
    None, and no file, where the paper's one pair of poses was repeated, or nothing finished.
    """
    figure = kidnap_map_drawn(folder)
    return None if figure is None else saved(figure, folder / "kidnap_map")


def kidnap_map_drawn(folder: Path) -> Figure | None:
    """The figure of `kidnap_map`."""
    kidnaps = Kidnaps.read(folder)
    if kidnaps.config["poses"] == "paper" or not kidnaps.records:
        return None
    walls_m = _walls(kidnaps)
    is_anywhere = kidnaps.config["poses"] == "anywhere"
    count = len(kidnaps.methods)
    columns = count if count < 4 else math.ceil(count / 2)
    lines = math.ceil(count / columns)
    width_m, height_m = np.ptp(walls_m.reshape(-1, 2), axis=0)
    panel_in = 12.0 / max(columns, 2)
    maps_in = lines * (0.85 * panel_in * float(height_m / width_m) + 0.95) + 0.1
    rates_in = 3.1 if is_anywhere else 0.1
    figure = plt.figure(
        figsize=(max(panel_in * columns, 8.0), maps_in + rates_in + 1.1),
        layout=ConstrainedLayoutEngine(h_pad=0.09),  # [in]; room for the legend between the rows
    )
    grid = figure.add_gridspec(2, 1, height_ratios=[maps_in, rates_in])
    _draw_maps(grid[0].subgridspec(lines, columns).subplots(squeeze=False), kidnaps, walls_m)
    if is_anywhere:
        _draw_rates(grid[1].subgridspec(1, 2).subplots(sharey=True), kidnaps)
        handles = [Line2D([], [], marker="o", ms=5, **line_style(n)) for n in kidnaps.methods]
        figure.legend(
            handles, kidnaps.methods, loc="outside lower center", ncols=len(handles), fontsize=9
        )
    is_binned = len(kidnaps.records) > _MOST_MARKS
    figure.suptitle(
        f"Kidnapped in {kidnaps.place}: does the robot find itself again?\n"
        + (
            "share found, by where it was set down"
            if is_binned
            else "where it was set down, and a line to where it faced"
        )
    )
    return figure


def _walls(kidnaps: Kidnaps) -> np.ndarray:
    """(S, 2, 2) the surfaces that the laser can see [m]."""
    height_m = laser(kidnaps.config["laser"]).mount_m[2]
    return Place(kidnaps.config["place"]).map_at(height_m).segments_m


def _draw_maps(axes: np.ndarray, kidnaps: Kidnaps, walls_m: np.ndarray) -> None:
    poses = np.array([set_down(record) for record in kidnaps.records])
    is_binned = len(poses) > _MOST_MARKS
    lower, upper = walls_m.min(axis=(0, 1)), walls_m.max(axis=(0, 1))
    mesh = None
    for axis, method in zip(axes.flat, kidnaps.methods, strict=False):
        endings = [ending(outcome) for outcome in kidnaps.of(method)]
        if is_binned:  # a light edge, seen on dark cells
            axis.add_collection(LineCollection(list(walls_m), colors="#ffffff", linewidths=3.2))
        axis.add_collection(LineCollection(list(walls_m), colors="#444444", linewidths=1.4))
        if is_binned:
            mesh = _draw_cells(axis, poses, endings, lower, upper)
        else:
            _draw_robots(axis, poses, endings, _ARROW * float(upper[0] - lower[0]))
        axis.set(
            xlim=(lower[0] - 0.1, upper[0] + 0.1), ylim=(lower[1] - 0.1, upper[1] + 0.1),
            xlabel="x [m]",
        )  # fmt: skip
        axis.set_aspect("equal")
        axis.set_title(_counts(method, endings, kidnaps.raised), fontsize=9.5)
    for axis in axes[:, 0]:
        axis.set_ylabel("y [m]")
    for axis in axes.flat[len(kidnaps.methods) :]:
        axis.set_axis_off()
    if mesh is not None:
        axes[0][0].figure.colorbar(
            mesh, ax=axes, format=PercentFormatter(1.0, decimals=0), pad=0.01,
            label="found (number: trials there)",
        )  # fmt: skip
    shown = [Ending.BELIEVED] if is_binned else list(Ending)
    handles = [Line2D([], [], ls="", **_MARKS[kind]) for kind in shown]
    labels = [kind.value for kind in shown]
    middle = axes[-1][axes.shape[1] // 2]
    below = ScaledTranslation(0.0, -0.5, middle.figure.dpi_scale_trans)  # [in]: under the x label
    middle.legend(
        handles, labels, loc="upper center", bbox_to_anchor=(0.5, 0.0),
        bbox_transform=middle.transAxes + below, ncols=3, fontsize=9,
    )  # fmt: skip


def _counts(method: str, endings: list[Ending], raised: int) -> str:
    total, found = len(endings) + raised, endings.count(Ending.FOUND)
    rest = [f"{endings.count(kind)} {kind.value}" for kind in (Ending.SAID, Ending.BELIEVED)]
    rest += [f"{raised} raised"] * (raised > 0)
    return f"{method}: found in {found} of {total} ({found / total:.1%})\n" + ", ".join(rest)


def _draw_robots(axis: Axes, poses: np.ndarray, endings: list[Ending], arrow_m: float) -> None:
    # the rare and bad ones come last, and on top
    for order, kind in enumerate(Ending):
        mine = poses[[one is kind for one in endings]]
        tips = mine[:, :2] + arrow_m * np.stack([np.cos(mine[:, 2]), np.sin(mine[:, 2])], axis=1)
        lines = np.stack([mine[:, :2], tips], axis=1)[np.isfinite(mine[:, 2])]
        colour = _MARKS[kind]["color"]
        axis.add_collection(
            LineCollection(list(lines), colors=colour, linewidths=1.2, zorder=3 + order)
        )
        axis.plot(*mine[:, :2].T, ls="", zorder=3 + order, **_MARKS[kind])


def _draw_cells(
    axis: Axes, poses: np.ndarray, endings: list[Ending], lower: np.ndarray, upper: np.ndarray
) -> Any:
    """Squares coloured by the share of successes, their number of trials in each."""
    side_m = _nice_step(math.sqrt(np.prod(upper - lower) * _TRIALS_PER_CELL / len(poses)))
    edges = [
        low + side_m * np.arange(math.ceil((high - low) / side_m) + 1)
        for low, high in zip(lower, upper, strict=True)
    ]
    is_found = np.array([one is Ending.FOUND for one in endings])
    counts, _ = np.histogramdd(poses[:, :2], bins=edges)
    found, _ = np.histogramdd(poses[is_found, :2], bins=edges)
    share = np.ma.masked_array(found / np.maximum(counts, 1), counts == 0)
    mesh = axis.pcolormesh(*edges, share.T, cmap="cividis", vmin=0.0, vmax=1.0, zorder=0)
    for i, j in np.argwhere(counts > 0):
        axis.text(
            edges[0][i] + side_m / 2, edges[1][j] + side_m / 2, f"{counts[i, j]:.0f}",
            ha="center", va="center", fontsize=6.5,
            color="#222222" if share[i, j] > 0.5 else "#eeeeee",
        )  # fmt: skip
    wrong = poses[[one is Ending.BELIEVED for one in endings]]
    axis.plot(*wrong[:, :2].T, ls="", zorder=5, **(_MARKS[Ending.BELIEVED] | {"ms": 4.5}))
    return mesh


def _draw_rates(axes: Any, kidnaps: Kidnaps) -> None:
    before = np.array([record["true_poses"][0] for record in kidnaps.records])
    after = np.array([set_down(record) for record in kidnaps.records])
    way_m = np.hypot(*(after - before)[:, :2].T)
    turn_deg = np.degrees([abs(wrap_angle(turn)) for turn in (after - before)[:, 2]])
    step_m = _nice_step(float(way_m.max()) / _MOST_BINS)
    edges_m = step_m * np.arange(max(math.ceil(way_m.max() / step_m), 1) + 1)
    _rates_panel(axes[0], kidnaps, way_m, edges_m)
    _rates_panel(axes[1], kidnaps, turn_deg, np.arange(0.0, 181.0, 30.0))
    axes[0].set(xlabel="carried by [m] (trials)", ylabel="share found, 95 % interval")
    axes[1].set_xlabel("turned by, either way [degrees] (trials)")


def _rates_panel(axis: Axes, kidnaps: Kidnaps, values: np.ndarray, edges: np.ndarray) -> None:
    """The methods beside each other in every bin."""
    bins = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    bins[~np.isfinite(values)] = -1
    counts = [int((bins == bin_).sum()) for bin_ in range(len(edges) - 1)]
    places = np.arange(len(counts))
    for number, method in enumerate(kidnaps.methods):
        is_found = np.array([bool(outcome["success"]) for outcome in kidnaps.of(method)])
        shift = 0.13 * (number - (len(kidnaps.methods) - 1) / 2)
        found = [int(is_found[bins == bin_].sum()) for bin_ in places]
        rows = [
            (bin_ + shift, k / n, *wilson_interval(k, n))
            for bin_, k, n in zip(places, found, counts, strict=True)
            if n > 0
        ]
        x, rate, low, high = np.array(rows).reshape(-1, 4).T
        spread = np.maximum([rate - low, high - rate], 0.0)
        axis.errorbar(x, rate, spread, marker="o", ms=5, **(line_style(method) | {"lw": 1.4}))
    axis.set_xticks(
        places,
        [
            f"{low:g}-{high:g}\n({n})"
            for low, high, n in zip(edges[:-1], edges[1:], counts, strict=True)
        ],
        fontsize=8.5,
    )
    axis.set(xlim=(-0.5, len(counts) - 0.5), ylim=(-0.03, 1.03))
    axis.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axis.grid(axis="y", color="#e4e4e4", lw=0.7)
    axis.set_axisbelow(True)


def _nice_step(least: float) -> float:
    """The smallest of 0.01, 0.02, 0.05, 0.1 and so on that is not below."""
    return next((step for step in _STEPS if step >= least), _STEPS[-1])

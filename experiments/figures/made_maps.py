"""The paper's Fig. 7: the true map with the track beside the map that the robot made of it."""

import json
import math
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from experiments.figures.canvas import (
    label_decades,
    legend_below,
    line_style,
    plain,
    saved,
    spread_near_one,
)
from experiments.map_quality import NEAR_M
from experiments.mapping import LEAST_SHARE, MOST_ATE_M, MapOutcome, MappingResult, true_map
from slam.arrays import FloatArray

_TRUE, _MAP, _WRONG, _WAY, _TRACK = "#444444", "#0072b2", "#d62728", "#e69f00", "#009e73"
_MISSED = "#cc00cc"
_ARROWS = 12
_MANY = 200
"""Points off every surface, of which more would hide the map if they were as large as fewer need to be."""


def made_maps_picture(folder: Path, result: MappingResult, index: int) -> Path:
    """(a) the true map and the track, (b) what each method made of it.

    Writes `trial_<index>.png` and `.svg` into the folder.
    """
    names = list(result.outcomes)
    columns = 2 if len(names) in (1, 3) else 3
    rows = math.ceil((1 + len(names)) / columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(5.4 * columns, 4.9 * rows + 0.6), squeeze=False,
        layout="constrained",
    )  # fmt: skip
    panels = list(axes.flat)
    _draw_truth(panels[0], result)
    for letter, axis, name in zip("bcdefgh", panels[1:], names, strict=False):
        _draw_made(axis, result, name, f"({letter}) {name}")
    for axis in panels[1 + len(names) :]:
        axis.set_axis_off()
    figure.suptitle(_title(result, index))
    legend_below(figure, panels[1], ncols=6 if columns > 2 else 3)
    return saved(figure, folder / f"trial_{index}")


def worst_maps_picture(folder: Path, worst: list[tuple[int, MappingResult]], name: str) -> Path:
    """The maps of one method's worst trials beside each other. Writes `worst.png` and `.svg`."""
    # a panel is as high as its place is for its width; else titles and legend may lie on it
    wide_m, high_m = np.ptp(true_map(worst[0][1].config).place_map.segments_m, axis=(0, 1)) + 0.6
    size = 5.4 * len(worst), 4.6 * high_m / wide_m + 1.9
    figure, axes = plt.subplots(1, len(worst), figsize=size, squeeze=False, layout="constrained")
    for axis, (index, result) in zip(axes[0], worst, strict=True):
        _draw_made(axis, result, name, f"trial {index}, {_people(result)}")
    figure.suptitle(f"the worst maps by {name}" if len(worst) > 1 else f"the worst map by {name}")
    # below a single map there is room for two beside each other
    legend_below(figure, axes[0][0], ncols=min(2 * len(worst), 6))
    return saved(figure, folder / "worst")


def map_quality_figure(folder: Path) -> Path:
    """How many of a run's maps are how good: trajectory error, precision, recall, by method.

    Reads `trials.jsonl` and `summary.json`; writes `quality.png` and `.svg`.
    """
    return saved(map_quality_drawn(folder), folder / "quality")


def map_quality_drawn(folder: Path) -> Figure:
    """The figure of `map_quality_figure`."""
    summary = json.loads((folder / "summary.json").read_text())
    lines = (folder / "trials.jsonl").read_text().splitlines()
    records = [record for record in map(json.loads, lines) if record["status"] == "ok"]
    figure, axes = plt.subplots(1, 3, figsize=(12.0, 4.2), layout="constrained")
    panels = (
        ("ate_m", 100.0, "ATE: RMS error of the trajectory [cm]", 100 * MOST_ATE_M),
        (
            "map_precision",
            1.0,
            f"precision: map points within {100 * NEAR_M:.0f} cm of a surface",
            LEAST_SHARE,
        ),
        (
            "map_recall",
            1.0,
            f"recall: surfaces within {100 * NEAR_M:.0f} cm of a map point",
            LEAST_SHARE,
        ),
    )
    for axis, (key, scale, label, limit) in zip(axes, panels, strict=True):
        for name in summary["methods"]:
            values = [scale * record["methods"][name][key] for record in records]
            if values:
                axis.ecdf(values, label=name, **line_style(name))
        # a line along either end is not to lie on the frame
        axis.set(xlabel=label, ylim=(-0.02, 1.02))
        if key == "ate_m":
            axis.set_xscale("log")
            label_decades(axis.xaxis)
        else:
            spread_near_one(axis)
        _shade_failures(axis, limit, is_more_worse=key == "ate_m")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("share of the trials")
    legend_below(figure, axes[0], ncols=2 + len(summary["methods"]))
    trials = summary["trials"]
    figure.suptitle("map of 1 trial" if trials == 1 else f"maps of {trials} trials")
    return figure


def _shade_failures(axis: Axes, limit: float, *, is_more_worse: bool) -> None:
    """What a map is not good enough with, beyond a limit."""
    low, high = axis.get_xlim()
    axis.axvline(limit, color="#000000", ls="--", lw=1.0, label="needed")
    worse = (limit, max(high, 1.5 * limit)) if is_more_worse else (min(low, limit), limit)
    axis.axvspan(*worse, color=_WRONG, alpha=0.12, lw=0.0, label="not good enough")
    axis.set_xlim(min(low, worse[0]), max(high, worse[1]))


def _title(result: MappingResult, index: int) -> str:
    way_m = np.hypot(*np.diff(result.true_poses[:, :2], axis=0).T).sum()
    place = plain(Path(result.config.place).stem)
    return f"trial {index} in {place}: {way_m:.0f} m in {result.sim_s:.0f} s, {_people(result)}"


def _people(result: MappingResult) -> str:
    return f"{result.people} people" if result.people else "nobody else there"


def _draw_truth(axis: Axes, result: MappingResult) -> None:
    _draw_walls(axis, result)
    path = result.true_poses[:, :2]
    axis.plot(*path.T, color=_TRACK, lw=1.4)
    for step in _steps(path):
        axis.annotate(
            "", path[step + 1], path[step], arrowprops={"arrowstyle": "-|>", "color": _TRACK}
        )
    axis.plot(*path[0], "o", color=_TRACK, ms=6)
    axis.set_title("(a) true map, and the track driven", fontsize=10)


def _steps(path: FloatArray) -> list[int]:
    """Where arrows stand on a path (N, 2): evenly along it, in the middle of a motion."""
    steps_m = np.hypot(*np.diff(path, axis=0).T)
    way_m = np.cumsum(steps_m)
    wanted = way_m[-1] * (np.arange(_ARROWS) + 0.5) / _ARROWS
    return [int(np.searchsorted(way_m, at)) for at in wanted]


def _draw_made(axis: Axes, result: MappingResult, name: str, title: str) -> None:
    outcome: MapOutcome = result.outcomes[name]
    _draw_walls(axis, result)
    is_wrong = true_map(result.config).is_wrong(outcome.points_m)
    style: dict[str, Any] = {"ls": "", "marker": ".", "ms": 2.0, "mew": 0.0, "rasterized": True}
    axis.plot(
        *outcome.points_m[~is_wrong].T, color=_MAP, label="map, within 5 cm of a surface", **style
    )
    axis.plot(
        *outcome.points_m[is_wrong].T, color=_WRONG,
        label=f"map, {100 * NEAR_M:.0f} cm and more off", **style | {"ms": 2.0 if is_wrong.sum() > _MANY else 6.0},
    )  # fmt: skip
    axis.plot(
        *outcome.missed_m.T, color=_MISSED, label="surface in view that the map lacks", **style | {"marker": "s", "ms": 3.0},
    )  # fmt: skip
    axis.plot(*result.true_poses[:, :2].T, color=_TRACK, lw=1.4, label="where it drove")
    axis.plot(*outcome.path_m.T, color=_WAY, lw=1.4, ls="--", label="where it thinks it drove")
    quality = outcome.quality
    said = (
        "called failed" if outcome.is_called_failed else "good" if outcome.is_good else "not good"
    )
    axis.set_title(
        f"{title}: {said}\nATE {1000 * outcome.ate.position_m.rmse:.0f} mm,"
        f" precision {quality.precision:.3f}, recall {quality.recall:.3f}",
        fontsize=10,
    )


def _draw_walls(axis: Axes, result: MappingResult) -> None:
    segments_m = true_map(result.config).place_map.segments_m
    axis.add_collection(LineCollection(list(segments_m), colors=_TRUE, lw=0.8, label="true map"))
    lower, upper = segments_m.min(axis=(0, 1)), segments_m.max(axis=(0, 1))
    axis.set(
        xlim=(lower[0] - 0.3, upper[0] + 0.3), ylim=(lower[1] - 0.3, upper[1] + 0.3),
        xlabel="x [m]", ylabel="y [m]",
    )  # fmt: skip
    axis.set_aspect("equal")

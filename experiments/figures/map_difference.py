"""The paper's Fig. 7 with what it leaves to the eye: the true map, the built one, the difference."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from experiments.figures.canvas import colour
from experiments.kept_maps import KeptMap, KeptTrial
from slam.arrays import FloatArray

_TRUE, _WAY, _MISSED = "#444444", "#e69f00", "#cc00cc"
_OFF = LinearSegmentedColormap.from_list("off", ["#6baed6", "#f2a900", "#b00020"])
_MOST_OFF_CM = 10.0
"""Chosen: where the colours end; twice what a good map may be off."""


def map_difference_drawn(trial: KeptTrial, methods: tuple[str, ...]) -> Figure:
    """(a) the true map and the track driven, (b) what each method built, (c) how far it is off."""
    lower, upper = trial.segments_m.min(axis=(0, 1)), trial.segments_m.max(axis=(0, 1))
    width_m, height_m = upper - lower + 0.6
    panel_in = 4.2
    row_in = min(panel_in * float(height_m / width_m), 2.0 * panel_in) + 0.35
    figure, axes = plt.subplots(
        len(methods), 3, figsize=(3 * panel_in + 0.9, row_in * len(methods) + 0.4), squeeze=False,
        sharex=True, sharey=True, layout="constrained",
    )  # fmt: skip
    marks = None
    for row, name in zip(axes, methods, strict=True):
        one = trial.maps[name]
        _walls(row[0], trial.segments_m)
        row[0].plot(*trial.true_path_m.T, color=_WAY, lw=1.2)
        row[0].plot(*trial.true_path_m[0], "o", color=_WAY, ms=5)
        row[1].plot(*one.points_m.T, ".", ms=2.2, mew=0, color="#000000", rasterized=True)
        row[1].plot(*one.path_m.T, color=colour(name), lw=1.0)
        marks = _difference(row[2], trial.segments_m, one)
        titles = ("(a) true map, and the track driven", f"(b) built by {name}", "difference")
        for axis, title in zip(row, titles, strict=True):
            axis.set_title(title, fontsize=10)
            axis.set_aspect("equal")
        row[0].set_ylabel("y [m]")
    for axis in axes[-1]:
        axis.set_xlabel("x [m]")
    axes[0][0].set(xlim=(lower[0] - 0.3, upper[0] + 0.3), ylim=(lower[1] - 0.3, upper[1] + 0.3))
    assert marks is not None
    figure.colorbar(
        marks, ax=axes, extend="max", pad=0.01, label="map point off the nearest true surface [cm]"
    )
    return figure


def _difference(axis: Axes, segments_m: FloatArray, one: KeptMap) -> Any:
    """Points by how far they are off, the farthest on top; magenta: what the map lacks."""
    _walls(axis, segments_m)
    axis.plot(*one.missed_m.T, "s", ms=2.5, mew=0, color=_MISSED, rasterized=True)
    order = np.argsort(one.off_m)
    x, y = one.points_m[order].T
    return axis.scatter(
        x, y, c=100 * one.off_m[order], s=3, lw=0, cmap=_OFF, vmin=0.0,
        vmax=_MOST_OFF_CM, rasterized=True,
    )  # fmt: skip


def _walls(axis: Axes, segments_m: FloatArray) -> None:
    axis.add_collection(LineCollection(list(segments_m), colors=_TRUE, lw=0.8))

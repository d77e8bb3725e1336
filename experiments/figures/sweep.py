"""The figure of a sweep: success and error over what is varied, with 95 % bands."""

import json
import textwrap
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from experiments.figures.canvas import colour, legend_below, plain, saved

_MARKERS = "os^Dvp*X"
_SHADES = "viridis"
_LETTERS_PER_INCH = 13.0


def sweep_figure(folder: Path) -> Path:
    """Draws `sweep.json`: the first thing varied along the axis, all others line by line.

    One thing varied: a line for each method. More: a column of panels for each method.
    """
    sweep = json.loads((folder / "sweep.json").read_text())
    name, *others = sweep["varied"]
    methods = list(sweep["cells"][0]["methods"])
    columns = [[method] for method in methods] if others else [methods]
    width = max(6.4, 3.6 * len(columns))
    figure, axes = plt.subplots(
        2, len(columns), figsize=(width, 6.4), squeeze=False,
        sharex=True, sharey="row", layout="constrained",
    )  # fmt: skip
    for column, shown in zip(axes.T, columns, strict=True):
        for method in shown:
            _draw(column, sweep, name, others, method)
        if others:
            column[0].set_title(method)
        column[1].set_xlabel(plain(name))
    axes[0, 0].set_ylabel("success rate")
    axes[1, 0].set_ylabel("position RMSE [mm]")
    title = f"{sweep['experiment']}, seed {sweep['seed']}. {plain(sweep['interval'])}"
    figure.suptitle(textwrap.fill(title, int(_LETTERS_PER_INCH * width)), fontsize=9)
    legend_below(figure, axes[0, 0], 4)
    return saved(figure, folder / "sweep")


def _draw(column: Any, sweep: dict[str, Any], name: str, others: list[str], method: str) -> None:
    """A method's lines in its two panels."""
    values = sweep["varied"][name]
    lines: dict[tuple[str, ...], dict[str, dict[str, Any]]] = {}
    for cell in sweep["cells"]:
        key = tuple(cell["values"][other] for other in others)
        lines.setdefault(key, {})[cell["values"][name]] = cell["methods"][method]
    shades = plt.get_cmap(_SHADES)
    for number, (key, told) in enumerate(lines.items()):
        shade = shades(0.9 * number / max(1, len(lines) - 1)) if others else colour(method)
        label = ", ".join(f"{o} {v}" for o, v in zip(others, key, strict=True)) or method
        style = {"color": shade, "marker": _MARKERS[number % len(_MARKERS)], "ms": 4}
        for axis, figure in zip(column, ("success", "rmse_mm"), strict=True):
            _line(axis, values, told, figure, label=plain(label), **style)


def _line(
    axis: Axes, values: list[str], told: dict[str, dict[str, Any]], figure: str, **style: Any
) -> None:
    at = _positions(axis, values)
    middle = "success_rate" if figure == "success" else figure
    points = [
        (at[value], one[middle], one[f"{figure}_low"], one[f"{figure}_high"])
        for value, one in told.items()
        if one[middle] is not None
    ]
    points.sort()
    if not points:
        return
    x, y, low, high = zip(*points, strict=True)
    axis.plot(x, y, lw=1.6, **style)
    if None not in low:
        axis.fill_between(x, low, high, color=style["color"], alpha=0.15, lw=0)
        axis.vlines(x, low, high, color=style["color"], lw=0.8)
    axis.grid(visible=True, alpha=0.3)


def _positions(axis: Axes, values: list[str]) -> dict[str, float]:
    """Where values lie along the axis: numbers where they are, names side by side."""
    try:
        numbers = [float(value) for value in values]
    except ValueError:
        axis.set_xticks(range(len(values)), [plain(Path(value).stem) for value in values])
        return {value: float(at) for at, value in enumerate(values)}
    axis.set_xticks(numbers, values)
    return dict(zip(values, numbers, strict=True))

"""What becomes of the error where robot or world are not as assumed."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from experiments.figures.canvas import label_decades, saved
from experiments.worlds import MISMATCHES

_STATES: dict[str, tuple[str, float, dict[str, Any]]] = {
    "still": ("RMSE, robot stands", -0.2, {"color": "#00913a", "marker": "o", "ms": 10}),
    "moving": ("RMSE, robot drives", 0.2, {"color": "#1f77b4", "marker": "D", "ms": 8}),
}
"""Key of a row: in words, place beside the row's middle, mark."""
_TICK: dict[str, Any] = {"color": "#000000", "ls": "none", "marker": "|", "ms": 18, "mew": 3.0}
_COLUMNS = {"RMSE": 0.16, "/ bound": 0.34, "NEES": 0.51, "warned": 0.76, "failed": 1.0}
"""Right ends of the columns of text, in widths of their panel."""


def mismatch_figure(path: Path, rows: Sequence[dict[str, Any]]) -> Path:
    """The RMSE of a method under each mismatch, standing and driving, beside the bound.

    rows: {mismatch, still, moving}, the latter two with rmse_mm, crlb_mm, crlb_ratio, nees (or None
    each), failures, trials, warned. Writes the PNG named by path and an SVG beside it.
    """
    figure, (axis, table) = plt.subplots(
        1, 2, figsize=(13, 1.6 + 0.8 * len(rows)), width_ratios=(1.5, 1), sharey=True,
        layout="constrained",
    )  # fmt: skip
    axis.set(xscale="log", xlabel="RMSE of the position [mm]", xlim=_limits(rows))
    label_decades(axis.xaxis)
    axis.set_ylim(len(rows) - 0.45, -0.55)  # the first on top
    axis.set_yticks(range(len(rows)), [_label(row["mismatch"]) for row in rows])
    axis.tick_params(axis="y", length=0)
    axis.grid(axis="x", color="#e4e4e4", lw=0.7)
    axis.set_axisbelow(True)
    table.set_axis_off()
    for title, x in _COLUMNS.items():
        _text(table, x, -0.62, title, va="bottom", color="#555555")
    for middle, row in enumerate(rows):
        if middle:
            for panel in (axis, table):
                panel.axhline(middle - 0.5, color="#bbbbbb", lw=0.7)
        for state in _STATES:
            _draw_row(axis, table, middle, state, row[state])
    figure.suptitle("What a wrong assumption costs: error beside the bound, and is it noticed?")
    _legend(figure)
    return saved(figure, path.with_suffix(""))


def _draw_row(axis: Axes, table: Axes, middle: int, state: str, result: dict[str, Any]) -> None:
    _, offset, mark = _STATES[state]
    y = middle + offset
    rmse_mm, crlb_mm = result["rmse_mm"], result["crlb_mm"]
    if crlb_mm is not None:
        axis.plot(crlb_mm, y, **_TICK)
    if rmse_mm is not None:
        axis.plot(rmse_mm, y, **mark, ls="none", zorder=4)
    if rmse_mm is not None and crlb_mm is not None:
        # on a logarithmic axis its length is the ratio
        axis.plot([crlb_mm, rmse_mm], [y, y], color=mark["color"], lw=4.0, alpha=0.5)
    trials = result["trials"]
    texts = {
        "RMSE": _number(result["rmse_mm"], 2, " mm"),
        "/ bound": _number(result["crlb_ratio"], 2),
        "NEES": _number(result["nees"], 1),
        "warned": f"{result['warned']} of {trials}",
        "failed": f"{result['failures']} of {trials}",
    }
    for title, text in texts.items():
        _text(table, _COLUMNS[title], y, text, va="center")


def _text(table: Axes, x: float, y: float, text: str, **style: Any) -> None:
    table.text(x, y, text, ha="right", fontsize=9, transform=table.get_yaxis_transform(), **style)


def _legend(figure: Any) -> None:
    handles = [Line2D([], [], **mark, lw=4.0) for _, _, mark in _STATES.values()]
    handles.append(Line2D([], [], **_TICK))
    labels = [words for words, _, _ in _STATES.values()]
    labels.append("Cramer-Rao bound of one scan; the line to it is the ratio")
    figure.legend(
        handles, labels, loc="outside lower center", ncols=3, fontsize=9,
        title="NEES: 3 on average where the claimed covariance is honest", title_fontsize=9,
    )  # fmt: skip


def _limits(rows: Sequence[dict[str, Any]]) -> tuple[float, float]:
    values = [
        row[state][key]
        for row in rows
        for state in _STATES
        for key in ("rmse_mm", "crlb_mm")
        if row[state][key]
    ]
    return (0.5 * min(values), 1.4 * max(values)) if values else (0.1, 100.0)


def _label(mismatch: str) -> str:
    return f"{mismatch}\n{MISMATCHES.get(mismatch, '')}".rstrip()


def _number(value: float | None, digits: int, unit: str = "") -> str:
    return "-" if value is None else f"{value:.{digits}f}{unit}"

"""What all figures share: matplotlib without a display, the methods' colours, equal files."""

import io
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")  # a file is all that is wanted, display or not

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from slam.files.whole_files import write_whole

COLOURS = {
    "odometry": "#7f7f7f",
    "line": "#9467bd",
    "paper": "#d62728",
    "open3d": "#1f77b4",
    "fast": "#ff8c1a",
    "limit": "#00913a",
    "limit_unfused": "#4fb3a5",
    "limit_skewed": "#b5a642",
}
_FALLBACK_COLOUR = "#8c564b"
_DASHED = {"limit_unfused": (0, (5, 1.5)), "limit_skewed": (0, (2, 1.2))}
"""Variants of a method, told from it by more than a shade."""
_LEAST_LACK = 0.001
"""Chosen: a share that lacks less of 1 lies beside 1."""
_SHARES = (0.0, 0.5, 0.8, 0.9, 0.97, 0.99, 0.997, 1.0)
"""Marks along such an axis, evenly enough for their numbers."""
BOUND_STYLE: dict[str, Any] = {"color": "#000000", "lw": 3.2, "zorder": 5}


def colour(method: str) -> str:
    """The method's colour, the same in all figures."""
    return COLOURS.get(method, _FALLBACK_COLOUR)


def line_style(method: str) -> dict[str, Any]:
    """The method's line: `limit` above all others, and thicker."""
    is_limit = method == "limit"
    return {
        "color": colour(method),
        "ls": _DASHED.get(method, "-"),
        "lw": 2.6 if is_limit else 1.6,
        "zorder": 6 if is_limit else 4,
    }


def height_by_width(low: np.ndarray, high: np.ndarray, highest: float = 1.3) -> float:
    """Of a panel that shows the plane from corner (2,) to corner (2,), at least 0.4."""
    width, height = np.maximum(high - low, 1e-9)
    return float(min(max(height / width, 0.4), highest))


def plain(name: str) -> str:
    """A name as it stands in a figure: the dollars in it begin no formula."""
    return name.replace("$", r"\$")


def label_decades(axis: Axis) -> None:
    """Plain numbers along a logarithmic axis: 0.5, 1, 2, 5, 10 and so on."""
    low, high = axis.get_view_interval()
    subs = (1.0, 2.0, 5.0) if high < 1000 * low else (1.0,)
    axis.set_major_locator(LogLocator(subs=subs, numticks=30))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def spread_near_one(axes: Axes) -> None:
    """Shares along x by what they lack of 1, so that 0.99 and 1 lie apart whatever else is drawn.

    The logarithm of what is lacking, and of `_LEAST_LACK` with it, so that 1 has a place as well.
    """
    low, _ = axes.get_xlim()
    axes.set_xscale("function", functions=(_lack_decades, _share_of_decades))
    # and nothing on the frame
    axes.set_xlim(_share_of_decades(_lack_decades(min(low, 0.96)) - 0.05), 1.0 + 0.1 * _LEAST_LACK)
    axes.set_xticks([share for share in _SHARES if share >= axes.get_xlim()[0]])
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _lack_decades(share: Any) -> Any:
    return -np.log10(np.maximum(1.0 - np.asarray(share) + _LEAST_LACK, 0.1 * _LEAST_LACK))


def _share_of_decades(decades: Any) -> Any:
    return 1.0 + _LEAST_LACK - 10.0 ** -np.asarray(decades)


def legend_below(figure: Any, axis: Axes, ncols: int) -> None:
    """One legend for all panels, which have the same things in them."""
    handles, labels = axis.get_legend_handles_labels()
    legend = figure.legend(handles, labels, loc="outside lower center", ncols=ncols, fontsize=8)
    for handle in legend.legend_handles:
        if isinstance(handle, Line2D):
            handle.set_markersize(6)


def saved(figure: Any, stem: Path) -> Path:
    """Writes a figure as PNG and SVG. No dates or random names: equal figures, equal files."""
    path = stem.with_name(stem.name + ".png")
    figure.savefig(path, dpi=130, metadata={"Software": None})
    with plt.rc_context({"svg.hashsalt": stem.name}):
        figure.savefig(stem.with_name(stem.name + ".svg"), metadata={"Date": None})
    plt.close(figure)
    return path


def image_file(path: Path, pixels: np.ndarray) -> Path:
    """Writes pixels (H, W, 3) as PNG, whatever the file is called; whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    encoded = io.BytesIO()
    plt.imsave(encoded, pixels, format="png")
    write_whole(path, encoded.getvalue())
    return path

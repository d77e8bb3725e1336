"""The figures of a run, drawn from its files alone, and the picture of one trial."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")  # a file is all that is wanted, display or not

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Rectangle

from experiments.real_logs import RealLogResult
from experiments.tables import TITLES
from experiments.trials import TrialConfig, TrialResult
from kitasap_sim.robot import KITASAP2
from slam.se2 import SE2

_LIMIT_CM = 4.0
_COLOURS = {"odometry": "#7f7f7f", "line": "#9467bd", "paper": "#d62728", "open3d": "#1f77b4"}
_FALLBACK_COLOUR = "#2ca02c"


def scatter(folder: Path) -> Path:
    """Like the paper's Fig. 5: the error of every trial in x and y [cm], a panel for each method.

    Reads `trials.csv` and `summary.json` of the folder; writes `scatter.png` and `scatter.svg`.
    """
    summary = json.loads((folder / "summary.json").read_text())
    with (folder / "trials.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["status"] == "ok"]
    methods = list(summary["methods"])
    figure, axes = plt.subplots(
        1, len(methods), figsize=(3.4 * len(methods), 4.2), squeeze=False, layout="constrained"
    )
    for axis, method in zip(axes[0], methods, strict=True):
        errors_cm = 100 * np.array(
            [
                [float(row["x_error_m"]), float(row["y_error_m"])]
                for row in rows
                if row["method"] == method
            ]
        ).reshape(-1, 2)
        _scatter_panel(axis, method, errors_cm, summary)
    axes[0][0].set_ylabel("error in Y [cm]")
    figure.suptitle(f"{TITLES[summary['experiment']]}: estimated minus true position")
    _legend_below(figure, axes[0][0], ncols=3)
    return _saved(figure, folder / "scatter")


def _scatter_panel(axis: Axes, method: str, errors_cm: np.ndarray, summary: dict[str, Any]) -> None:
    trials, result = summary["trials"], summary["methods"][method]
    is_inside = (np.abs(errors_cm) <= _LIMIT_CM).all(axis=1)
    axis.add_patch(
        Rectangle((-3, -3), 6, 6, fill=False, ls="--", ec="#999999", label="paper's ±3 cm")
    )
    paper = summary["paper_values"]
    axis.add_patch(
        Ellipse(
            (paper["x_cm"]["mean"], paper["y_cm"]["mean"]),
            *(4 * paper[key]["std"] for key in ("x_cm", "y_cm")),
            fc="#ffbb66", ec="#cc7700", alpha=0.5, label="paper's mean, ±2 sd",
        )
    )  # fmt: skip
    axis.plot(
        *errors_cm[is_inside].T, "o", ms=3.5, mew=0, alpha=0.6,
        color=_COLOURS.get(method, _FALLBACK_COLOUR), label="ours, a dot for each trial",
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


def trial_picture(folder: Path, config: TrialConfig, result: TrialResult, index: int) -> Path:
    """The room with one trial in it: scans before and after, and the path of each method's search.

    Writes `trial_<index>.png` and `.svg` into the folder.
    """
    names = [name for name in config.methods if len(result.outcomes[name].match.history) > 0]
    names = names or list(config.methods[:1])
    figure, axes = plt.subplots(
        1, len(names), figsize=(5.2 * len(names), 6.2), squeeze=False, layout="constrained"
    )
    for axis, name in zip(axes[0], names, strict=True):
        _draw_trial(axis, config, result, name)
    figure.suptitle(
        f"trial {index} in {Path(config.place).stem}: "
        + ("lifted from (1) and set down at (2)" if len(result.true_poses) > 1 else "at rest")
    )
    _legend_below(figure, axes[0][0], ncols=min(4, 2 * len(names)))
    return _saved(figure, folder / f"trial_{index}")


def _draw_trial(axis: Axes, config: TrialConfig, result: TrialResult, name: str) -> None:
    known, outcome = config.known_place, result.outcomes[name]
    axis.plot(*known.point_map.points.T, ".", ms=0.7, color="#444444", label="map")
    history = [step.T_map_base for step in outcome.match.history] or [outcome.T_map_base]
    points_base = [scan.points(known.T_base_laser) for scan in result.scans]
    here = "(2)" if len(result.scans) > 1 else "(1)"
    if len(result.scans) > 1:
        first = SE2.from_array(result.true_poses[0])
        _draw_scan(axis, points_base[0], first, "#2ca02c", "scan before, at (1)")
    _draw_scan(
        axis, points_base[-1], history[0], "#ffaa33", f"scan at {here}, seen from the first guess"
    )
    _draw_scan(
        axis, points_base[-1], history[-1], "#1f77b4", f"scan at {here}, seen from the pose found"
    )
    if len(result.scans) > 1:
        _draw_robot(axis, result.true_poses[0], "#2ca02c", "-", "robot before, at (1)")
        _number(axis, result.true_poses[0], "#2ca02c", "(1)")
    _draw_robot(axis, result.true_poses[-1], "#000000", "-", f"robot at {here}: truth")
    _number(axis, result.true_poses[-1], "#000000", here)
    _draw_robot(axis, history[-1].as_array(), "#1f77b4", "--", f"robot at {here}: pose found")
    path = np.array([T.as_array()[:2] for T in history])
    axis.plot(
        *path.T, "-", lw=1.5, color="#d62728", marker="*", ms=11, markevery=[-1],
        label="way of the search, from first guess to pose found (star)",
    )  # fmt: skip
    error_mm, error_deg = 1000 * np.hypot(*outcome.error[:2]), math.degrees(outcome.error[2])
    steps = f"{len(history)} step" + "s" * (len(history) > 1)
    verdict = "found" if outcome.is_success else "not found"
    axis.set_title(
        f"{name}: {verdict}, says '{outcome.match.status.value}'\n"
        f"off by {error_mm:.1f} mm, {error_deg:.2f} degrees after {steps}",
        fontsize=10,
    )
    lower, upper = known.place.bounds_m
    axis.set(
        xlim=(lower[0] - 0.2, upper[0] + 0.2), ylim=(lower[1] - 0.2, upper[1] + 0.2),
        xlabel="x [m]", ylabel="y [m]",
    )  # fmt: skip
    axis.set_aspect("equal")


def _draw_scan(
    axis: Axes, points_base: np.ndarray, T_map_base: SE2, colour: str, label: str
) -> None:
    points = T_map_base @ points_base
    axis.plot(*points.T, ".", ms=2, color=colour, alpha=0.6, label=label)


def _draw_robot(axis: Axes, pose: np.ndarray, colour: str, style: str, label: str) -> None:
    """A circle around all of the robot, with a line from its axle to its front."""
    turn = np.linspace(0.0, math.tau, 60)
    outline = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    shape = KITASAP2.radius_m * np.concatenate([np.zeros((1, 2)), outline])
    axis.plot(*(SE2.from_array(pose) @ shape).T, ls=style, lw=1.4, color=colour, label=label)


def _number(axis: Axes, pose: np.ndarray, colour: str, text: str) -> None:
    """The paper's number of a pose, outside the robot."""
    x, y = pose[:2] + 0.75 * KITASAP2.radius_m
    axis.annotate(text, (x, y), (1, 1), textcoords="offset points", color=colour, fontsize=11)


def image_file(path: Path, pixels: np.ndarray) -> Path:
    """Writes pixels (H, W, 3) as PNG, whatever the file is called."""
    plt.imsave(path, pixels, format="png")
    return path


def real_log_picture(folder: Path, result: RealLogResult) -> Path:
    """The map of a real log with the estimated poses on it, and those of the reference.

    Writes `localization.png` and `.svg` into the folder.
    """
    figure, axis = plt.subplots(figsize=(9, 8), layout="constrained")
    axis.plot(*result.map_points.T, ".", ms=1, color="#666666", label="map of the even scans")
    axis.plot(*result.reference[:, :2].T, "-", lw=1, color="#2ca02c", label="reference")
    matched = np.array([estimate.is_matched for estimate in result.estimates])
    positions = result.trajectory().poses[:, :2]
    axis.plot(*positions[matched].T, ".", ms=4, color=_COLOURS["open3d"], label="odd scans, found")
    if not matched.all():
        axis.plot(*positions[~matched].T, "x", ms=6, color=_COLOURS["paper"], label="lost, said so")
    axis.set(xlabel="x [m]", ylabel="y [m]", title=f"{result.name}, method open3d")
    axis.set_aspect("equal")
    axis.legend(loc="best", markerscale=2)
    return _saved(figure, folder / "localization")


def _legend_below(figure: Any, axis: Axes, ncols: int) -> None:
    """One legend for all panels, which have the same things in them."""
    handles, labels = axis.get_legend_handles_labels()
    legend = figure.legend(handles, labels, loc="outside lower center", ncols=ncols, fontsize=8)
    for handle in legend.legend_handles:
        if isinstance(handle, Line2D):
            handle.set_markersize(6)


def _saved(figure: Any, stem: Path) -> Path:
    """Writes a figure as PNG and SVG. No dates or random names within: equal figures, equal files."""
    path = stem.with_suffix(".png")
    figure.savefig(path, dpi=130, metadata={"Software": None})
    with plt.rc_context({"svg.hashsalt": stem.name}):
        figure.savefig(stem.with_suffix(".svg"), metadata={"Date": None})
    plt.close(figure)
    return path

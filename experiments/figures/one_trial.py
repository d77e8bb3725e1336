"""The picture of one trial: the room, the robot in it, and what each method made of its scan."""

import math
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from experiments.figures.canvas import height_by_width, legend_below, plain, saved
from experiments.figures.made_maps import made_maps_picture
from experiments.mapping import MappingResult
from experiments.methods import KnownPlace
from experiments.tracking import TrackingResult
from experiments.trials import TrialConfig, TrialResult
from kitasap_sim.robot import KITASAP2
from slam.se2 import SE2

_FOUND = "#1f77b4"
"""Of the beams of a scan: from the last to the first."""


def trial_picture(
    folder: Path, config: TrialConfig, result: TrialResult | MappingResult, index: int
) -> Path:
    """The room with one trial in it, a panel for each method.

    Of a robot that stands: the scans before and after, and the path of each method's search. Of a
    drive: the true and the estimated path. Of a place mapped: the maps. Writes `trial_<index>.png`
    and `.svg` into the folder.
    """
    if isinstance(result, MappingResult):
        return made_maps_picture(folder, result, index)
    if isinstance(result, TrackingResult):
        figure = _drive_figure(config, result, index)
    else:
        figure = _search_figure(config, result, index)
    return saved(figure, folder / f"trial_{index}")


def _search_figure(config: TrialConfig, result: TrialResult, index: int) -> Any:
    names = [name for name in config.methods if len(result.outcomes[name].match.history) > 0]
    names = names or list(config.methods[:1])
    # one panel alone is as wide as the title
    wide_in = 5.2 if len(names) > 1 else 7.0
    figure, axes = plt.subplots(
        1, len(names), figsize=(wide_in * len(names), _high_in(config.known_place, wide_in)),
        squeeze=False, layout="compressed",
    )  # fmt: skip
    for axis, name in zip(axes[0], names, strict=True):
        _draw_search(axis, config, result, name)
    figure.suptitle(
        f"trial {index} in {plain(Path(config.place).stem)}: "
        + ("lifted from (1) and set down at (2)" if len(result.true_poses) > 1 else "at rest")
    )
    legend_below(figure, axes[0][0], ncols=min(4, 2 * len(names)))
    return figure


def _high_in(known: KnownPlace, wide_in: float) -> float:
    """How high [in] panels of the place are that are so wide, with titles and legend."""
    low, high = known.place.bounds_m
    return wide_in * height_by_width(low, high, highest=1.5) + 1.4


def _draw_search(axis: Axes, config: TrialConfig, result: TrialResult, name: str) -> None:
    known, outcome = config.known_place, result.outcomes[name]
    _draw_map(axis, known)
    history = [step.T_map_base for step in outcome.match.history] or [outcome.T_map_base]
    points_base = result.scan_of(name).points(known.T_base_laser)
    true = outcome.T_map_base.as_array() - outcome.error
    here = "(2)" if len(result.scans) > 1 else "(1)"
    if len(result.scans) > 1:
        first = SE2.from_array(result.true_poses[0])
        points_before = result.scans[0].points(known.T_base_laser)
        _draw_scan(axis, points_before, first, "#2ca02c", "scan before, at (1)")
    _draw_scan(
        axis, points_base, history[0], "#ffaa33", f"scan at {here}, seen from the first guess"
    )
    _draw_scan(axis, points_base, history[-1], _FOUND, f"scan at {here}, seen from the pose found")
    if len(result.scans) > 1:
        _draw_robot(axis, result.true_poses[0], "#2ca02c", "-", "robot before, at (1)")
        _number(axis, result.true_poses[0], "#2ca02c", "(1)")
    _draw_robot(axis, true, "#000000", "-", f"robot at {here}: truth")
    _number(axis, true, "#000000", here)
    _draw_robot(axis, history[-1].as_array(), _FOUND, "--", f"robot at {here}: pose found")
    path = np.array([T.as_array()[:2] for T in history])
    axis.plot(
        *path.T, "-", lw=1.5, color="#d62728", marker="*", ms=11, markevery=[-1],
        label="way of the search, from first guess to pose found (star)",
    )  # fmt: skip
    error_mm, error_deg = 1000 * np.hypot(*outcome.error[:2]), math.degrees(outcome.error[2])
    steps = f"{len(history)} step" + "s" * (len(history) > 1)
    verdict = "found" if outcome.is_success else "not found"
    axis.set_title(
        f"{name}: {verdict}, says '{outcome.verdict.status.value}'\n"
        f"off by {error_mm:.1f} mm, {error_deg:.2f} degrees after {steps}",
        fontsize=10,
    )


def _drive_figure(config: TrialConfig, result: TrackingResult, index: int) -> Any:
    names = config.methods
    columns = len(names) if len(names) < 4 else math.ceil(len(names) / 2)
    lines = math.ceil(len(names) / columns)
    figure, axes = plt.subplots(
        lines, columns, figsize=(max(5.2 * columns, 7.0), 5.5 * lines + 0.9), squeeze=False,
        layout="compressed",
    )  # fmt: skip
    for axis, name in zip(axes.flat, names, strict=False):
        _draw_drive(axis, config, result, name)
    for axis in axes.flat[len(names) :]:
        axis.set_axis_off()
    figure.suptitle(
        f"trial {index} in {plain(Path(config.place).stem)}: a drive of {result.sim_s:.0f} s, "
        "true and estimated path"
    )
    legend_below(figure, axes[0][0], ncols=min(4, 2 * columns))
    return figure


def _draw_drive(axis: Axes, config: TrialConfig, result: TrackingResult, name: str) -> None:
    known, outcome, samples = config.known_place, result.outcomes[name], result.samples
    mine = [sample["methods"][name] for sample in samples]
    _draw_map(axis, known)
    _draw_scan(axis, result.points_base, outcome.T_map_base, _FOUND, "last scan, straightened")
    true = np.array([sample["true_poses"][-1][:2] for sample in samples]).reshape(-1, 2)
    found = np.array([[one["x_m"], one["y_m"]] for one in mine]).reshape(-1, 2)
    is_right = np.array([one["success"] for one in mine], dtype=bool)
    axis.plot(
        *true.T, "-o", lw=1.2, color="#000000", mfc="none", ms=7,
        label="truth, a mark for each sample",
    )  # fmt: skip
    axis.plot(*found.T, "--x", lw=1.2, color=_FOUND, ms=5, mew=1.6, label="estimate")
    axis.plot(
        *found[~is_right].T, "s", mfc="none", mec="#d62728", ms=12, mew=1.3,
        label="estimate that is wrong, or disowned by the method",
    )  # fmt: skip
    _draw_robot(axis, result.true_poses[-1], "#000000", "-", "robot at the end: truth")
    end = outcome.T_map_base.as_array()
    _draw_robot(axis, end, _FOUND, "--", "robot at the end: estimate")
    middle = true.mean(axis=0) if len(true) else np.zeros(2)
    if samples:
        _name_outside(axis, true[0], middle, 1.0, f"{samples[0]['time_s']:.0f} s")
    _name_outside(axis, result.true_poses[-1][:2], middle, 1.8, f"{result.sim_s:.0f} s")
    error_mm = 1000 * np.hypot(*outcome.error[:2])
    error_deg = abs(math.degrees(outcome.error[2]))
    axis.set_title(
        f"{name}: right at {is_right.sum()} of {len(samples)} samples\n"
        f"at the end off by {error_mm:.1f} mm, {error_deg:.2f} degrees,"
        f" says '{outcome.verdict.status.value}'",
        fontsize=10,
    )


def _draw_map(axis: Axes, known: KnownPlace) -> None:
    """The true surfaces, and axes around them."""
    # as lines: the points of the map would be megabytes of SVG
    axis.add_collection(
        LineCollection(
            list(known.segment_map.segments), colors="#444444", linewidths=1.2, label="map"
        )
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


def _name_outside(
    axis: Axes, spot: np.ndarray, middle: np.ndarray, radii: float, text: str
) -> None:
    """A spot of a path named on its side away from the middle, so many robots' radii off."""
    outward = spot - middle
    length = np.hypot(*outward)
    outward = outward / length if length > 0 else np.array([1.0, 0.0])
    x, y = spot + radii * KITASAP2.radius_m * outward
    axis.annotate(
        text, (x, y), ha="center", va="center", fontsize=11,
        bbox={"fc": "#ffffff", "ec": "none", "alpha": 0.7, "pad": 1.0},
    )  # fmt: skip

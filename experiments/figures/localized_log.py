"""The picture of a recorded log localised on a known map: where it was sure, where it was not."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from experiments.figures.canvas import height_by_width, plain, saved
from experiments.figures.grid import draw_grid
from experiments.localize import LocalizedLog
from slam.localization import Estimate
from slam.verdict import Status

_COLOURS = {Status.TRACKING: "#0072b2", Status.UNSURE: "#e69f00", Status.LOST: "#d55e00"}
_WIDTH_IN, _STRIP_IN = 9.0, 1.1
_HIGHEST = 1.2
"""Of the map's panel, height by width."""
_MARGIN_M = 0.5
_ARROWS_ACROSS = 30
"""Along the wider side of the map, at most; the way is a line, and these say where it leads."""
_MOST_REASONS = 6
"""Times of getting lost that are told in words; a log with more has them in verdicts.csv."""
_REASON_LETTERS = 105


def localized_log_picture(folder: Path, result: LocalizedLog) -> Path:
    """The map with the robot's way, coloured by its verdicts; these over time; why it got lost.

    A pose is an arrow along the heading. Where the robot was not tracking it is a best guess: open,
    and not joined to the others. Writes `localized.png` and `.svg` into the folder.
    """
    lower, upper = _window(result)
    height_in = _WIDTH_IN * height_by_width(lower, upper, _HIGHEST)
    losses = _losses(result)
    told = _told(result, losses)
    strip_in = _STRIP_IN + 0.2 * len(told)
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(_WIDTH_IN, height_in + strip_in + 1.5),
        height_ratios=[height_in, _STRIP_IN - 0.6], layout="constrained",
    )  # fmt: skip
    _draw_map(above, result)
    _draw_way(above, result)
    above.set(xlabel="x [m]", ylabel="y [m]", xlim=(lower[0], upper[0]), ylim=(lower[1], upper[1]))
    above.set_aspect("equal")
    above.set_title(_title(result), fontsize=11)
    # beside the map: no corner of it is sure to be empty
    above.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.55 / height_in), ncols=3, fontsize=8,
        frameon=False,
    )  # fmt: skip
    _draw_statuses(below, result, losses)
    if told:
        figure.supxlabel("\n".join(told), x=0.01, ha="left", fontsize=8)
    for number, index in enumerate(losses, start=1):
        if number <= _MOST_REASONS and result.estimates[index] in result.placed():
            x, y, _ = result.estimates[index].T_map_base.as_array()
            _numbered(above, number, (x, y), (14, 14))
    return saved(figure, folder / "localized")


def _title(result: LocalizedLog) -> str:
    summary = result.summary()
    took = summary["recoveries_s"]
    found = f", found after {', '.join(f'{s:.1f}' for s in took[:4])} s" if took else ""
    start = "unknown" if result.start is None else "given"
    return (
        f"{plain(result.name)} on {plain(result.map_name)}, start {start}\ntracking in {summary['tracking']} of"
        f" {summary['scans']} scans{found}{' ...' if len(took) > 4 else ''}"
    )


def _window(result: LocalizedLog) -> tuple[np.ndarray, np.ndarray]:
    """(2,) lower and upper corner of what is to be seen [m]: the walls, and all poses."""
    shown = np.concatenate([result.known.points, result.trajectory().poses[:, :2]])
    return shown.min(axis=0) - _MARGIN_M, shown.max(axis=0) + _MARGIN_M


def _draw_map(axis: Axes, result: LocalizedLog) -> None:
    if result.known.grid is not None:
        draw_grid(axis, result.known.grid)
    else:
        axis.plot(*result.known.points.T, ".", ms=1, color="#333333", zorder=1)
    if len(result.last_points):
        axis.plot(
            *result.last_points.T, ".", ms=2.5, color="#cc79a7", zorder=2, label="last scan tracked"
        )


def _draw_way(axis: Axes, result: LocalizedLog) -> None:
    """The way where it was tracked, and the poses, by verdict."""
    placed = result.placed()
    poses = result.trajectory().poses
    is_sure = np.array([e.verdict.status is Status.TRACKING for e in placed], dtype=bool)
    joined = is_sure[1:] & is_sure[:-1]
    steps = np.stack([poses[:-1, :2], poses[1:, :2]], axis=1)[joined]
    axis.add_collection(LineCollection(list(steps), colors=_COLOURS[Status.TRACKING], lw=1.2))
    ways_m = np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0, prepend=poses[:1, :2]).T))
    lower, upper = _window(result)
    spacing_m = float((upper - lower).max()) / _ARROWS_ACROSS
    is_shown = np.diff(np.floor(ways_m / spacing_m), prepend=-1.0) > 0.0
    for status in Status:
        count = result.statuses().count(status)
        mine = np.array([e.verdict.status is status for e in placed], dtype=bool)
        if status is Status.TRACKING:
            mine &= is_shown
        x, y, theta = poses[mine].T
        is_guess = status is not Status.TRACKING
        axis.quiver(
            x, y, np.cos(theta), np.sin(theta), angles="xy", units="inches",
            scale=8.0 if is_guess else 7.0, width=0.025, headwidth=4, headlength=4,
            headaxislength=3.5, lw=0.8,
            facecolor="none" if is_guess else _COLOURS[status], edgecolor=_COLOURS[status],
            zorder=3 if is_guess else 4,
        )  # fmt: skip
        guess = ", best guess" if is_guess else ""
        axis.plot(
            [], [], marker=(3, 0, -90), ms=7, ls="", color=_COLOURS[status],
            mfc="none" if is_guess else _COLOURS[status],
            label=f"{status.value}: {count} of {len(result.estimates)}{guess}",
        )  # fmt: skip
    if len(poses):
        axis.plot(*poses[0, :2], "o", ms=9, mfc="none", mec="k", zorder=5, label="first pose")
        axis.plot(*poses[-1, :2], "s", ms=9, mfc="none", mec="k", zorder=5, label="last pose")


def _draw_statuses(axis: Axes, result: LocalizedLog, losses: list[int]) -> None:
    """A band over time: each verdict holds until the next scan."""
    times_s = np.array([estimate.time_s for estimate in result.estimates])
    times_s = times_s - times_s[0]
    usual_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 1.0
    ends_s = np.append(times_s[1:], times_s[-1] + max(usual_s, 1e-3))
    statuses = result.statuses()
    for status in Status:
        mine = [
            (start, end - start)
            for start, end, said in zip(times_s, ends_s, statuses, strict=True)
            if said is status
        ]
        axis.broken_barh(mine, (0.0, 1.0), color=_COLOURS[status], lw=0)
    for number, index in enumerate(losses[:_MOST_REASONS], start=1):
        _numbered(axis, number, (times_s[index], 1.0), (0, 9))
    axis.set(xlim=(0.0, ends_s.max()), ylim=(0.0, 1.0), xlabel="time since the first scan [s]")
    axis.set_yticks([])


def _losses(result: LocalizedLog) -> list[int]:
    """The scans at which the robot got lost, having believed its pose or been told it."""
    losses, was_lost = [], result.start is None
    for index, status in enumerate(result.statuses()):
        if status is Status.LOST and not was_lost:
            losses.append(index)
            was_lost = True
        elif status is Status.TRACKING:
            was_lost = False
    return losses


def _told(result: LocalizedLog, losses: list[int]) -> list[str]:
    """Why the robot got lost, a line each time."""
    first_s = result.estimates[0].time_s
    lines = [
        f"{number}  lost at {result.estimates[index].time_s - first_s:.1f} s:"
        f" {_reason(result.estimates[index])}"
        for number, index in enumerate(losses[:_MOST_REASONS], start=1)
    ]
    if len(losses) > _MOST_REASONS:
        lines.append(f"... and {len(losses) - _MOST_REASONS} times more")
    return lines


def _reason(estimate: Estimate) -> str:
    text = next(iter(estimate.verdict.reasons), "")
    return text if len(text) <= _REASON_LETTERS else text[: _REASON_LETTERS - 3] + "..."


def _numbered(
    axis: Axes, number: int, at: tuple[float, float], offset_pt: tuple[float, float]
) -> None:
    axis.annotate(
        str(number), at, xytext=offset_pt, textcoords="offset points", ha="center", va="center",
        fontsize=8, color=_COLOURS[Status.LOST], zorder=6,
        bbox={"boxstyle": "circle,pad=0.2", "fc": "w", "ec": _COLOURS[Status.LOST]},
        arrowprops={"arrowstyle": "-", "color": _COLOURS[Status.LOST], "shrinkB": 3},
    )  # fmt: skip

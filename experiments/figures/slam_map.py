"""The picture of a log that was mapped: the map, the robot's way on it, and the loops."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from experiments.figures.canvas import height_by_width, plain, saved
from experiments.figures.grid import draw_grid
from experiments.slam_files import grid_or_reason
from experiments.slam_result import SlamLog
from slam.loop_closing import without_ties
from slam.occupancy_grid import UNKNOWN
from slam.se2 import SE2

_MARGIN_M = 1.0
_WIDTH_IN = 9.0
_REFERENCE: dict[str, Any] = {"color": "#000000", "lw": 0.8, "ls": (0, (3, 3)), "zorder": 3}


def slam_map_picture(folder: Path, result: SlamLog) -> Path:
    """The occupancy grid, the way coloured by time, loops that were kept and rejected, and the
    reference dashed, where there is one.

    Writes `slam.png` and `.svg` into the folder. Of a map that no grid holds: its points.
    """
    slam_map, (grid, _) = result.slam_map, grid_or_reason(result.slam_map)
    if grid is None:
        known = np.concatenate([slam_map.points, result.trajectory.poses[:, :2]])
    else:
        known = grid.centres_of(np.argwhere(grid.cells != UNKNOWN))
    low, high = known.min(axis=0) - _MARGIN_M, known.max(axis=0) + _MARGIN_M
    size_in = (_WIDTH_IN, _WIDTH_IN * height_by_width(low, high) + 0.6)
    figure, axes = plt.subplots(figsize=size_in, layout="compressed")
    if grid is None:
        axes.plot(*slam_map.points.T, ".", color="#333333", ms=2.0, mew=0.0, rasterized=True)
    else:
        draw_grid(axes, grid)
    _draw_loops(axes, result)
    trajectory = result.trajectory
    for number in range(slam_map.session_count - 1):
        before = slam_map.trajectory_of(number)
        # wide, so that it shows on both sides of a way driven again
        axes.plot(*before.poses[:, :2].T, color="0.6", lw=3.0, label=f"session {number + 1}")
    if slam_map.session_count > 1:
        axes.plot(
            [], [], color="#21918c", lw=1.2, label=f"session {slam_map.session_count}, by time"
        )
    way = LineCollection(
        list(np.stack([trajectory.poses[:-1, :2], trajectory.poses[1:, :2]], axis=1)),
        array=trajectory.times_s[:-1] - trajectory.times_s[0], cmap="viridis", lw=1.2,
    )  # fmt: skip
    axes.add_collection(way)
    reference = result.reference_way()
    if reference is not None:
        # above a way that is nearly the same, which shows between the dashes
        axes.plot(*reference.T, **_REFERENCE, label="reference, aligned")
    axes.plot(*trajectory.poses[0, :2], "o", color="#0072b2", ms=6, label="start")
    axes.plot(*trajectory.poses[-1, :2], "s", color="#d55e00", ms=6, label="end")
    figure.colorbar(way, ax=axes, shrink=0.6, label="time [s]")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal")
    said = result.said_of_map
    if result.is_odometry_doubted:
        said += ", by odometry as a guess alone"
    count = slam_map.session_count
    # the way is of the log alone
    of_all = f", of {count} sessions" if count > 1 else ""
    axes.set_title(
        f"{plain(result.name)}: {result.way_m:.0f} m, {len(slam_map.keyframes)} keyframes,"
        f" {len(without_ties(slam_map.loops))} loops{of_all}\nmap {said}", fontsize=10, wrap=True,
    )  # fmt: skip
    axes.legend(loc="upper right", fontsize=8)
    return saved(figure, folder / "slam")


def _draw_loops(axes: Axes, result: SlamLog) -> None:
    poses = result.slam_map.poses
    # neither is a colour of the way, from dark blue over green to yellow; those rejected are few
    for loops, colour, width, alpha, words in (
        (without_ties(result.slam_map.loops), "#e377c2", 0.5, 0.6, "loops"),
        (without_ties(result.slam_map.rejected), "#d62728", 1.6, 0.9, "rejected"),
    ):
        if not loops:
            continue
        ends = [
            (
                poses[loop.earlier, :2],
                (SE2.from_array(poses[loop.earlier]) @ loop.T_earlier_later).as_array()[:2],
            )
            for loop in loops
        ]
        axes.add_collection(
            LineCollection(list(np.array(ends)), colors=colour, lw=width, alpha=alpha)
        )
        axes.plot([], [], color=colour, label=f"{words}: {len(loops)}")

"""The picture of a recorded log localised on a known map: where it was sure, and where it was not."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from experiments.figures.canvas import saved
from experiments.localize import LocalizedLog
from slam.lost import Status

_COLOURS = {Status.TRACKING: "#0072b2", Status.UNSURE: "#e69f00", Status.LOST: "#d55e00"}
_MARKS = {Status.TRACKING: ".", Status.UNSURE: "s", Status.LOST: "x"}


def localized_log_picture(folder: Path, result: LocalizedLog) -> Path:
    """The map with the pose of each scan, coloured by its verdict, and the verdicts over time.

    Writes `localized.png` and `.svg` into the folder.
    """
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(9, 10), height_ratios=[8, 1], layout="constrained"
    )
    above.plot(*result.known.points.T, ".", ms=1, color="#777777", label="map")
    if len(result.last_points):
        above.plot(*result.last_points.T, ".", ms=3, color="#cc79a7", label="last scan tracked")
    poses, times_s = result.trajectory().poses, result.trajectory().times_s
    statuses = np.array([status.value for status in result.statuses()])
    for status in Status:
        mine = statuses == status.value
        label = f"{status.value}: {mine.sum()} of {len(mine)} scans"
        style = {"color": _COLOURS[status], "ms": 4 if status is Status.TRACKING else 5}
        above.plot(*poses[mine, :2].T, _MARKS[status], label=label, **style)
        level = list(Status).index(status)
        below.plot(times_s[mine] - times_s[0], np.full(mine.sum(), level), "|", **style)
    above.set(xlabel="x [m]", ylabel="y [m]", title=f"{result.name} on {result.map_name}")
    above.set_aspect("equal")
    above.legend(loc="best", markerscale=2)
    below.set_yticks(range(len(Status)), [status.value for status in Status])
    below.set(xlabel="time since the first scan [s]", ylim=(-0.5, len(Status) - 0.5))
    return saved(figure, folder / "localized")

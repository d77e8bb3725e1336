"""The picture of a recorded log localised on its own map."""

from pathlib import Path

import matplotlib.pyplot as plt

from experiments.figures.canvas import COLOURS, height_by_width, plain, saved
from experiments.real_logs import RealLogResult

_WIDTH_IN = 9.0


def real_log_picture(folder: Path, result: RealLogResult) -> Path:
    """The map of a real log with the estimated poses on it, and those of the reference.

    Writes `localization.png` and `.svg` into the folder.
    """
    low, high = result.map_points.min(axis=0), result.map_points.max(axis=0)
    size_in = (_WIDTH_IN, _WIDTH_IN * height_by_width(low, high) + 1.0)
    figure, axis = plt.subplots(figsize=size_in, layout="compressed")
    axis.plot(*result.map_points.T, ".", ms=1, color="#666666", label="map of the even scans")
    axis.plot(*result.reference[:, :2].T, "-", lw=1, color="#2ca02c", label="reference")
    positions = result.trajectory().poses[:, :2]
    is_told, is_believed_wrongly = result.is_told, result.is_believed_wrongly
    is_found = ~(is_told | is_believed_wrongly)
    for chosen, mark, size, colour, words in (
        (is_found, ".", 4, COLOURS["open3d"], "odd scans, found"),
        (is_told, "x", 6, COLOURS["fast"], "unsure or lost, and said so"),
        (is_believed_wrongly, "*", 10, COLOURS["paper"], "wrong, and believed"),
    ):
        if chosen.any():
            axis.plot(*positions[chosen].T, mark, ms=size, color=colour, label=words)
    axis.set(
        xlabel="x [m]", ylabel="y [m]", title=f"{plain(result.name)}, method {result.config.method}"
    )
    axis.set_aspect("equal")
    axis.legend(loc="best")
    return saved(figure, folder / "localization")

"""The picture of a recorded log localised on its own map."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from experiments.figures.canvas import COLOURS, plain, saved
from experiments.real_logs import RealLogResult


def real_log_picture(folder: Path, result: RealLogResult) -> Path:
    """The map of a real log with the estimated poses on it, and those of the reference.

    Writes `localization.png` and `.svg` into the folder.
    """
    figure, axis = plt.subplots(figsize=(9, 8), layout="constrained")
    axis.plot(*result.map_points.T, ".", ms=1, color="#666666", label="map of the even scans")
    axis.plot(*result.reference[:, :2].T, "-", lw=1, color="#2ca02c", label="reference")
    matched = np.array([estimate.is_matched for estimate in result.estimates])
    positions = result.trajectory().poses[:, :2]
    axis.plot(*positions[matched].T, ".", ms=4, color=COLOURS["open3d"], label="odd scans, found")
    if not matched.all():
        axis.plot(*positions[~matched].T, "x", ms=6, color=COLOURS["paper"], label="lost, said so")
    axis.set(
        xlabel="x [m]", ylabel="y [m]", title=f"{plain(result.name)}, method {result.config.method}"
    )
    axis.set_aspect("equal")
    axis.legend(loc="best", markerscale=2)
    return saved(figure, folder / "localization")

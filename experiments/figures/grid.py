"""How an occupancy grid looks in all figures: as in RViz."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.transforms import Affine2D

from slam.occupancy_grid import UNKNOWN, OccupancyGrid

_GREYS = ListedColormap(["#d9d9d9", "#ffffff", "#9a9a9a", "#333333"])
"""Of cells that are unknown, free, neither, and occupied."""


def draw_grid(axis: Axes, grid: OccupancyGrid) -> None:
    """Draws the grid where it lies, below all else."""
    rows, columns = grid.cells.shape
    shades = np.full(grid.cells.shape, 2)
    shades[grid.cells == UNKNOWN] = 0
    shades[grid.is_free] = 1
    shades[grid.is_occupied] = 3
    pose, cell_m = grid.T_map_grid, grid.resolution_m
    placed = Affine2D().scale(cell_m).rotate(pose.theta).translate(pose.x, pose.y)
    axis.set_facecolor(_GREYS(0))
    axis.imshow(
        shades, cmap=_GREYS, vmin=0, vmax=3, origin="lower", extent=(0.0, columns, 0.0, rows),
        interpolation="nearest", transform=placed + axis.transData, zorder=0,
    )  # fmt: skip
    # a cell narrower than a pixel of the picture is a wall all the same
    axis.plot(
        *grid.centres_of(np.argwhere(grid.is_occupied)).T, ",", color=_GREYS(3), zorder=0,
        rasterized=True, scalex=False, scaley=False,
    )  # fmt: skip

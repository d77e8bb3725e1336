"""An occupancy grid in a picture whose pixels are larger than its cells."""

import matplotlib.pyplot as plt
import numpy as np

from experiments.figures.grid import draw_grid
from slam.occupancy_grid import OccupancyGrid
from slam.se2 import SE2


def test_wall_one_cell_wide_is_seen_in_a_large_building():
    cells = np.zeros((2000, 2000), dtype=np.int8)
    cells[7::100, 100:-100] = 100
    figure, axis = plt.subplots(figsize=(3.0, 3.0), dpi=100)
    draw_grid(axis, OccupancyGrid(cells, 0.05, SE2(3.0, 2.0, 0.1)))
    axis.set(xlim=(-10.0, 110.0), ylim=(0.0, 120.0))
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3].max(axis=2)
    plt.close(figure)
    # twenty walls of 90 m, 120 m on some 230 pixels; without more, half of them fall between pixels
    assert np.count_nonzero(pixels < 100) > 20 * 90 * 230 / 120 * 0.9

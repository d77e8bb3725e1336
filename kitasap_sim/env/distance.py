"""How far it is to a spot by driving: over the free cells of a place."""

import numpy as np

from kitasap_sim.places import Place


class Distance:
    """Way from anywhere in a place to one spot (2,) [m], along the axes of its grid of free cells.

    Raises ValueError if the spot is not free.
    """

    def __init__(self, place: Place, spot_m: np.ndarray) -> None:
        self._steps, (self._x0, self._y0), self._cell_m = place.steps_to(spot_m)
        self._last_m = 0.0

    def at(self, x: float, y: float) -> float:
        """From a point [m]; beside the free cells what it was at the last of them."""
        i, j = int((x - self._x0) / self._cell_m), int((y - self._y0) / self._cell_m)
        if 0 <= i < self._steps.shape[0] and 0 <= j < self._steps.shape[1]:
            steps = int(self._steps[i, j])
            if steps >= 0:
                self._last_m = steps * self._cell_m
        return self._last_m

"""The true map of a place, for a laser at one height."""

from dataclasses import dataclass

import numpy as np

from kitasap_sim.geometry import points_on


@dataclass(frozen=True)
class PlaceMap:
    """What a laser at one height can ever see of a place.

    segments_m: (S, 2, 2) visible parts of the surfaces [m], each with its open side on the left; a
    sheet seen from both sides comes twice. points_m(spacing) samples them.
    """

    height_m: float
    segments_m: np.ndarray

    def points_m(self, spacing_m: float) -> np.ndarray:
        """(K, 2) points on the surfaces, at most spacing_m apart along each [m]."""
        points, _ = points_on(self.segments_m, spacing_m)
        _, first = np.unique(np.round(points / (spacing_m / 10)), axis=0, return_index=True)
        return points[np.sort(first)]

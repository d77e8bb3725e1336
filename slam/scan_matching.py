"""Fast scan matching: Gauss-Newton on the surfaces that a grid knows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray
from slam.kernels.surfel_matching import descend
from slam.se2 import SE2
from slam.surface.surfel_grid import SurfelGrid


@dataclass(frozen=True)
class SurfelMatchConfig:
    """How `match_surfels` searches.

    scales_m: residual at which a point counts a quarter, stage by stage: far points first draw the
    scan near, then only those that fit hold it. strides: every which point a stage looks at.
    tolerance: step [m] and [rad] that is none: a thirtieth of what one scan can tell.
    """

    scales_m: tuple[float, ...] = (0.3, 0.1, 0.0)
    strides: tuple[int, ...] = (8, 4, 1)
    max_steps: int = 15
    tolerance: float = 5e-4

    def __post_init__(self) -> None:
        if not self.scales_m or min(self.scales_m) < 0.0:
            raise ValueError(f"scales_m needs lengths of 0 or more, not {self.scales_m}")
        if len(self.strides) != len(self.scales_m) or min(self.strides) < 1:
            raise ValueError(f"strides needs one number of 1 or more for each scale, not {self}")

    @cached_property
    def stages(self) -> tuple[FloatArray, NDArray[np.int64]]:
        """scales_m and strides as arrays."""
        return np.array(self.scales_m), np.array(self.strides, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class SurfelMatch:
    """A pose, its information (3, 3) (base frame), and how well the grid's surfaces explain it.

    cost: mean over the points of 1 where no surface is near to 0 where the point lies on one.
    """

    T_map_base: SE2
    information: FloatArray
    is_settled: bool
    steps: int
    cost: float
    point_count: int


def match_surfels(
    points_base: FloatArray,
    origin_m: FloatArray,
    grid: SurfelGrid,
    noise_table: FloatArray,
    T_map_base: SE2,
    config: SurfelMatchConfig,
) -> SurfelMatch:
    """The pose near T_map_base at which the points lie on the surfaces of the grid.

    points_base: (N, 2) [m], base frame, measured from about origin_m (2,); noise_table: (K, 2)
    range and standard deviation there. Point-to-line ICP (Censi, "An ICP variant using a
    point-to-line metric", ICRA 2008) whose pairs are looked up, with the redescending kernel of
    Geman and McClure from wide to narrow.
    """
    pose, information = T_map_base.as_array(), np.zeros((3, 3))
    scales, strides = config.stages
    steps, is_settled, cost = descend(
        grid.surfels, grid.columns, grid.origin_m[0], grid.origin_m[1], 1.0 / grid.cell_m,
        grid.is_one_sided, points_base, origin_m, noise_table, scales, strides, config.max_steps, config.tolerance,
        pose, information,
    )  # fmt: skip
    count = len(points_base)
    return SurfelMatch(
        SE2(pose[0], pose[1], pose[2]),
        information,
        bool(is_settled) and count > 0,
        steps,
        cost * config.strides[-1] / max(count, 1),
        count,
    )

"""The likelihood grid of a map in several resolutions, and the search over all of its poses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.kernels.branch_and_bound import best_of_blocks, max_pooled
from slam.se2 import SE2
from slam.surface.near_cells import nearest_points, row_blocks

_MAX_BYTES = 120_000_000
"""Chosen: of all levels; 540 by 540 m of cells of 0.1 m, in four."""


@dataclass(frozen=True)
class SearchConfig:
    """How `LikelihoodGrid.search` looks for a scan's pose.

    cell_m: distance of positions looked at. sigma_m: of the likelihood about a wall; about what
    the steps of position and heading leave. top_level: nodes of the first look are 2**top_level
    cells wide. max_points: of the scan, spread evenly over what it sees. max_heading_step_rad: else
    such that the farthest of most points moves by a cell. block_headings_rad: headings that
    make one block, of which the best leaf alone is returned. keep: blocks this much worse than the
    best are left out. max_candidates: blocks returned at most.
    """

    cell_m: float = 0.1
    sigma_m: float = 0.1
    top_level: int = 3
    max_points: int = 60
    max_heading_step_rad: float = math.radians(2.0)
    min_heading_step_rad: float = math.radians(0.5)
    block_headings_rad: float = math.radians(10.0)
    keep: float = 0.65
    max_candidates: int = 64

    def __post_init__(self) -> None:
        lengths = (self.cell_m, self.sigma_m, self.min_heading_step_rad, self.block_headings_rad)
        if min(lengths) <= 0.0 or self.max_heading_step_rad < self.min_heading_step_rad:
            raise ValueError(f"cells, sigma and headings need sizes above 0, not {self}")
        if self.top_level < 1 or self.max_points < 1 or self.max_candidates < 1:
            raise ValueError(f"levels, points and candidates must be 1 or more, not {self}")
        if not 0.0 < self.keep <= 1.0:
            raise ValueError(f"keep must lie in (0, 1], not {self.keep}")


@dataclass(frozen=True)
class Candidate:
    """A pose of the grid, and the share of the points that lie on walls there, from 0 to 1."""

    T_map_base: SE2
    score: float


@dataclass(frozen=True, eq=False)
class LikelihoodGrid:
    """How well a point fits each cell of a map, 0 to 255, in several resolutions.

    levels: (L, rows * columns) uint8; level l has in each cell the maximum of the 2**l by 2**l cells
    from it upwards. is_open: (L, R, C) where positions are searched, the lower left of the padded
    grid's inner part. origin_m: (2,) lower left corner of the inner part, map frame.
    """

    levels: NDArray[np.uint8]
    is_open: BoolArray
    columns: int
    pad: int
    origin_m: FloatArray
    reach_m: float
    config: SearchConfig

    @staticmethod
    def of(
        wall_points: FloatArray,
        reach_m: float,
        is_free: Callable[[FloatArray], BoolArray],
        config: SearchConfig | None = None,
    ) -> LikelihoodGrid:
        """The grid of walls sampled at points (K, 2) [m], for scans that reach so far.

        is_free: says of positions (P, 2) whether the robot may be there. Raises ValueError for a
        map without points, or one too large for memory.
        """
        config = config or SearchConfig()
        cell = config.cell_m
        lower, inner, pad, reach_m = layout(wall_points, reach_m, config)
        columns, rows = (inner + 2 * pad).tolist()
        x = lower[0] + (np.arange(columns) - pad + 0.5) * cell
        y = lower[1] + (np.arange(rows) - pad + 0.5) * cell
        level = np.zeros(rows * columns, dtype=np.uint8)
        for cells, distances_m, _ in nearest_points(wall_points, x, y, 4.0 * config.sigma_m):
            values = np.exp(-0.5 * np.square(distances_m / config.sigma_m))
            level[cells] = np.rint(255.0 * values)
        x, y = x[pad : pad + inner[0]], y[pad : pad + inner[1]]
        opened = np.empty((len(y), len(x)), dtype=np.uint8)
        for part in row_blocks(*opened.shape):
            xs, ys = np.meshgrid(x, y[part])
            free = is_free(np.column_stack([xs.ravel(), ys.ravel()]))
            opened[part] = free.reshape(xs.shape)
        levels, is_open = [level.reshape(rows, columns)], [opened]
        for k in range(config.top_level):
            levels.append(max_pooled(levels[-1], 1 << k))
            is_open.append(max_pooled(is_open[-1], 1 << k))
        return LikelihoodGrid(
            np.stack(levels).reshape(config.top_level + 1, -1), np.stack(is_open) > 0,
            columns, pad, lower, reach_m, config,
        )  # fmt: skip

    def search(self, points_base: FloatArray) -> list[Candidate]:
        """The best poses of a scan's points (N, 2) [m], base frame, one of each block, best first.

        Exactly those that an exhaustive search would return; equal scores in the order of blocks.
        Empty where there are no points within reach.
        """
        points = spread(points_base, self.config.cell_m, self.config.max_points, self.reach_m)
        if len(points) == 0:
            return []
        headings = self.headings(points)
        offsets = self.offsets(points, headings)
        group = max(1, round(self.config.block_headings_rad * len(headings) / (2.0 * math.pi)))
        side = 1 << self.config.top_level
        rows, columns = self.is_open.shape[1:]
        shape = rows // side, columns // side, -(-len(headings) // group)
        best, leaves = np.empty(shape, np.int64), np.empty(shape, np.int64)
        best_of_blocks(
            self.levels, self.is_open, self.columns, self.pad, offsets, group,
            self.config.keep, self.config.max_candidates, best, leaves,
        )  # fmt: skip
        return self.candidates(best.ravel(), leaves.ravel(), headings, len(points))

    def candidates(
        self, best: NDArray[np.int64], leaves: NDArray[np.int64], headings: FloatArray, count: int
    ) -> list[Candidate]:
        """Those of the blocks' best leaves that are kept, best first; count: of the points."""
        least = max(1, math.ceil(self.config.keep * int(best.max(initial=0))))
        blocks = np.flatnonzero(best >= least)
        blocks = blocks[np.argsort(-best[blocks], kind="stable")][: self.config.max_candidates]
        columns = self.is_open.shape[2]
        found = []
        for block in blocks:
            cell, heading = divmod(int(leaves[block]), len(headings))
            row, column = divmod(cell, columns)
            x, y = self.origin_m + (np.array([column, row]) + 0.5) * self.config.cell_m
            score = int(best[block]) / (255.0 * count)
            found.append(Candidate(SE2(x, y, headings[heading]), score))
        return found

    def headings(self, points: FloatArray) -> FloatArray:
        """(H,) evenly around, so close that most points move by a cell at most."""
        config = self.config
        far_m = float(np.percentile(np.hypot(*points.T), 75.0))
        step = config.cell_m / max(far_m, 1e-6)
        step = min(max(step, config.min_heading_step_rad), config.max_heading_step_rad)
        count = math.ceil(2.0 * math.pi / step)
        return np.asarray(np.arange(count) * (2.0 * math.pi / count), dtype=np.float64)

    def offsets(self, points: FloatArray, headings: FloatArray) -> NDArray[np.int32]:
        """(H, N) by how many cells of the flat grid each point lies off a position's cell."""
        c, s = np.cos(headings)[:, np.newaxis], np.sin(headings)[:, np.newaxis]
        columns = np.rint((c * points[:, 0] - s * points[:, 1]) / self.config.cell_m)
        rows = np.rint((s * points[:, 0] + c * points[:, 1]) / self.config.cell_m)
        return (rows * self.columns + columns).astype(np.int32)


def layout(
    wall_points: FloatArray, reach_m: float, config: SearchConfig
) -> tuple[FloatArray, IntArray, int, float]:
    """Lower left corner [m] and (columns, rows) of the inner part, cells around it, and the reach
    [m] that they are for, of the grid of walls within the box of points (K, 2).

    Raises ValueError as `LikelihoodGrid.of`.
    """
    if len(wall_points) == 0:
        raise ValueError("the map has no walls: there is nothing to search in")
    cell = config.cell_m
    lower = np.floor(wall_points.min(axis=0) / cell) * cell
    upper = wall_points.max(axis=0)
    side = 1 << config.top_level
    inner = (np.ceil(np.ceil((upper - lower) / cell + 1e-9) / side) * side).astype(np.int64)
    reach_m = min(reach_m, float(np.hypot(*(upper - lower))) + cell)
    pad = math.ceil(reach_m / cell) + side + 1
    columns, rows = (inner + 2 * pad).tolist()
    if rows * columns * (config.top_level + 1) > _MAX_BYTES:
        raise ValueError(
            f"a map of {inner[0] * cell:.0f} by {inner[1] * cell:.0f} m makes a grid of"
            f" {rows} by {columns} cells, too large to search: choose a larger cell_m"
        )
    return lower, inner, pad, reach_m


def spread(points: FloatArray, cell_m: float, max_points: int, reach_m: float) -> FloatArray:
    """(M, 2) of points (N, 2): the first in each cell, at most max_points evenly in their order.

    Near walls have many beams on them: each length of wall counts once.
    """
    points = points[np.hypot(*points.T) < reach_m]
    if len(points) == 0:
        return points
    cells = np.floor(points / cell_m).astype(np.int64)
    _, first = np.unique(cells[:, 0] * (1 << 32) + cells[:, 1], return_index=True)
    first.sort()
    if len(first) > max_points:
        first = first[np.linspace(0, len(first) - 1, max_points).astype(int)]
    return points[first]

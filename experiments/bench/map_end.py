"""How the map of a log ended whose true poses are known: right or wrong, good or failed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.table import Table

from slam.metrics.spread import Spread
from slam.slam_map import SlamMap

MOST_RMSE_M, MOST_M = 0.15, 0.5
"""Position error of a right map's scans: what issue 5 asks of whole logs, of buildings 37 to 72 m
large."""


@dataclass(frozen=True)
class MapEnd:
    """How a log was mapped. of: what it was, in words; rmse_m, max_m: position error of its scans;
    drift_m: what the map says of itself; most_rmse_m, most_m: errors of a right map."""

    of: str
    scans: int
    is_good: bool
    reasons: tuple[str, ...]
    rmse_m: float
    max_m: float
    drift_m: float
    most_rmse_m: float
    most_m: float

    @staticmethod
    def judged(
        of: str, slam_map: SlamMap, errors: Spread, most_rmse_m: float, most_m: float
    ) -> MapEnd:
        """Of a map whose scans are off by these errors [m]."""
        verdict = slam_map.verdict
        return MapEnd(
            of, len(slam_map.steps), verdict.is_good, verdict.reasons, errors.rmse, errors.max,
            slam_map.drift_m, most_rmse_m, most_m,
        )  # fmt: skip

    @property
    def is_right(self) -> bool:
        """Whether the map is right, whatever it is called."""
        return self.rmse_m <= self.most_rmse_m and self.max_m < self.most_m

    @property
    def is_deceptive(self) -> bool:
        """Wrong, and called good: the one end that must not be."""
        return self.is_good and not self.is_right


def table_of(found: Sequence[MapEnd], of: str, title: str, caption: str) -> Table:
    """How maps ended, for people to read. of: what the first column is of, in a word."""
    table = Table(title=title, caption=caption)
    numbers = ("scans", "RMS, most", "by its own account")
    for column in (of, *numbers, "the map is", "and is called"):
        table.add_column(column, justify="right" if column in numbers else "left")
    for one in found:
        table.add_row(
            one.of, str(one.scans), f"{one.rmse_m:.3f} m, {one.max_m:.2f} m",
            f"{one.drift_m:.2f} m", "right" if one.is_right else "wrong",
            "GOOD" if one.is_deceptive else "good" if one.is_good else f"failed: {one.reasons[0]}",
        )  # fmt: skip
    return table

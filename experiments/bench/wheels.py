"""`kitasap bench wheels LOG`: what wheels calibrated from the drive are worth to a log's map."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.table import Table

from experiments.progress import CountProgress
from experiments.slam_wheels import CalibratedLog, calibrated_log, map_spread_m
from experiments.tables import wide_console
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.readers.log import Log
from slam.readers.recognition import read_log
from slam.slam_map import SlamMap

_LOST = 0.1
"""Share of the beams left out of each scan, others in each repeat. Chosen: loops are closed by chance
where walls are far and thin, so that one map by itself tells little of the wheels."""


@dataclass(frozen=True)
class WheelWorth:
    """What maps by some wheels are like. alone_m: RMS of walls about themselves by the wheels alone;
    spread_m: of the map of each repeat, nan where no wall was seen twice; good: how many are good."""

    name: str
    alone_m: float | None
    spread_m: tuple[float, ...]
    good: int

    @property
    def mean_m(self) -> float:
        """Of the maps' spreads."""
        return float(np.mean(self.spread_m))

    @property
    def error_m(self) -> float:
        """Standard error of that mean."""
        return float(np.std(self.spread_m, ddof=1)) / math.sqrt(len(self.spread_m))


def print_benchmark(log_path: Path, repeats: int, seed: int) -> tuple[WheelWorth, WheelWorth]:
    """Measures and prints the table. Raises ValueError for a log without ticks, or too short."""
    log = read_log(log_path)
    log.check_sees()
    calibrated = calibrated_log(log)
    if calibrated is None:
        raise ValueError(
            f"{log_path}: expected a log of encoder ticks (the format of mines-exp2), long enough to"
            " calibrate wheels from; this one tells none, or turns too little"
        )
    worth = measured(log, calibrated, repeats, seed)
    wide_console().print(_table(log.name, worth, repeats, seed))
    return worth


def measured(
    log: Log, calibrated: CalibratedLog, repeats: int, seed: int
) -> tuple[WheelWorth, WheelWorth]:
    """By the wheels assumed, and by those found from the drive: the same beams are left out."""
    alone = dict(zip(("assumed", "found"), calibrated.spread_m, strict=True))
    ways = (("assumed", log, None), ("found", calibrated.log, calibrated.mapper))
    worth, done = [], 0
    with CountProgress("wheels", 2 * repeats) as progress:
        for name, one, config in ways:
            maps = []
            for children in np.random.SeedSequence(seed).spawn(repeats):
                maps.append(_mapped(one, config, np.random.default_rng(children)))
                done += 1
                progress.update(done, f"map by the wheels {name}")
            spreads_m = tuple(map_spread_m(slam_map) or math.nan for slam_map in maps)
            good = sum(slam_map.verdict.is_good for slam_map in maps)
            worth.append(WheelWorth(name, alone[name], spreads_m, good))
    return worth[0], worth[1]


def _mapped(log: Log, config: MapperConfig | None, rng: np.random.Generator) -> SlamMap:
    mapper = Mapper(log.T_base_laser, config)
    for one in _thinned(log, rng):
        mapper.update(one)
    return mapper.finish()


def _thinned(log: Log, rng: np.random.Generator) -> Iterator[Measurement]:
    """The log, some of the beams of each scan lost."""
    for one in log.measurements():
        is_lost = rng.random(len(one.scan.ranges_m)) < _LOST
        ranges_m = np.where(is_lost, np.nan, one.scan.ranges_m)
        yield replace(one, scan=replace(one.scan, ranges_m=ranges_m))


def _table(name: str, worth: tuple[WheelWorth, WheelWorth], repeats: int, seed: int) -> Table:
    table = Table(
        title=f"{name} by the wheels assumed and by those found from the drive, seed {seed}",
        caption=f"RMS of walls about where they were seen before. Maps: mean of {repeats}, each with"
        f" another {_LOST:.0%} of the beams left out, and its standard error.",
    )
    for column in ("wheels", "walls by the wheels alone", "walls of the map", "maps that are good"):
        table.add_column(column, justify="left" if column == "wheels" else "right")
    for one in worth:
        alone = "-" if one.alone_m is None else f"{1000 * one.alone_m:.0f} mm"
        table.add_row(
            one.name, alone, f"{1000 * one.mean_m:.0f} +- {1000 * one.error_m:.0f} mm",
            f"{one.good} of {repeats}",
        )  # fmt: skip
    return table

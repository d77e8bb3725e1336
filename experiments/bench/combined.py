"""`kitasap bench combined LOG`: a log by another sensor, and damaged as well, ends in a right map, or in one that is
called failed."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np

from experiments.bench import damage, sensors
from experiments.bench.changed_logs import Case, print_ends, read_referenced
from experiments.bench.log_changes import in_turn
from slam.trajectory import Trajectory


def print_benchmark(log_path: Path, reference: Path, pairs: int, seed: int) -> bool:
    """Changes, maps and prints the table; whether no wrong map was called good.

    Raises ValueError for files that are not what they should be, for a log that is too short to be
    damaged by each of the sensors, and for more pairs than there are.
    """
    log, against = read_referenced(log_path, reference)
    # driven backwards it is as long
    changed = (change(log, np.random.default_rng(0)) for change in sensors.SENSORS.values())
    damage.check_length(log_path, min(one.scan_count for one in changed))
    title = f"{log.name} by other sensors and damaged, {pairs} pairs, seed {seed}"
    return print_ends(log, against, cases(against, pairs, seed), 1, seed, "combined", title)


def cases(against: Trajectory, pairs: int, seed: int) -> list[Case]:
    """So many pairs of a sensor and a damage, each at most once, drawn.

    Raises ValueError for more than there are.
    """
    every = [
        Case(f"{by.of}; {of}", in_turn(by.change, damaged), by.against)
        for by, (of, damaged) in product(sensors.cases(against), damage.DAMAGES.items())
    ]
    if pairs > len(every):
        raise ValueError(f"--pairs: expected at most {len(every)}, which is all, got {pairs}")
    drawn = np.random.default_rng(seed).permutation(len(every))
    return [every[index] for index in drawn[:pairs]]

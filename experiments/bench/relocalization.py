"""Processor time of one query of the whole map, and how often its first answer is right."""

import time
from collections.abc import Callable

import numpy as np
from rich.markup import escape
from rich.table import Table

from experiments.progress import CountProgress
from experiments.sources import MeasurementSource
from experiments.tables import wide_console
from experiments.trials import TrialConfig
from slam.beams import Beams
from slam.se2 import SE2

PLACES = ("room_fig4", "symmetric_room", "round_room", "place_fig6")


def print_benchmark(laser: str, people: int, trials: int, seed: int) -> None:
    """Prints the table over the places that ship."""
    table = Table(title=f"One scan asked for its pose, no prior: {laser}, {people} people")
    for column in ("place", "walls", "search [ms]", "query [ms]", "p99 [ms]", "first is right"):
        table.add_column(escape(column), justify="left" if column == "place" else "right")
    with CountProgress("queries", trials * len(PLACES)) as progress:
        for number, place in enumerate(PLACES):

            def on_trial(trial: int, before: int = number * trials, place: str = place) -> None:
                progress.update(before + trial + 1, place)

            config = TrialConfig(place=place, laser=laser, people=people)
            search_ms, query_ms, right = measured(config, trials, seed, on_trial)
            table.add_row(
                place, str(len(config.known_place.segment_map)), f"{np.median(search_ms):.1f}",
                f"{np.median(query_ms):.1f}", f"{np.percentile(query_ms, 99):.1f}",
                f"{right} of {trials}",
            )  # fmt: skip
    wide_console().print(table)


def measured(
    config: TrialConfig, trials: int, seed: int, on_trial: Callable[[int], None] | None = None
) -> tuple[np.ndarray, np.ndarray, int]:
    """CPU time of the search alone and of the whole query, (trials,) each [ms], and how many of the
    first answers lie within the success limits. Compiled beforehand.

    on_trial: told of each trial's number, -1 for that which compiles.
    """
    known, rng = config.known_place, np.random.default_rng(seed)
    search_ms, query_ms, right = np.empty(trials), np.empty(trials), 0
    for trial in range(-1, trials):
        simulation = config.simulation(rng.spawn(1)[0])
        simulation.reset(known.place.draw_free_pose(rng))
        source = MeasurementSource(known.laser, simulation.wheel_ticks())
        beams = Beams.of(source.measurement(simulation.next_frame()).scan, known.T_base_laser)
        started_s = time.process_time()
        known.relocalizer.grid.search(beams.points)
        searched_s = time.process_time()
        found = known.relocalizer(beams)
        ended_s = time.process_time()
        if on_trial is not None:
            on_trial(trial)
        if trial < 0:  # that one compiled
            continue
        search_ms[trial] = 1000.0 * (searched_s - started_s)
        query_ms[trial] = 1000.0 * (ended_s - searched_s)
        true = SE2.from_array(simulation.truth().pose)
        right += bool(found) and found[0].T_map_base.is_near(
            true, config.success_m, config.success_rad
        )
    return search_ms, query_ms, right

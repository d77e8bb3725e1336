"""A film of one trial: the robot with its beams, and beside it the map as the robot has it."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from experiments.film_drawing import KEPT, VIEW_PX, Frames
from experiments.film_shots import Event, Seen, Shot, Sweep, shots
from experiments.mapping import MappingResult
from experiments.observer import TrialObserver
from experiments.trials import Outcome, TrialConfig, TrialResult
from experiments.video import FRAMES_PER_S, write_video
from kitasap_sim.moments import Moment
from kitasap_sim.rendering import Renderer, View
from kitasap_sim.simulation import SensorFrame, Simulation
from slam.se2 import SE2

_MOST_FRAMES = {".mp4": 450, ".gif": 150}
"""Chosen: 45 s and 15 s; a longer trial is shown in time lapse."""
_GIF_COLOURS, _GIF_WIDEST_PX = 96, 800
_BELIEVED = (0.12, 0.44, 0.82)
_CLEAR_M = 1.2
"""Chosen: above a wall so far behind, the camera sees the robot."""
_CLOSE = 0.5
"""Of a place, a way that takes less is looked at from near by."""


class TrialFilm(TrialObserver):
    """Keeps what a trial shows; `write` makes a film of it. method: the one whose estimates it has."""

    def __init__(self, method: str) -> None:
        self._method = method
        self._events: list[Event] = []
        self._due_s = 0.0

    def begins(self, simulation: Simulation, T_map_base: SE2) -> None:
        """Watches the robot from here on."""
        self._simulation, self._start = simulation, T_map_base
        self._ticks = simulation.wheel_ticks()
        self._see(simulation)
        simulation.watch(self._see)

    def frame(self, frame: SensorFrame, true_pose: np.ndarray) -> None:
        """Keeps one more sweep."""
        self._events.append(Sweep(frame, Moment.of(self._simulation)))

    def estimates(self, outcomes: Mapping[str, Outcome]) -> None:
        """Keeps what the method made of it."""
        if self._method in outcomes:
            self._events.append(outcomes[self._method])

    def _see(self, simulation: Simulation) -> None:
        if simulation.time_s >= self._due_s - simulation.timestep_s / 2:
            self._events.append(Moment.of(simulation))
            self._due_s = max(self._due_s, simulation.time_s - 0.5 / FRAMES_PER_S)
            self._due_s += 1.0 / FRAMES_PER_S

    def write(
        self,
        path: Path,
        config: TrialConfig,
        result: TrialResult | MappingResult,
        title: str,
        on_frame: Callable[[int, int], None] = lambda index, count: None,
    ) -> None:
        """Writes the film, .mp4 or .gif. title: begins with the experiment's name. on_frame: told which frame is drawn, of how
        many."""
        seen = self.seen(title.split()[0], config, result)
        frames = self._frames(seen, path, title, on_frame)
        write_video(path, frames, _GIF_COLOURS, _GIF_WIDEST_PX, KEPT)

    def seen(
        self, experiment: str, config: TrialConfig, result: TrialResult | MappingResult
    ) -> Seen:
        """All of it, once the trial is over."""
        self._simulation.watch(None)
        return Seen(
            experiment, self._method, config, result, self._start, self._ticks, self._events
        )

    def _frames(
        self, seen: Seen, path: Path, title: str, on_frame: Callable[[int, int], None]
    ) -> Iterator[np.ndarray]:
        is_mapping = isinstance(seen.result, MappingResult)
        frames = Frames(seen.config.known_place, title, is_mapping=is_mapping)
        camera = _camera(self._simulation, self._events)
        last: tuple[Shot, np.ndarray] | None = None
        with Renderer(self._simulation, camera, VIEW_PX, is_quick=True) as renderer:
            told = list(shots(seen, _MOST_FRAMES[path.suffix.lower()]))
            for index, shot in enumerate(told):
                # what stands still is drawn once
                if last is None or not _looks_alike(last[0], shot):
                    marks = [(shot.believed.as_array(), _BELIEVED)]
                    last = shot, renderer.drawn(shot.moment.beams_m, marks, shot.moment)
                yield frames.drawn(shot, last[1])
                on_frame(index, len(told))


def _looks_alike(one: Shot, other: Shot) -> bool:
    return one.moment is other.moment and one.believed == other.believed


def _camera(simulation: Simulation, events: list[Event]) -> View | None:
    """From near by, if the robot goes not far; else as the place is looked at."""
    way_m = np.array([event.pose[:2] for event in events if isinstance(event, Moment)])
    lower, upper = way_m.min(axis=0), way_m.max(axis=0)
    place_m = np.ptp(simulation.place.bounds_m, axis=0)
    if (upper - lower > _CLOSE * place_m).any():
        return None
    x, y = (lower + upper) / 2
    reach_m = float(np.hypot(*(upper - lower)))
    # from a side where no wall of the place stands between
    low, high = simulation.place.bounds_m
    rooms_m = {90.0: lower[1] - low[1], 0.0: lower[0] - low[0], 180.0: high[0] - upper[0]}
    azimuth_deg = next((side for side, room_m in rooms_m.items() if room_m > _CLEAR_M), 270.0)
    return View((float(x), float(y), 0.2), 2.2 + 1.4 * reach_m, azimuth_deg, -40.0)

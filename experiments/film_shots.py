"""What a film of a trial shows, frame by frame: told from what was seen of the trial."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from experiments.mapping import MappingResult
from experiments.sources import MeasurementSource
from experiments.trials import Outcome, TrialConfig, TrialResult
from kitasap_sim.moments import Moment
from kitasap_sim.simulation import SensorFrame
from slam.arrays import FloatArray
from slam.se2 import SE2
from slam.straightening import Straightener
from slam.verdict import Status

_MOVES_M, _MOVES_RAD = 0.002, 0.005
"""Chosen: from one moment to the next."""
_SCAN_FRAMES, _SEARCH_FRAMES, _VERDICT_FRAMES, _END_FRAMES = 8, 6, 14, 20
"""Chosen: how long a frame that is to be read stands, at ten in a second."""
_STANDING = ("localization", "kidnap")
"""Experiments in which the robot thinks while it stands: the film stands with it."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """What the sensors said, and where everything was then."""

    frame: SensorFrame
    moment: Moment


Event = Moment | Sweep | Outcome
"""What was seen: where everything was, a sweep, or what a method made of the last one."""


@dataclass(frozen=True, eq=False)
class Shot:
    """What one frame shows. doing: what happens, in words; status: what the robot says of its pose,
    None as long as it says nothing; words: why. believed, odometry: poses; points_m: (N, 2) the last
    scan as seen from the believed pose; candidates: other poses it may be at; cloud_m: (K, 2) points
    that a map is made of, those of this frame alone; is_finished: they are the whole map. lapse: so many times faster than it was."""

    moment: Moment
    doing: str
    believed: SE2
    odometry: SE2
    points_m: FloatArray
    status: Status | None = None
    words: str = ""
    candidates: tuple[SE2, ...] = ()
    cloud_m: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    is_finished: bool = False
    lapse: int = 1


@dataclass(frozen=True, eq=False)
class Seen:
    """All that was seen of a trial. start: the pose believed at first; ticks: (2,) of the encoders."""

    experiment: str
    method: str
    config: TrialConfig
    result: TrialResult | MappingResult
    start: SE2
    ticks: np.ndarray
    events: list[Event]


def shots(seen: Seen, most: int) -> Iterator[Shot]:
    """The film, ten frames in a second; a long trial in time lapse, about so many frames at most."""
    count = sum(isinstance(event, Moment) for event in seen.events)
    return _Telling(seen, max(1, -(-count // most))).shots()


class _Telling:
    """Follows the events; knows at each what the robot believed."""

    def __init__(self, seen: Seen, lapse: int) -> None:
        known = seen.config.known_place
        self._seen, self._lapse = seen, lapse
        self._source = MeasurementSource(known.laser, seen.ticks)
        self._straightener = Straightener(known.T_base_laser)
        self._odometry, self._odometry_then, self._estimate = seen.start, seen.start, seen.start
        self._points_base: FloatArray = np.empty((0, 2))
        self._status: Status | None = None
        self._words, self._candidates = "", tuple[SE2, ...]()
        self._cloud: list[FloatArray] = []
        self._is_finished, self._T_world_map = False, SE2.identity()
        self._mapped = self._take_map(seen.result)

    def shots(self) -> Iterator[Shot]:
        """Frame by frame."""
        moment, shot, count = None, None, 0
        for event in self._seen.events:
            if isinstance(event, Sweep):
                self._sweep(event.frame)
                moment = event.moment
            elif isinstance(event, Outcome):
                assert moment is not None
                if self._seen.experiment in _STANDING:
                    yield from self._thinks(moment, event)
                self._take(event)
            else:
                doing, moment = _doing(moment, event), event
                count += 1
                if (count - 1) % self._lapse == 0:
                    shot = self._shot(moment, doing)
                    yield shot
        if shot is not None and moment is not None:
            self._conclude()
            for _ in range(_END_FRAMES):
                yield replace(self._shot(moment, "At the end"), lapse=1)

    @property
    def _believed(self) -> SE2:
        """The last estimate, carried on by the wheels."""
        return self._estimate @ self._odometry_then.inverse() @ self._odometry

    def _shot(self, moment: Moment, doing: str) -> Shot:
        cloud_m = np.concatenate([np.empty((0, 2)), *self._cloud])
        self._cloud = []
        words = "as of its last scan, before" if moment.is_held else self._words
        return Shot(
            moment, doing, self._believed, self._odometry, self._believed @ self._points_base,
            self._status, words, self._candidates, cloud_m, self._is_finished, self._lapse,
        )  # fmt: skip

    def _sweep(self, frame: SensorFrame) -> None:
        measurement = self._source.measurement(frame)
        scan, motion = measurement.scan, measurement.motion
        duration_s = self._straightener.duration_s(frame.time_s, motion)
        self._straightener.take_motion(frame.time_s, scan.beam_times_s, motion, duration_s)
        self._points_base = self._straightener.beams(scan).points
        self._odometry = self._odometry @ motion
        if self._mapped:
            self._estimate, self._odometry_then = self._mapped.pop(0), self._odometry
            self._cloud.append(self._estimate @ self._points_base)

    def _take(self, outcome: Outcome) -> None:
        self._estimate, self._odometry_then = outcome.T_map_base, self._odometry
        self._status, self._words = outcome.verdict.status, ", ".join(outcome.verdict.reasons[:1])
        places = outcome.verdict.hypotheses if self._status is not Status.TRACKING else ()
        self._candidates = tuple(place.T_map_base for place in places)

    def _thinks(self, moment: Moment, outcome: Outcome) -> Iterator[Shot]:
        """The film stands: the scan as seen from where the robot believed to be, the search, and
        what came of it."""
        before = self._shot(moment, "At rest: one scan is looked at")
        before = replace(before, status=None, words="a scan, as seen from the pose believed")
        yield from [before] * _SCAN_FRAMES
        steps = [step.T_map_base for step in outcome.match.history]
        if len(steps) > 1 and outcome.verdict.status is Status.TRACKING:
            for number in np.linspace(0, len(steps) - 1, min(len(steps), _SEARCH_FRAMES)):
                T = steps[round(number)]
                yield replace(
                    before, believed=T, points_m=T @ self._points_base,
                    words=f"matching it to the map, step {round(number) + 1} of {len(steps)}",
                )  # fmt: skip
        self._take(outcome)
        yield from [self._shot(moment, "At rest: one scan is looked at")] * _VERDICT_FRAMES

    def _take_map(self, result: TrialResult | MappingResult) -> list[SE2]:
        """Of a place mapped, the pose of each sweep as the finished map has it, in the world."""
        if not isinstance(result, MappingResult):
            return []
        poses = [
            SE2.from_array(p) for p in result.outcomes[self._seen.method].made.trajectory.poses
        ]
        self._T_world_map = T_world_map = SE2.from_array(result.true_poses[0]) @ poses[0].inverse()
        self._odometry = self._odometry_then = self._estimate = T_world_map @ self._seen.start
        self._words = "poses of the map when finished"
        return [T_world_map @ pose for pose in poses]

    def _conclude(self) -> None:
        if isinstance(self._seen.result, MappingResult):
            made = self._seen.result.outcomes[self._seen.method].made
            self._cloud, self._is_finished = [self._T_world_map @ made.points], True
            self._points_base = np.empty((0, 2))
            self._words, verdict = "the finished map", made.verdict
            if verdict is not None:
                self._status = Status.TRACKING if verdict.is_good else Status.LOST
                self._words = ", ".join(verdict.reasons[:1]) or "the map is called good"


def _doing(before: Moment | None, now: Moment) -> str:
    if now.is_held:
        return "Lifted, and carried off by hand"
    if before is None:
        return "At rest"
    moved = (SE2.from_array(before.pose).inverse() @ SE2.from_array(now.pose)).log()
    passed = max(1.0, (now.time_s - before.time_s) * 10)
    if np.hypot(moved[0], moved[1]) < _MOVES_M * passed and abs(moved[2]) < _MOVES_RAD * passed:
        return "At rest"
    return "Driving"

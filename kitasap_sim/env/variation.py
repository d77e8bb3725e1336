"""What is drawn anew for each episode: the place, and how the robot is not what is believed."""

import math
from collections.abc import Iterable, Sequence, Set
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from kitasap_sim import names
from kitasap_sim.laser import LaserSpec
from kitasap_sim.place_files import place_path
from kitasap_sim.places import Place
from kitasap_sim.random_rooms import random_room
from kitasap_sim.robot import OdometryPreset, odometry_preset
from kitasap_sim.simulation import Simulation

Span = float | Sequence[float]
"""One value for all episodes, or (low, high) between which each draws its own."""

RANDOM = "random"
"""The place that is a new room in each episode."""
TWOFOLD = "twofold"
"""The same, of rooms that look alike from both ends but for one thing."""
DRAWN = (RANDOM, TWOFOLD)

_LAST_BEAM = 0.7
"""Of a control period, when the last beam is fired: as of a URG-04LX."""


@dataclass(frozen=True)
class Drawn:
    """One episode's world. beams: the laser as it is on this robot; noise: what its errors are
    drawn from. latency_s: after which a command reaches the motors."""

    place: Place
    beams: LaserSpec
    noise: np.random.Generator
    latency_s: float
    preset: OdometryPreset
    people: int
    friction: float | None
    world: np.random.Generator

    def simulation(self, pose: np.ndarray) -> Simulation:
        """The world with the robot at rest at a pose (3,): once, since people are drawn with it."""
        simulation = Simulation(
            self.place, self.beams, self.preset, rng=self.world, people=self.people, pose=pose
        )
        if self.friction is not None:
            for tire in names.TIRES:
                simulation.model.geom(tire).friction[0] = self.friction
        return simulation


@dataclass(frozen=True)
class Variation:
    """Which worlds episodes are drawn from; see `KitasapEnv` for what each keyword means.

    Raises ValueError, naming the keyword, for a value that makes no sense.
    """

    place: str | Path | Place | Sequence[str | Path | Place] = RANDOM
    difficulty: Span = 0.5
    people: Span = 0
    odometry: str = "as_built"
    friction: Span | None = None
    wheel_radii: Span = 0.0
    laser_noise: Span = 1.0
    latency_s: Span = 0.0

    def __post_init__(self) -> None:
        odometry_preset(self.odometry)
        _checked("difficulty", self.difficulty, 0.0, 1.0)
        _checked("people", self.people, 0.0, 100.0)
        if any(float(count) != int(count) for count in _bounds(self.people)):
            raise ValueError(f"people: a whole number, or two, not {self.people}")
        if self.friction is not None:
            _checked("friction", self.friction, 0.01, 2.0)
        # on wheels that differ more from the caster the robot does not stand as it should
        _checked("wheel_radii", self.wheel_radii, -0.05, 0.05)
        _checked("laser_noise", self.laser_noise, 0.0, 100.0)
        _checked("latency_s", self.latency_s, 0.0, 1.0)
        if isinstance(self.place, Set):
            raise ValueError("place: a list of several, of which one is drawn: a set has no order")
        # read once: it may be a generator
        object.__setattr__(self, "place", self._places())
        places = self._places()
        if not places:
            raise ValueError("place: give a place, or several to draw from, not none")
        for place in places:
            _check_place(place)

    def drawn(
        self, beams: LaserSpec, rng: np.random.Generator, wanted: str | Path | Place | None
    ) -> Drawn:
        """One episode's world; wanted: its place, else one of those that there are is drawn.

        The same numbers are drawn in the same order whatever the spans: episodes stay comparable.
        """
        chosen = int(rng.integers(len(self._places())))
        difficulty, people, friction, left, right, noise, latency_s = (
            _value(span, share)
            for span, share in zip(
                (
                    self.difficulty, _up_to_whole(self.people),
                    0.0 if self.friction is None else self.friction,
                    self.wheel_radii, self.wheel_radii, self.laser_noise, self.latency_s,
                ),
                rng.random(7).tolist(), strict=True,
            )
        )  # fmt: skip
        rooms, world, errors = rng.spawn(3)
        name = self._places()[chosen] if wanted is None else wanted
        place = _place(name, difficulty, rooms)
        preset = odometry_preset(self.odometry)
        preset = replace(
            preset,
            radius_error=preset.radius_error + (left + right) / 2.0,
            radius_mismatch=preset.radius_mismatch + left - right,
        )
        sigmas = tuple((at_m, noise * sigma_m) for at_m, sigma_m in beams.sigma_at_m)
        beams = replace(beams, sigma_at_m=sigmas if noise > 0.0 else ())
        return Drawn(
            place, beams, errors, latency_s, preset, int(people),
            None if self.friction is None else friction, world,
        )  # fmt: skip

    def _places(self) -> Sequence[str | Path | Place]:
        if isinstance(self.place, str | Path | Place) or not isinstance(self.place, Iterable):
            return (self.place,)
        return tuple(self.place)


_KNOWN: dict[str, Place] = {}
"""Places by name, each read once in a process: their free space takes a tenth of a second."""


def _place(name: str | Path | Place, difficulty: float, rng: np.random.Generator) -> Place:
    if isinstance(name, Place):
        return name
    if str(name) in DRAWN:
        return random_room(rng, difficulty, is_twofold=str(name) == TWOFOLD)
    if str(name) not in _KNOWN:
        _KNOWN[str(name)] = Place(name)
    return _KNOWN[str(name)]


def beams_of(spec: LaserSpec, count: int, period_s: float) -> LaserSpec:
    """A laser's view, limits and noise with so many beams, all fired once in each control period.

    count: at least 1.
    """
    view_rad = (spec.beam_count - 1) * spec.step_rad
    is_all_around = view_rad + spec.step_rad > 2.0 * math.pi - 1e-6
    step_rad = 2.0 * math.pi / count if is_all_around else view_rad / max(count - 1, 1)
    first_rad = spec.first_angle_rad
    if count == 1:
        first_rad, step_rad = first_rad + view_rad / 2.0, spec.step_rad
    # the mirror turns once in a period: delays follow from the angles
    share = (count - 1) * step_rad / (2.0 * math.pi)
    first_s = 0.0 if is_all_around else max(_LAST_BEAM - share, 0.0) * period_s
    return replace(
        spec, name=f"{spec.name}, {count} beams", beam_count=count, first_angle_rad=first_rad,
        step_rad=step_rad, period_s=period_s, first_beam_s=first_s, interlace=1,
        # neighbours are degrees apart: no spot straddles two of them
        mixed_pixel_rate=0.0,
    )  # fmt: skip


def _check_place(place: object) -> None:
    """Raises ValueError, naming the keyword, for what is no place and names none."""
    if isinstance(place, str | Path):
        try:
            if place not in DRAWN:
                place_path(str(place))
        except ValueError as error:
            raise ValueError(f"place: {error}, or {' or '.join(DRAWN)}") from None
    elif not isinstance(place, Place):
        raise ValueError(f"place: a name, the path of an MJCF file, or a Place, not {place!r}")


def _checked(name: str, span: Span, least: float, most: float) -> None:
    values = _bounds(span)
    is_number = all(
        isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
        for value in values
    )
    if not is_number or len(values) not in (1, 2) or values != sorted(values):
        raise ValueError(f"{name}: a number, or two of which the first is the lower, not {span}")
    if not (least <= values[0] and values[-1] <= most):
        raise ValueError(f"{name}: between {least:g} and {most:g}, not {span}")


def _value(span: Span, share: float) -> float:
    bounds = _bounds(span)
    low, high = float(bounds[0]), float(bounds[-1])
    return low + share * (high - low)


def _up_to_whole(span: Span) -> Span:
    """So that whole numbers from the lower to the upper are drawn alike, rounded down."""
    low, *higher = _bounds(span)
    return (low, higher[0] + 1.0 - 1e-9) if higher else low


def _bounds(span: Span) -> list[Any]:
    """The one value, or the lower and the upper; of what is neither, what `_checked` refuses."""
    return list(np.ravel(np.asarray(span, dtype=object)))

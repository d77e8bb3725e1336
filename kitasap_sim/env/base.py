"""What all driving tasks share: observations, the episode's world, what counts, pictures."""

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces

from kitasap_sim.encoders import DeadReckoning
from kitasap_sim.env.bumper import Bumper
from kitasap_sim.env.checks import finite_numbers
from kitasap_sim.env.keywords import KeepsSpec, laser_of
from kitasap_sim.env.motors import CONTROL_S, CONTROLS, Motors, checked_action
from kitasap_sim.env.variation import RANDOM, Span, Variation, beams_of
from kitasap_sim.laser import LaserSpec, measured_ranges
from kitasap_sim.places import Place
from kitasap_sim.robot import KITASAP2
from kitasap_sim.simulation import Simulation

_FASTEST = (1.5, 6.0)
"""Bounds of what encoders may tell of speed and turn rate: tires may slip."""
_FARTHEST_M = 1000.0
SCAN_M = 30.0
"""A scan tells of nothing beyond it, however far the laser sees. Chosen."""
MOST_BEAMS = 4096
"""Chosen: more than any laser sold has; a million would take more memory than there is."""

COLLISION_COST = 5.0
"""Chosen: more than any episode's way is worth."""
SUCCESS_REWARD = 5.0
"""Chosen: a collision undoes it."""

Observation = dict[str, np.ndarray]


class KitasapEnv(KeepsSpec, gymnasium.Env[Observation, np.ndarray]):
    """Base of the tasks: Kitasap2 driven at 20 Hz in a place, by what its sensors tell.

    ## Action: Box(-1, 1, (2,), float32)

    | n | `control="twist"` (default) | `control="wheels"` | at 1 |
    |---|---|---|---|
    | 0 | forward speed | speed of the left wheel | 0.5 m/s; 10.3 rad/s |
    | 1 | turn rate, counter-clockwise | speed of the right wheel | 1.5 rad/s; 10.3 rad/s |

    The motor controller follows by 1 m/s2 and 4 rad/s2. Values beyond the bounds are clipped to
    them; nan, inf or another shape raise ValueError and nothing moves.

    ## Observation: Dict of float32 boxes

    | key | shape | bounds | what |
    |---|---|---|---|
    | `scan` | (beams,) | 0 to the laser's range [m] | by increasing angle |
    | `odometry` | (3,) | +-1000 m, +-pi | x, y [m], heading [rad] since the start by the encoders |
    | `velocity` | (2,) | +-1.5 m/s, +-6 rad/s | forward speed, turn rate in the last step by them |
    | `last_action` | (2,) | -1 to 1 | the last action, clipped |

    No return and lost beams read the range, at most 30 m, too near ones 0. `odometry` is in the
    frame of the start: it drifts. Tasks add keys of their own. Truth is in `info` alone.

    ## Info, the same keys with every reset and step

    `is_success`, `success` (one value under two names), `collision`, `pose_true` (3,),
    `pose_odometry` (3,) in the world, `min_range_m` of the true beams, `time_s`, `reward_terms`
    (dict of floats that add up to the reward; zeros with reset).

    ## Keywords

    `place`: a name, the path of an MJCF file, a `Place`, or several to draw from; "random" is a new
    room in each episode, "twofold" one that looks alike from both ends but for one thing. `difficulty`: of random rooms, 0 to 1. `beams`, `laser`: how many (up to
    4096) of whose view, range and noise, each fired once in a step; a name, or a `LaserSpec`. `control`. `people`: who walk about.
    Domain randomisation: `difficulty`, `people`, `friction` of the tires (0.8), `wheel_radii`
    (share by which each is truly larger, 0, at most 0.05), `laser_noise` (times the laser's sigma,
    1) and `latency_s` (0) take one value, or (low, high) between which each episode draws its own.
    `odometry`: a preset.

    `reset(options={"pose": (x, y, heading), "place": ...})` sets where it starts.

    A collision (the robot touches anything but the floor) ends the episode and costs 5.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (Gymnasium declares it so)
        "render_modes": ["human", "rgb_array"],
        "render_fps": round(1.0 / CONTROL_S),
    }
    OPTIONS: ClassVar[tuple[str, ...]] = ("pose", "place")
    TERMS: ClassVar[tuple[str, ...]] = ("collision",)
    DEFAULT_PLACE: ClassVar[str] = RANDOM

    def __init__(
        self,
        render_mode: str | None = None,
        *,
        place: str | Path | Place | Sequence[str | Path | Place] | None = None,
        difficulty: Span = 0.5,
        beams: int = 60,
        laser: str | LaserSpec | Mapping[str, Any] = "urg_04lx",
        control: str = "twist",
        people: Span = 0,
        odometry: str = "as_built",
        friction: Span | None = None,
        wheel_radii: Span = 0.0,
        laser_noise: Span = 1.0,
        latency_s: Span = 0.0,
    ) -> None:
        """Raises ValueError, naming the keyword, for a value that makes no sense."""
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(
                f"render_mode: {' or '.join(self.metadata['render_modes'])}, not {render_mode}"
            )
        if control not in CONTROLS:
            raise ValueError(f"control: {' or '.join(CONTROLS)}, not {control}")
        self.render_mode = render_mode
        self.control = control
        self.variation = Variation(
            self.DEFAULT_PLACE if place is None else place, difficulty, people, odometry, friction,
            wheel_radii, laser_noise, latency_s,
        )  # fmt: skip
        # as it is sold, by which it is known; and as it is here, with beams of its own
        self.sold_laser = laser_of(laser)
        is_whole = isinstance(beams, int | np.integer) and not isinstance(beams, bool)
        if not is_whole or not 1 <= beams <= MOST_BEAMS:
            raise ValueError(f"beams: a whole number from 1 to {MOST_BEAMS}, not {beams!r}")
        self.laser = beams_of(self.sold_laser, beams, CONTROL_S)
        self._range_m = scan_range_m(self.laser)
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space: spaces.Space[Any] = spaces.Dict(
            {
                "scan": box(np.zeros(beams), np.full(beams, self._range_m)),
                "odometry": box([-_FARTHEST_M, -_FARTHEST_M, -math.pi]),
                "velocity": box([-_FASTEST[0], -_FASTEST[1]]),
                "last_action": box([-1.0, -1.0]),
                **self._spaces(),
            }
        )
        self._sim: Simulation | None = None
        self._place: Place | None = None
        self._renderer: Any = None
        self._is_picture_old = False

    # what a task says

    def _spaces(self) -> dict[str, spaces.Box]:
        """The observations that a task adds."""
        return {}

    @abstractmethod
    def _begin(self, options: dict[str, Any]) -> np.ndarray:
        """Draws the task in `self.place`; the pose (3,) at which the robot starts."""

    def _started(self) -> None:
        """Notes what a task needs to know once the robot stands."""

    @abstractmethod
    def _rewarded(self) -> tuple[dict[str, float], bool, bool]:
        """Terms of the last step's reward but for the collision; is it a success, is it over."""

    def _observed(self) -> Observation:
        """The observations that a task adds."""
        return {}

    def _told(self) -> dict[str, Any]:
        """What a task adds to `info`, the same keys always."""
        return {}

    # what Gymnasium asks for

    @property
    def simulation(self) -> Simulation:
        """The episode's world, truth and all: not for policies.

        Raises RuntimeError before a reset.
        """
        if self._sim is None:
            raise RuntimeError("call reset() first: there is no episode yet")
        return self._sim

    @property
    def place(self) -> Place:
        """Of this episode. Raises RuntimeError before a reset."""
        return self._place if self._place is not None else self.simulation.place

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """A new episode. Raises ValueError for options that are unknown or make no sense."""
        super().reset(seed=seed)
        options = {} if options is None else options
        if not isinstance(options, dict):
            raise ValueError(f"options: a dict with {', '.join(self.OPTIONS)}, not {options!r}")
        if unknown := set(options) - set(self.OPTIONS):
            raise ValueError(
                f"no option called {', '.join(sorted(map(str, unknown)))};"
                f" there are: {', '.join(self.OPTIONS)}"
            )
        try:
            return self._begun(options)
        except Exception:  # whatever it was goes on up; half begun this is no episode
            self._sim = self._place = None
            raise

    def _begun(self, options: dict[str, Any]) -> tuple[Observation, dict[str, Any]]:
        """What `reset` says, once its options are known to be some."""
        drawn = self.variation.drawn(self.laser, self.np_random, options.get("place"))
        self._place, self._beams, self._noise = drawn.place, drawn.beams, drawn.noise
        # closed by who draws the next one: OpenGL is the thread's that drew before
        self._is_picture_old = True
        pose = self._begin(options)
        self._sim = drawn.simulation(pose)
        self._motors = Motors(self._sim, self.control, drawn.latency_s)
        self._bumper = Bumper(self._sim)
        self._pose = _wrapped(np.asarray(pose, dtype=float))
        self._start = self._pose.copy()
        self._reckoning = DeadReckoning(self._pose, self._sim.wheel_ticks())
        self._last_odometry = self._pose.copy()
        self._velocity = (0.0, 0.0)
        self._action = np.zeros(2, dtype=np.float32)
        self._ranges_m = self._sim.true_ranges_m()
        self._collided = False
        self._started()
        if self.render_mode == "human":
            self.render()
        return self._observation(), self._info(dict.fromkeys(self.TERMS, 0.0), False)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One control period. Raises ValueError for an action that is none, and nothing moves."""
        sim = self.simulation
        self._action = checked_action(action)
        self._motors.drive(self._action)
        self._pose = sim.pose()
        self._ranges_m = sim.fan_ranges_m()
        pose = self._reckoning.update(sim.wheel_ticks())
        turned = float(pose[2] - self._last_odometry[2])
        self._velocity = (self._reckoning.moved_m / CONTROL_S, turned / CONTROL_S)
        self._last_odometry = pose
        self._collided = self._bumper.is_touched()
        terms, is_success, is_over = self._rewarded()
        terms["collision"] = -COLLISION_COST if self._collided else 0.0
        is_success = is_success and not self._collided
        if self.render_mode == "human":
            self.render()
        return (
            self._observation(), float(sum(terms.values())), is_over or self._collided, False,
            self._info(terms, is_success),
        )  # fmt: skip

    def render(self) -> np.ndarray | None:
        """(480, 640, 3) uint8 picture of the place, the beams and the goal; None where it is shown.

        Raises RenderingError if there is no OpenGL; gymnasium's warning if no mode was asked for.
        """
        if self.render_mode is None:
            gymnasium.logger.warn("render() without a render_mode: give one to gymnasium.make()")
            return None
        if self._is_picture_old:
            self._close_renderer()
        if self._renderer is None:
            from kitasap_sim.env.picture import Picture

            self._renderer = Picture(self.simulation, is_shown=self.render_mode == "human")
        result: np.ndarray | None = self._renderer.drawn(self._ranges_m, self._marks())
        return result

    def close(self) -> None:
        """Gives back what pictures hold; again does nothing."""
        self._close_renderer()

    def _marks(self) -> list[tuple[np.ndarray, tuple[float, float, float]]]:
        """Spots (x, y or x, y, heading) of the task to be drawn, each with its colour."""
        return []

    # how it is done

    def _observation(self) -> Observation:
        ranges_m = measured_ranges(self._beams, self._ranges_m, self._noise).astype(np.float32)
        np.fmin(ranges_m, self._range_m, out=ranges_m)  # of nan and a number, the number
        np.maximum(ranges_m, 0.0, out=ranges_m)
        return {
            "scan": ranges_m,
            "odometry": np.array(seen_from(self._start, self._last_odometry), dtype=np.float32),
            "velocity": np.array(self._velocity, dtype=np.float32),
            "last_action": self._action.copy(),
            **self._observed(),
        }

    def _info(self, terms: dict[str, float], is_success: bool) -> dict[str, Any]:
        return {
            "is_success": is_success,
            "success": is_success,
            "collision": self._collided,
            "pose_true": self._pose.copy(),
            "pose_odometry": _wrapped(self._last_odometry),
            "min_range_m": float(self._ranges_m.min()),
            "time_s": self._motors.time_s,
            "reward_terms": terms,
            **self._told(),
        }

    def _checked_pose(self, options: dict[str, Any], name: str) -> np.ndarray | None:
        """(3,) a pose given as an option, None where none is. Raises ValueError if not free."""
        if name not in options:
            return None
        expected = f"{name}: three finite numbers, x, y and heading"
        pose = finite_numbers(options[name], (3,), expected)
        if not self.place.is_free(pose[:2])[0]:
            raise ValueError(
                f"{name}: something stands at ({pose[0]:.2f}, {pose[1]:.2f}) of {self.place.name},"
                f" or the robot cannot get there; it needs {KITASAP2.radius_m} m of room"
            )
        return pose

    def _close_renderer(self) -> None:
        self._is_picture_old = False
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def scan_range_m(laser: LaserSpec) -> float:
    """What `scan` reads for a beam that met nothing [m]."""
    return min(laser.range_max_m, SCAN_M)


def seen_from(frame: np.ndarray, pose: np.ndarray) -> tuple[float, float, float]:
    """A pose (x, y, heading), (3,), of the world in a frame (3,) of the world."""
    (x0, y0, theta0), (x, y, theta) = frame.tolist(), pose.tolist()
    c, s, dx, dy = math.cos(theta0), math.sin(theta0), x - x0, y - y0
    return c * dx + s * dy, c * dy - s * dx, math.remainder(theta - theta0, math.tau)


def _wrapped(pose: np.ndarray) -> np.ndarray:
    x, y, theta = pose.tolist()
    return np.array([x, y, math.remainder(theta, math.tau)])


def box(low: Any, high: Any = None) -> spaces.Box:
    """A float32 box from low to high; by default as far to either side of 0."""
    low = np.asarray(low, dtype=np.float32)
    return spaces.Box(low, -low if high is None else np.asarray(high, dtype=np.float32))

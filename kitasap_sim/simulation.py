"""The robot in its place: commands in, what its sensors say out, and the truth apart from both."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from kitasap_sim import encoders, names
from kitasap_sim.laser import LaserSpec, measured_ranges
from kitasap_sim.laser import laser as laser_preset
from kitasap_sim.orientation import heading_of, turned_to
from kitasap_sim.people import TICK_S, People
from kitasap_sim.places import Place
from kitasap_sim.robot import KITASAP2, OdometryPreset, odometry_preset
from kitasap_sim.world import compiled

_SETTLE_S = 0.5
_STAND_TOLERANCE_M = 0.004
"""Two bumps of a rough floor, and what tires as worn as one likes make."""
_STAND_TOLERANCE_MPS = 0.01


@dataclass(frozen=True)
class SensorFrame:
    """All that the robot gets to know at the end of one sweep of its laser.

    time_s: when the sweep was complete; the encoders are read at this instant.
    wheel_ticks: (2,) counts of the left and the right encoder since they were switched on.
    ranges_m: (N,) by increasing angle; +inf no return, -inf too close, nan invalid (REP-117).
    beam_times_s: (N,) when each beam was fired.
    """

    time_s: float
    wheel_ticks: np.ndarray
    ranges_m: np.ndarray
    beam_times_s: np.ndarray


@dataclass(frozen=True)
class Truth:
    """The true state of the robot's frame, the middle of the drive axle; no estimator may see it.

    pose: (3,) x, y [m] and heading [rad] in the world. height_m: of the axle above the floor.
    speed_mps, turn_rate_radps: forward and about the vertical.
    """

    time_s: float
    pose: np.ndarray
    height_m: float
    speed_mps: float
    turn_rate_radps: float


class Simulation:
    """Kitasap2 in a place, stepped at 2 ms.

    place: a name, a path, or a `Place`. laser, odometry: names of presets, or one's own;
    laser None leaves the beams out. rng: all noise of the sensors and the floor's bumps.
    people: so many walk about, seen by the beams; their ways come from a generator spawned from
    rng, so all else is drawn as without them. moved_m: pieces of furniture that stand (dx, dy) [m]
    from where `place` and its map have them; `world` is the place as it really is. pose: where it
    stands at first, as of `reset`.
    Raises ValueError for an unknown name, a place that cannot be used or too many people for it.
    """

    def __init__(
        self,
        place: str | Path | Place = "room_fig4",
        laser: str | LaserSpec | None = "urg_04lx",
        odometry: str | OdometryPreset = "as_built",
        *,
        rng: np.random.Generator,
        people: int = 0,
        moved_m: Mapping[str, tuple[float, float]] | None = None,
        pose: np.ndarray | None = None,
    ) -> None:
        if people < 0:
            raise ValueError(f"people are 0 or more, not {people}")
        self.place = place if isinstance(place, Place) else Place(place)
        self.world = self.place.rearranged(moved_m) if moved_m else self.place
        self.laser = laser_preset(laser) if isinstance(laser, str) else laser
        self.odometry = odometry_preset(odometry) if isinstance(odometry, str) else odometry
        self._rng = rng
        self.model = compiled(
            self.world, self.laser, self.odometry, people, self.place.bounds_m, rng
        )
        self.data = mujoco.MjData(self.model)
        self._base = self.model.body(names.BASE).id
        self._qpos = self.model.joint(names.BASE).qposadr[0]
        self._qvel = self.model.joint(names.BASE).dofadr[0]
        self._wheel_qpos = [int(self.model.joint(name).qposadr[0]) for name in names.WHEELS]
        self._actuators = [self.model.actuator(name).id for name in names.WHEELS]
        self._find_beams()
        self._people: People | None = None
        if people:
            self._people = People(self.world, self.model, people, rng.spawn(1)[0])
        self._steps_per_tick = max(1, round(TICK_S / self.timestep_s))
        self._watcher: Callable[[Simulation], None] | None = None
        self._rest = self._settled()
        self.reset(pose)

    @property
    def time_s(self) -> float:
        """Simulated time since the last reset [s]."""
        return float(self.data.time)

    @property
    def timestep_s(self) -> float:
        """One physics step [s]."""
        return float(self.model.opt.timestep)

    def reset(self, pose: np.ndarray | None = None) -> None:
        """Puts the robot at rest at x, y [m], heading [rad] (default: the place's start), time 0.

        The first frame comes after the first sweep; the encoders start at 0. People set out anew.
        Raises ValueError if the pose is not three finite numbers, or leaves people no room.
        """
        pose = self.place.start if pose is None else np.asarray(pose, dtype=float)
        if pose.shape != (3,) or not np.isfinite(pose).all():
            raise ValueError(f"a pose is three finite numbers, x, y and heading, not {pose}")
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self._rest
        self._move_base(pose)
        self._sweep = 0
        self._steps = 0
        if self._people is not None:
            self._people.reset(pose[:2])
            self._people.put_legs(self.data)

    def drive(self, v_mps: float, w_radps: float) -> None:
        """Commands a forward speed [m/s] and a turn rate [rad/s], as the robot believes them."""
        self.drive_wheels(KITASAP2.wheel_speeds_radps(v_mps, w_radps))

    def drive_wheels(self, speeds_radps: np.ndarray) -> None:
        """Commands wheel speeds (2,), left and right [rad/s]; the motors' torque is limited."""
        # one by one: an index array costs more than all else here, and GoTo's step a hundredth
        left, right = self._actuators
        self.data.ctrl[left], self.data.ctrl[right] = speeds_radps

    def step(self) -> SensorFrame | None:
        """One physics step; the frame of the sweep that this step completed, if it did."""
        return self._stepped(1)

    def advance(self, steps: int) -> None:
        """So many physics steps, without frames: who wants the beams asks for `fan_ranges_m`."""
        self._advance(steps)

    def watch(self, watcher: "Callable[[Simulation], None] | None") -> None:
        """Whom to tell after each stretch of steps, 0.1 s at most, that comes with frames; None:
        nobody. Whoever watches must not change anything."""
        self._watcher = watcher

    def pose(self) -> np.ndarray:
        """(3,) the true x, y [m] and heading [rad] now: the pose of `truth`, with less work."""
        x, y, _, *quaternion = self.data.qpos[self._qpos : self._qpos + 7].tolist()
        return np.array([x, y, heading_of(quaternion)])

    def frames(self, duration_s: float = math.inf) -> Iterator[SensorFrame]:
        """Steps on for a while and yields each frame as it comes; commands may change between."""
        end_s = self.time_s + duration_s
        while (left_s := end_s - self.time_s) > self.timestep_s / 2:
            # sensors are computed at the start of a step: the beam at t is there one step later
            until_s = min(left_s, self._sweep_end_s - self.time_s + self.timestep_s, 0.1)
            count = max(1, round(until_s / self.timestep_s))
            frame = self._stepped(count)
            if frame is not None:
                yield frame

    def run(self, duration_s: float) -> list[SensorFrame]:
        """Steps on for a while under the present command; the frames that came."""
        return list(self.frames(duration_s))

    def next_frame(self) -> SensorFrame:
        """Steps on until a sweep is complete. Raises ValueError if the robot carries no laser."""
        if self.laser is None:
            raise ValueError("this simulation was built without a laser: there are no frames")
        return next(self.frames())

    def wheel_ticks(self) -> np.ndarray:
        """(2,) what the left and the right encoder read now."""
        left, right = self._wheel_qpos
        angles_rad = float(self.data.qpos[left]), float(self.data.qpos[right])
        return encoders.ticks(angles_rad, KITASAP2.ticks_per_turn)

    def truth(self) -> Truth:
        """The exact state now; for metrics and pictures only."""
        x, y, z, *quaternion = self.data.qpos[self._qpos : self._qpos + 7]
        heading = heading_of(np.array(quaternion))
        vx, vy = self.data.qvel[self._qvel : self._qvel + 2]
        return Truth(
            time_s=self.time_s,
            pose=np.array([x, y, heading]),
            height_m=float(z),
            speed_mps=float(vx * math.cos(heading) + vy * math.sin(heading)),
            turn_rate_radps=float(self.data.qvel[self._qvel + 5]),
        )

    def true_ranges_m(self) -> np.ndarray:
        """(N,) exact ranges of all beams at this very instant, by mj_multiRay; +inf no hit [m].

        The fast way to a scan of a robot at rest; the fan's own beams are fired one by one.
        """
        mujoco.mj_kinematics(self.model, self.data)
        origin = self.data.site(names.LASER).xpos.copy()
        directions = self.data.site_xmat[self._beam_sites].reshape(-1, 3, 3)[:, :, 2]
        count = len(self._beam_sites)
        hit, ranges_m = np.zeros(count, dtype=np.int32), np.zeros(count)
        mujoco.mj_multiRay(
            self.model, self.data, origin, directions.ravel(), None, 1, self._base,
            hit, ranges_m, None, count, mujoco.mjMAXVAL,
        )  # fmt: skip
        return np.where(ranges_m < 0, np.inf, ranges_m)

    def fan_ranges_m(self) -> np.ndarray:
        """(N,) the latest exact range of each beam of the fan; +inf no hit [m]."""
        ranges_m: np.ndarray = self.data.sensordata[self._beam_data].copy()
        ranges_m[ranges_m < 0] = np.inf
        return ranges_m

    def scatter_people(self) -> None:
        """Everybody goes elsewhere at once, clear of the robot: where it is set down, nobody stays.

        Raises ValueError if there is no room for all.
        """
        if self._people is not None:
            self._people.reset(self.truth().pose[:2])
            self._people.put_legs(self.data)

    def people_m(self) -> np.ndarray:
        """(N, 2, 2) centres of each person's left and right leg now [m]; for metrics only."""
        return np.empty((0, 2, 2)) if self._people is None else self._people.legs_m.copy()

    def _find_beams(self) -> None:
        """Where the fan lies in MuJoCo's arrays."""
        count = 0 if self.laser is None else self.laser.beam_count
        self._delays_s = np.zeros(0) if self.laser is None else self.laser.delays_s()
        beams = [names.PREFIX + names.beam(i) for i in range(count)]
        self._beam_sites = np.array([self.model.site(name).id for name in beams], dtype=int)
        sensors = np.array([self.model.sensor(name).id for name in beams], dtype=int)
        # one number each, side by side, since they were made one after the other
        first = int(self.model.sensor_adr[sensors[0]]) if count else 0
        self._beam_data = slice(first, first + count)
        assert np.array_equal(self.model.sensor_adr[sensors], np.arange(first, first + count))
        # a sensor's history with one sample is [user, cursor, time, value]
        self._beam_clock = self.model.sensor_historyadr[sensors] + 2

    def _settled(self) -> np.ndarray:
        """(nq,) the robot at rest on its tires at the start: they sink in by some micrometres."""
        mujoco.mj_resetData(self.model, self.data)
        self._move_base(self.place.start)
        mujoco.mj_step(self.model, self.data, nstep=round(_SETTLE_S / self.timestep_s))
        self._check_stand()
        rest: np.ndarray = self.data.qpos.copy()
        rest[self._wheel_qpos] = 0.0
        return rest

    def _check_stand(self) -> None:
        """Raises ValueError unless the robot stands still and upright on its wheels."""
        truth = self.truth()
        speed_mps = float(np.abs(self.data.qvel[self._qvel : self._qvel + 3]).max())
        off_m = truth.height_m - KITASAP2.axle_height_m
        if not (abs(off_m) < _STAND_TOLERANCE_M and speed_mps < _STAND_TOLERANCE_MPS):
            raise ValueError(
                f"place {self.place.name}: put down at its start, the robot does not stand on a "
                f"floor at z = 0 (axle {1000 * off_m:.1f} mm off its height after {_SETTLE_S} s): "
                "does the floor let things touch it, and is nothing in the way?"
            )

    def _move_base(self, pose: np.ndarray) -> None:
        """Sets x, y and heading, and keeps height and tilt."""
        x, y, heading = pose
        base = self.data.qpos[self._qpos : self._qpos + 7]
        base[3:] = turned_to(base[3:], heading)
        base[:2] = x, y

    @property
    def _sweep_end_s(self) -> float:
        """When the last beam of the present sweep is fired [s]."""
        if self.laser is None:
            return math.inf
        return self._sweep * self.laser.period_s + float(self._delays_s.max())

    def _stepped(self, count: int) -> SensorFrame | None:
        """Some steps; the frame of a sweep whose last beam is fired in the last of them."""
        if count > 1:
            self._advance(count - 1)
        # a step computes the sensors at its start
        is_last_of_sweep = self.time_s > self._sweep_end_s - 1e-9
        before = self._beams_now() if is_last_of_sweep else None
        self._advance(1)
        frame = None if before is None else self._frame(before)
        if self._watcher is not None:
            self._watcher(self)
        return frame

    def _advance(self, count: int) -> None:
        """Physics steps; people move at fixed times, however the steps are asked for."""
        if self._people is None:
            mujoco.mj_step(self.model, self.data, nstep=count)
            return
        while count > 0:
            taken = min(count, self._steps_per_tick - self._steps % self._steps_per_tick)
            mujoco.mj_step(self.model, self.data, nstep=taken)
            self._steps += taken
            count -= taken
            if self._steps % self._steps_per_tick == 0:
                x, y = self.data.qpos[self._qpos : self._qpos + 2].tolist()
                vx, vy = self.data.qvel[self._qvel : self._qvel + 2].tolist()
                self._people.advance((x, y), (vx, vy))
                self._people.put_legs(self.data)

    def _beams_now(self) -> tuple[np.ndarray, np.ndarray]:
        """(N,) latest exact ranges [m], and (N,) when each was taken [s]."""
        return self.fan_ranges_m(), self.data.history[self._beam_clock]

    def _frame(self, before: tuple[np.ndarray, np.ndarray]) -> SensorFrame:
        """The frame of the sweep just completed. before: the beams one step ago.

        Where a laser sees all around, that step may have fired the next sweep's first beams too.
        """
        assert self.laser is not None
        ranges_m, fired_s = self._beams_now()
        is_of_next = fired_s - self._delays_s > (self._sweep + 1) * self.laser.period_s - 1e-6
        ranges_m = np.where(is_of_next, before[0], ranges_m)
        fired_s = np.where(is_of_next, before[1], fired_s)
        self._sweep += 1
        return SensorFrame(
            time_s=self.time_s,
            wheel_ticks=self.wheel_ticks(),
            ranges_m=measured_ranges(self.laser, ranges_m, self._rng),
            beam_times_s=fired_s,
        )

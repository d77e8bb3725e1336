"""People who walk about: pairs of legs for the laser to see, that keep clear of the robot."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from kitasap_sim import names
from kitasap_sim.places import Place
from kitasap_sim.tracks import Point, Track, Tracks

TICK_S = 0.01
"""How often legs are moved; chosen: a body walks 1 cm in it, about a laser's noise."""
_ARRIVED_M = 1e-3
_TRIES = 200


@dataclass(frozen=True)
class Gait:
    """How people walk and keep away from the robot; all chosen.

    speeds_mps: each person's own is drawn between these; none is slower than the robot.
    pause_share, pauses_s: so many set out from a waypoint only after a pause drawn between these.
    patience_s: who has waited for the robot that long turns round.
    wary_m: nobody walks on where the middle of her body would come nearer than this to the
        robot's, and who stands nearer moves away.
    foresight_s: the robot counts as being wherever it will be within that time, at its speed now.
    """

    speeds_mps: tuple[float, float] = (0.6, 1.2)
    acceleration_mps2: float = 2.5
    turn_rate_radps: float = 4.0
    pause_share: float = 0.3
    pauses_s: tuple[float, float] = (1.0, 4.0)
    patience_s: float = 1.5
    wary_m: float = 0.7
    foresight_s: float = 1.0
    start_apart_m: float = 0.6
    """Nobody starts nearer than this to another, nor than wary_m and a step to the robot."""


GAIT = Gait()


class People:
    """All who walk about in one place; a person is a pair of legs, without a body or a will.

    model: with that many people in it (`world.compiled`).
    They start on ways between waypoints drawn once and for all, walk from one waypoint to the next
    in steps, wait or turn round where the robot is in the way, and move away when it comes close.
    Who is cornered stands. They do not mind each other.
    legs_m: (N, 2, 2) centres of left and right leg [m]; headings_rad: (N, 2) of the feet.
    Raises ValueError if the place is too small.
    """

    def __init__(
        self, place: Place, model: mujoco.MjModel, count: int, rng: np.random.Generator
    ) -> None:
        self._place, self._count, self._rng = place, count, rng
        bodies = [names.person(i) + leg for i in range(count) for leg in names.LEGS]
        mocap = [model.body(name).mocapid[0] for name in bodies]
        self._mocap = np.array(mocap, dtype=int).reshape(-1, 2)
        # chosen: in a lecture hall too, there are more goals than people
        self._tracks = Tracks(place, 10 + 2 * count, rng)
        self.legs_m = np.zeros((count, 2, 2))
        self.headings_rad = np.zeros((count, 2))
        self._walkers: list[_Walker] = []

    def reset(self, robot_m: np.ndarray) -> None:
        """Everybody anew, spread over the place, clear of a robot at (2,) [m].

        Raises ValueError if there is no room for all.
        """
        robot, taken_m = _Robot((robot_m[0], robot_m[1]), (0.0, 0.0), GAIT), np.empty((0, 2))
        self._walkers = []
        for _ in range(self._count):
            self._walkers.append(self._placed(robot, taken_m))
            taken_m = np.concatenate([taken_m, [self._walkers[-1].middle_m]])
        self._note_legs()

    def advance(self, robot_m: Point, velocity_mps: Point) -> None:
        """Everybody TICK_S later, the robot being there and moving with a velocity."""
        robot = _Robot(robot_m, velocity_mps, GAIT)
        for walker in self._walkers:
            walker.advance(robot)
        self._note_legs()

    def put_legs(self, data: mujoco.MjData) -> None:
        """Sets the legs' bodies where they are by now."""
        data.mocap_pos[self._mocap, :2] = self.legs_m
        data.mocap_quat[self._mocap, 0] = np.cos(self.headings_rad / 2)
        data.mocap_quat[self._mocap, 3] = np.sin(self.headings_rad / 2)

    def _placed(self, robot: "_Robot", taken_m: np.ndarray) -> "_Walker":
        """Somebody on her way, clear of the robot and of places (K, 2) already taken [m]."""
        for _ in range(_TRIES):
            track = self._tracks.draw(int(self._rng.integers(len(self._tracks))), self._rng)
            along_m = track.step_m * int(self._rng.integers(round(track.length_m / track.step_m)))
            middle_m = track.middle_m(along_m)
            is_apart = np.hypot(*(taken_m - middle_m).T) > GAIT.start_apart_m
            if robot.gap_m(middle_m) > GAIT.wary_m + track.step_m / 2 and is_apart.all():
                return _Walker(self._tracks, track, along_m, self._rng)
        count = "a person" if self._count == 1 else f"{self._count} people"
        raise ValueError(f"place {self._place.name} is too small for {count} and the robot")

    def _note_legs(self) -> None:
        legs = [walker.legs() for walker in self._walkers]
        self.legs_m[:] = [leg[:2] for leg in legs]
        self.headings_rad[:] = [leg[2:] for leg in legs]


class _Robot:
    """What people see of the robot: where it is, and where it will be soon."""

    def __init__(self, middle_m: Point, velocity_mps: Point, gait: Gait) -> None:
        (self._x, self._y), (vx, vy) = middle_m, velocity_mps
        self._dx, self._dy = vx * gait.foresight_s, vy * gait.foresight_s
        self._square = self._dx * self._dx + self._dy * self._dy

    def gap_m(self, point_m: Point) -> float:
        """From a point to the nearest spot where the robot's middle is or soon will be."""
        x, y = point_m[0] - self._x, point_m[1] - self._y
        if self._square > 1e-6:
            share = min(max((x * self._dx + y * self._dy) / self._square, 0.0), 1.0)
            x, y = x - share * self._dx, y - share * self._dy
        return math.hypot(x, y)


class _Walker:
    """One person on her track: so far along it, with a speed, perhaps turning on the spot."""

    def __init__(
        self, tracks: Tracks, track: Track, along_m: float, rng: np.random.Generator
    ) -> None:
        self._tracks, self._track, self._along_m, self._rng = tracks, track, along_m, rng
        self._pace_mps = self._speed_mps = float(rng.uniform(*GAIT.speeds_mps))
        self._aim_m = track.length_m
        self._turn_rad = self._pause_s = self._waited_s = 0.0

    @property
    def middle_m(self) -> Point:
        """Where her body is."""
        return self._track.middle_m(self._along_m)

    def legs(self) -> tuple[Point, Point, float, float]:
        """Where left and right leg stand, and their headings."""
        if not self._turn_rad:
            return self._track.legs(self._along_m)
        (x, y), heading = self.middle_m, self._track.heading_rad(self._along_m) - self._turn_rad
        (left_x, left_y), aside = self._track.legs(self._along_m)[0], heading + math.pi / 2
        radius_m = math.hypot(left_x - x, left_y - y)
        dx, dy = radius_m * math.cos(aside), radius_m * math.sin(aside)
        return (x + dx, y + dy), (x - dx, y - dy), heading, heading

    def advance(self, robot: _Robot) -> None:
        """One tick on."""
        if self._turn_rad:
            most = GAIT.turn_rate_radps * TICK_S
            self._turn_rad -= max(-most, min(most, self._turn_rad))
            return
        aim_m = self._aim_now_m(robot)
        to_go_m = 0.0 if aim_m is None else aim_m - self._along_m
        if aim_m is not None and abs(to_go_m) < _ARRIVED_M:
            self._speed_mps = 0.0
            self._set_out(robot)
            return
        # brakes a little early, so as to stand at the aim, feet beside each other
        braking = math.sqrt(2 * 0.8 * GAIT.acceleration_mps2 * abs(to_go_m))
        wanted = math.copysign(min(self._pace_mps, braking, abs(to_go_m) / TICK_S), to_go_m)
        most = GAIT.acceleration_mps2 * TICK_S
        self._speed_mps += max(-most, min(most, wanted - self._speed_mps))
        along_m = self._along_m + self._speed_mps * TICK_S
        self._along_m = max(0.0, min(self._track.length_m, along_m))

    def _aim_now_m(self, robot: _Robot) -> float | None:
        """How far along the track she wants to be, as the robot lets her; None: to wait."""
        track, along_m, reach_m = self._track, self._along_m, self._track.step_m / 2
        braking_m = self._speed_mps**2 / (2 * GAIT.acceleration_mps2)
        gap_m = robot.gap_m(self.middle_m)
        if gap_m < GAIT.wary_m + 2 * reach_m:
            behind_m = robot.gap_m(track.middle_m(along_m - reach_m))
            ahead_m = robot.gap_m(track.middle_m(along_m + reach_m))
            if min(gap_m, behind_m, ahead_m) < GAIT.wary_m:
                self._pause_s = 0.0
                return track.length_m if ahead_m > behind_m else 0.0
        if self._pause_s > 0:
            self._pause_s -= TICK_S
            return None
        if gap_m < GAIT.wary_m + 2 * reach_m + braking_m:
            way = math.copysign(reach_m + braking_m + 0.1, self._aim_m - along_m)
            spots = (robot.gap_m(track.middle_m(along_m + i / 4 * way)) for i in range(1, 5))
            if min(spots) < GAIT.wary_m:
                return self._waiting()
        self._waited_s = 0.0
        return self._aim_m

    def _waiting(self) -> float | None:
        """To wait, and after a while to where the feet were last side by side, to turn round."""
        self._waited_s += TICK_S
        if self._waited_s > GAIT.patience_s:
            self._waited_s = 0.0
            steps = math.floor(self._along_m / self._track.step_m + 1e-6)
            self._aim_m = steps * self._track.step_m
        return None

    def _set_out(self, robot: _Robot) -> None:
        """Onto another track: she stands at an end of hers, or where she means to turn round."""
        track, along_m = self._track, self._along_m
        is_at_start, is_at_goal = along_m < _ARRIVED_M, along_m > track.length_m - _ARRIVED_M
        if not is_at_start and not is_at_goal:
            self._take(self._tracks.between(track.goal, track.start), track.length_m - along_m)
            return
        here, gap_m = track.start if is_at_start else track.goal, robot.gap_m(self.middle_m)
        if gap_m > GAIT.wary_m + track.step_m:
            self._take(self._tracks.draw(here, self._rng), 0.0)
            if self._rng.random() < GAIT.pause_share:
                self._pause_s = float(self._rng.uniform(*GAIT.pauses_s))
            return

        def narrowest_m(track: Track) -> float:
            return min(robot.gap_m(track.middle_m(along_m)) for along_m in (0.3, 0.6, 0.9))

        best = max(self._tracks.from_waypoint(here), key=narrowest_m)
        if narrowest_m(best) > min(gap_m, GAIT.wary_m):
            self._take(best, 0.0)

    def _take(self, track: Track, along_m: float) -> None:
        """Turns on the spot until she faces along a track that leads through here."""
        facing_rad = self._track.heading_rad(self._along_m)
        self._track, self._along_m, self._aim_m = track, along_m, track.length_m
        self._waited_s = 0.0
        self._turn_rad = math.remainder(track.heading_rad(along_m) - facing_rad, math.tau)

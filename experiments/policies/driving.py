"""Driving to a point without touching anything: pure pursuit, and a look ahead on each arc."""

import math
from dataclasses import dataclass

import numpy as np

from experiments.policies.arcs import room_on_arc
from kitasap_sim.env.motors import (
    ACCELERATION_MPS2,
    CONTROL_S,
    MAX_SPEED_MPS,
    MAX_TURN_RATE_RADPS,
    TURN_ACCELERATION_RADPS2,
)

OUTLINE_M = np.array(
    [
        [-0.25, 0.04, -0.145, 0.145],  # hull
        [-0.22, 0.22, -0.12, 0.12],  # skirt
        [-0.075, 0.075, -0.192, 0.192],  # tires
    ]
)
"""Kitasap2 from above, as boxes: least and most x, least and most y (models/kitasap2)."""
OBSTACLES_M = 0.9
"""Chosen: obstacles farther off are met by no arc that is looked at."""

_Command = tuple[float, float]


@dataclass(frozen=True)
class DrivingConfig:
    """How boldly it is driven; all chosen on random rooms of difficulty 1, seeds 0 to 199.

    margin_m: kept from obstacles where it can be; narrow_m: at a crawl; least_m: in the
    narrowest spots, where the robot turns with 11 mm to spare. turn_first_rad: a target more
    aside than this is turned to on the spot. lag_s: how late commands may come;
    held_s: how long an arc is looked at before it brakes. escape_steps: so long it goes on backing
    out, where it began to. may_leave: what leads away from something that is nearer than the margin
    already counts as keeping it.
    """

    margin_m: float = 0.05
    narrow_m: float = 0.025
    least_m: float = 0.008
    turn_first_rad: float = 0.7
    lag_s: float = 0.05
    held_s: float = 0.3
    crawl_mps: float = 0.12
    slow_turn_radps: float = 0.5
    escape_steps: int = 12
    may_leave: bool = False


class Driver:
    """Commands (speed, turn rate) for targets in the robot's frame, clear of obstacles there."""

    def __init__(self, config: DrivingConfig | None = None) -> None:
        self.config = config or DrivingConfig()
        self.reset()

    def reset(self) -> None:
        """Backs out of nothing."""
        self._escape, self._escape_left = (0.0, 0.0), 0

    def towards(
        self, target_m: np.ndarray, velocity: np.ndarray, obstacles_m: np.ndarray, most_mps: float
    ) -> np.ndarray:
        """(2,) action that goes to a target (2,) in the robot's frame, no faster than so."""
        x, y = target_m.tolist()
        bearing_rad = math.atan2(y, x)
        if abs(bearing_rad) > self.config.turn_first_rad:
            return self.turning(bearing_rad, velocity, obstacles_m)
        # the circle through both that leaves along the robot's heading
        curvature = 2.0 * y / max(x * x + y * y, 1e-6)
        bend = max(abs(curvature), 1e-6)
        v = min(most_mps, MAX_SPEED_MPS, 0.8 * MAX_TURN_RATE_RADPS / bend)
        turn = turn_rate(bearing_rad)
        bold = [*((share * v, share * v * curvature) for share in (1.0, 0.6, 0.3)), (0.0, turn)]
        crawl = min(v, self.config.crawl_mps)
        return self._safest(bold, [(crawl, crawl * curvature)], turn, velocity, obstacles_m)

    def turning(
        self, angle_rad: float, velocity: np.ndarray, obstacles_m: np.ndarray
    ) -> np.ndarray:
        """(2,) action that turns on the spot by an angle [rad], the other way round if need be."""
        turn = turn_rate(angle_rad)
        return self._safest([(0.0, turn)], [], turn, velocity, obstacles_m)

    def first_kept(
        self, commands: list[_Command], velocity: np.ndarray, obstacles_m: np.ndarray
    ) -> np.ndarray | None:
        """(2,) action of the first command (forward speed, turn rate) that keeps its margin from
        obstacles (K, 2), robot's frame [m]; None if none does. velocity: (2,) as observed."""
        for command in commands:
            least_m, now_m = self._rooms_m(command, velocity, obstacles_m)
            margin_m = self.config.margin_m
            if self.config.may_leave:
                margin_m = min(margin_m, now_m)
            if least_m >= margin_m:
                return action_of(*command)
        return None

    def _rooms_m(
        self, command: _Command, velocity: np.ndarray, obstacles_m: np.ndarray
    ) -> tuple[float, float]:
        """What a command keeps at the least, until the robot stands again; what is kept now [m]."""
        result: tuple[float, float] = room_on_arc(
            obstacles_m, OUTLINE_M, (float(velocity[0]), float(velocity[1])), command,
            (ACCELERATION_MPS2, TURN_ACCELERATION_RADPS2),
            (self.config.lag_s, self.config.held_s, 0.5 * CONTROL_S),
        )  # fmt: skip
        return result

    def _safest(
        self,
        bold: list[_Command],
        careful: list[_Command],
        turn: float,
        velocity: np.ndarray,
        obstacles_m: np.ndarray,
    ) -> np.ndarray:
        """The first command that keeps its margin; else a way out; else what keeps most."""
        config = self.config
        slow = math.copysign(min(abs(turn), config.slow_turn_radps), turn)
        careful = [*careful, (0.0, slow)]

        def room_m(command: _Command) -> float:
            return self._rooms_m(command, velocity, obstacles_m)[0]

        if self._escape_left > 0:
            self._escape_left -= 1
            if room_m(self._escape) > config.narrow_m:
                return action_of(*self._escape)
        self._escape_left = 0
        kept = self.first_kept(bold, velocity, obstacles_m)
        if kept is not None:
            return kept
        rooms_m = [room_m(command) for command in careful]
        for command, room in zip(careful, rooms_m, strict=True):
            if room >= config.narrow_m:
                return action_of(*command)
        crawl = config.crawl_mps
        ways_out = [
            (-crawl, 0.0), (-crawl, slow), (-crawl, -slow), (crawl, 0.0), (crawl, slow),
            (crawl, -slow), (0.0, -slow),
        ]  # fmt: skip
        out_m = [room_m(command) for command in ways_out]
        best = int(np.argmax(out_m))
        if out_m[best] > max(config.narrow_m, max(rooms_m)):
            self._escape, self._escape_left = ways_out[best], config.escape_steps
            return action_of(*ways_out[best])
        best = int(np.argmax(rooms_m))
        if rooms_m[best] > config.least_m:
            return action_of(*careful[best])
        return action_of(0.0, 0.0)


def action_of(speed_mps: float, turn_rate_radps: float) -> np.ndarray:
    """(2,) float32 the action that asks for both, or for as much of them as there is."""
    shares = [speed_mps / MAX_SPEED_MPS, turn_rate_radps / MAX_TURN_RATE_RADPS]
    return np.array(shares, dtype=np.float32).clip(-1.0, 1.0)


def turn_rate(angle_rad: float) -> float:
    """So fast to turn by an angle that it still stops in time, also where commands are late."""
    rate = min(
        2.5 * abs(angle_rad), 0.7 * math.sqrt(2.0 * TURN_ACCELERATION_RADPS2 * abs(angle_rad))
    )
    return math.copysign(min(rate, MAX_TURN_RATE_RADPS), angle_rad)

"""Keyframes along what their scans leave open: the next scan that sees what was seen before them
shows how far the robot went."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray, diagonal_of
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.kept_keyframes import Keyframes
from slam.frontend.keyframes import Keyframe
from slam.frontend.remaining import Remaining
from slam.frontend.told_steps import ToldStep
from slam.kernels.normal_equations import inverse_of
from slam.loop_closing import Loop
from slam.se2 import SE2
from slam.surface.surface_match import SurfaceMatch
from slam.surface.surface_window import SurfaceWindow

_SLID_M = -1.2, -0.8, -0.4, 0.4, 0.8, 1.2
_SAME_M = 0.2
"""Along the way, where a scan may fit as well as where it was matched; and how far off it is another
place. Chosen."""
EXACTLY = 1e-9 * np.eye(3)
"""[m2], [rad2]: of where steps led, if that is to be as it was seen. Chosen."""


class OpenRun:
    """The last keyframes, as far as each left a direction open, one after the other."""

    def __init__(self, config: FrontEndConfig) -> None:
        self._config, self._first = config, -1

    @property
    def is_empty(self) -> bool:
        """Whether the last keyframe leaves none open."""
        return self._first < 0

    @property
    def before(self) -> int:
        """The keyframe before the run."""
        return self._first - 1

    def take(self, index: int, is_open: bool) -> None:
        """The next keyframe."""
        if not is_open:
            self._first = -1
        elif self.is_empty:
            self._first = index

    def renumber(self, remaining: Remaining) -> None:
        """Keyframes before the run were let go."""
        if not self.is_empty:
            self._first = remaining.number(self._first)

    def seen_from_before(
        self,
        keyframes: Sequence[Keyframe],
        points: FloatArray,
        T_start: SE2,
        window: SurfaceWindow,
    ) -> SurfaceMatch | None:
        """The match of a scan's faced points (N, 3) with what was seen before the run alone, near
        T_start; None if they see too little of that, or fit elsewhere along the way all but as well.
        The window holds the same as before."""
        run, config = keyframes[self._first :], self._config
        if len(run) >= len(window):
            return None
        window.leave_out_last(len(run))
        match = window.surfaces.match_alone(points, T_start)
        is_seen = (
            match.least_facing >= config.least_facing
            and match.inlier_ratio >= config.good_inlier_ratio
            and match.seen_ratio >= config.least_seen_ratio
            and match.T_map_base.is_near(T_start, config.keyframe_m, config.keyframe_rad)
        )
        if is_seen:
            weakest = np.linalg.eigh(match.place_information)[1][:, 0]
            for slid_m in _SLID_M:
                start = match.T_map_base @ SE2(slid_m * weakest[0], slid_m * weakest[1], 0.0)
                other = window.surfaces.match_alone(points, start)
                is_other = not other.T_map_base.is_near(match.T_map_base, _SAME_M, math.inf)
                is_seen &= not (is_other and other.cost < match.cost + config.better)
        window.learn_all((one.T_map_base, one.faced) for one in run)
        return match if is_seen else None

    def tie(
        self,
        keyframes: Keyframes,
        window: SurfaceWindow,
        points: FloatArray,
        match: SurfaceMatch,
        step: ToldStep,
        noise: float,
    ) -> tuple[SE2, Loop] | None:
        """Where a scan of faced points (N, 3) was taken, matched after the run, if it sees what was seen
        before: that ties it to the keyframe before the run, and the run is moved to where it shows it.

        step: by the wheels, from the last keyframe; noise: of them, see `WheelScale`.
        """
        seen = self.seen_from_before(keyframes, points, match.T_map_base, window)
        if seen is None:
            return None
        T_seen = keyframes[self.before].T_map_base.inverse() @ seen.T_map_base
        covariance = seen.covariance + diagonal_of(self._config.step_sigma)
        # all that is told of noisy wheels is that much less sure
        *poses, T_map_base = self.moved(keyframes, step, T_seen, covariance / noise)
        for k, pose in enumerate(poses, start=self._first):
            keyframes[k] = replace(keyframes[k], T_map_base=pose)
        window.leave_out_last(len(poses))
        window.learn_all((one.T_map_base, one.faced) for one in keyframes[self._first :])
        information = inverse_of(covariance)
        tie = Loop(
            self.before, len(keyframes), T_seen, information, seen.inlier_ratio, 0.0, is_tie=True
        )
        return T_map_base, tie

    def moved(
        self, keyframes: Sequence[Keyframe], last: ToldStep, T_seen: SE2, covariance: FloatArray
    ) -> list[SE2]:
        """Where the keyframes of the run, and a scan a step after them, were taken, once that is seen
        at T_seen from the keyframe before the run; covariance: (3, 3) of that."""
        T_map_base = keyframes[self.before].T_map_base
        run = keyframes[self._first :]
        steps = [*(ToldStep(one.T_before, one.covariance) for one in run), last]
        poses = list[SE2]()
        for motion in tied(steps, T_seen, covariance):
            T_map_base = T_map_base @ motion
            poses.append(T_map_base)
        return poses


def tied(steps: Sequence[ToldStep], T_seen: SE2, covariance: FloatArray) -> list[SE2]:
    """The motions of steps, one after the other, once it is seen where they led.

    covariance: (3, 3) of T_seen. Each takes its share of what they were off, as least squares has it to
    first order.
    """
    shares, T_rest, spread = list[FloatArray](), SE2.identity(), covariance
    for step in reversed(steps):
        to_end = T_rest.inverse().adjoint()
        shares.append(step.covariance @ to_end.T)
        spread = spread + to_end @ shares[-1]
        T_rest = step.motion @ T_rest
    pull = inverse_of(spread) @ (T_rest.inverse() @ T_seen).log()
    return [
        step.motion @ SE2.exp(share @ pull)
        for step, share in zip(steps, reversed(shares), strict=True)
    ]

"""What troubles the simulated drives of `kitasap bench buildings`: wheels that spin, people who walk along."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from experiments.bench.building_plans import closed, rectangle
from slam.arrays import FloatArray
from slam.se2 import SE2

TROUBLES = ("none", "spins", "walkers")
_SPIN_EACH_M, _SPIN_M = (8.0, 25.0), (0.3, 2.0)
"""Between two places where wheels spin, and how far they turn there."""
_WALK_EACH_M, _WALK_M = (2.0, 10.0), (3.0, 10.0)
"""Between two who walk along, and how far they do."""
_AHEAD_M, _ASIDE_M, _PACE = (-1.0, 2.5), (0.2, 0.6), (0.6, 1.4)
"""Where he comes up to the robot, along its way and aside of it, and how fast he goes for each metre of it."""
_LEG_M, _APART_M, _NEAREST_M = 0.06, 0.15, 0.4


def motions(poses: list[SE2]) -> list[SE2]:
    """From each pose to the next."""
    return [one.inverse() @ other for one, other in pairwise(poses)]


def spun(poses: list[SE2], step_m: float, rng: np.random.Generator) -> tuple[list[SE2], list[SE2]]:
    """The poses of a robot whose wheels spin now and then while it stands and goes on taking scans, and the
    motions of its wheels from each to the next."""
    found, by_wheels, left_m = [poses[0]], list[SE2](), rng.uniform(*_SPIN_EACH_M)
    for pose, motion in zip(poses[1:], motions(poses), strict=True):
        found.append(pose)
        by_wheels.append(motion)
        left_m -= math.hypot(motion.x, motion.y)
        if left_m <= 0.0:
            far_m = rng.uniform(*_SPIN_M)
            count = max(1, round(far_m / step_m))
            found += [pose] * count
            by_wheels += [SE2(far_m / count, 0.0, 0.0)] * count
            left_m = rng.uniform(*_SPIN_EACH_M)
    return found, by_wheels


def walkers(poses: list[SE2], rng: np.random.Generator) -> list[FloatArray]:
    """Of each pose the legs (S, 2, 2) of whoever walks along the robot's way there."""
    done_m = np.cumsum([0.0, *(math.hypot(one.x, one.y) for one in motions(poses))])
    places = np.array([(pose.x, pose.y) for pose in poses])
    found: list[FloatArray] = [np.empty((0, 2, 2)) for _ in poses]
    from_m = rng.uniform(*_WALK_EACH_M)
    while from_m < done_m[-1]:
        ahead_m, pace, to_m = (
            rng.uniform(*_AHEAD_M),
            rng.uniform(*_PACE),
            from_m + rng.uniform(*_WALK_M),
        )
        aside_m = rng.uniform(*_ASIDE_M) * rng.choice([-1.0, 1.0])
        for k in np.flatnonzero((done_m >= from_m) & (done_m <= to_m)):
            at_m = from_m + ahead_m + pace * (done_m[k] - from_m)
            if not 0.0 < at_m < done_m[-1]:
                continue
            x, y = (np.interp(at_m, done_m, places[:, i]) for i in (0, 1))
            heading = poses[min(int(np.searchsorted(done_m, at_m)), len(poses) - 1)].theta
            body = SE2(x, y, heading) @ SE2(0.0, aside_m, 0.0)
            if math.hypot(body.x - poses[k].x, body.y - poses[k].y) > _NEAREST_M:
                found[k] = np.concatenate([found[k], _legs(body)])
        from_m = to_m + rng.uniform(*_WALK_EACH_M)
    return found


def _legs(body: SE2) -> FloatArray:
    """(8, 2, 2) walls of two."""
    corners = rectangle(-_LEG_M, -_LEG_M, _LEG_M, _LEG_M)
    legs = [closed(body @ (corners + np.array([0.0, side * _APART_M]))) for side in (-1.0, 1.0)]
    return np.concatenate(legs)

"""A scan matched with the surfaces of a map: see `slam.kernels.surface_map`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray, IntArray
from slam.kernels import compiled
from slam.kernels.information_noise import take_off
from slam.kernels.normal_equations import (
    LEAST_PIVOT,
    lower_root_into,
    solve_by_root,
    symmetric_into,
)
from slam.kernels.seen_surfaces import (
    COST,
    FITTING,
    NOISE,
    PULL,
    ROWS,
    SEEN,
    TOLD,
    begin,
    look_up,
    tell,
)

_STAYS = 1e-6
"""Information by which a direction that nothing holds stays where it is."""
_SAME = 0.01, 2e-3
"""[m], [rad] from one another, two matches are in the same place. Chosen: ten times, and four times, what one may
move by at its last step."""


@compiled
def align(
    index: NDArray[np.int32],
    heads: NDArray[np.int32],
    sums: NDArray[np.float32],
    surfels: FloatArray,
    cells_m: FloatArray,
    points: FloatArray,
    variance: float,
    pull: float,
    share: float,
    finest: NDArray[np.int64],
    scales_m: FloatArray,
    pose_x: float,
    pose_y: float,
    heading: float,
    predicted_x: float,
    predicted_y: float,
    predicted_heading: float,
    odometry: FloatArray,
    trust: float,
    max_steps: int,
    information: FloatArray,
    joined: FloatArray,
) -> tuple[float, float, float, float, float, float]:
    """Gauss-Newton of points (N, 3), base frame, on the surfaces, with the odometry beside them.

    index: of cells of cells_m (L,), coarse to fine; the others as in `put`.
    variance: of a point across its surface [m2]; pull: share that counts of what points tell while pose and
    odometry are weighed, share: in the end. finest: (S,)
    the finest level that stage looks at; a point takes the finest that has a surface. scales_m:
    (S,) residual, beside the noise, at which a point counts a quarter (Geman and McClure, 1987).
    pose_x, pose_y, heading: where it starts [m], [rad]. odometry: (3, 3) information
    of the predicted pose; trust: its normalised innovation squared at which it counts a quarter. Into
    information (3, 3): of the scan alone; into joined (3, 3): with the odometry's, as far as that counted.

    Returns the pose found; how many points saw a surface, and lie on it; and their cost, of those that saw one.

    The surfaces' directions are known from noisy points: errors in variables (Fuller, 1987). Left
    alone, they tell of the place along a wall what nothing tells, and draw new points at the end
    of what is known back to it: a robot that drove backwards lost 6 % of its way. What their
    variance makes of pull and information is taken off both; steps are taken with all of the
    information, and are the smaller for it.
    """
    pose, predicted, held, told = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(TOLD)
    pose[0], pose[1], pose[2] = pose_x, pose_y, heading
    predicted[0], predicted[1], predicted[2] = predicted_x, predicted_y, predicted_heading
    for j in range(3):
        for k in range(3):
            held[j, k] = odometry[j, k] + (_STAYS if j == k else 0.0)
    places, seen = np.empty((points.shape[0], 3), np.int64), np.empty((ROWS, points.shape[0]))
    weight = 1.0
    for stage in range(scales_m.shape[0]):
        weight = _descend(
            index, heads, sums, surfels, cells_m, points, variance, pull, finest[stage],
            scales_m[stage], predicted, held, trust, max_steps, pose, places, seen, told, information,
        )  # fmt: skip
    _join(told, share, weight, held, information, joined)
    return pose[0], pose[1], pose[2], told[SEEN], told[FITTING], told[COST]


@compiled
def align_alone(
    index: NDArray[np.int32],
    heads: NDArray[np.int32],
    sums: NDArray[np.float32],
    surfels: FloatArray,
    cells_m: FloatArray,
    points: FloatArray,
    variance: float,
    pull: float,
    share: float,
    finest: NDArray[np.int64],
    scales_m: FloatArray,
    starts: FloatArray,
    max_steps: int,
    information: FloatArray,
    joined: FloatArray,
) -> tuple[float, float, float, float, float, float]:
    """As `align`, without odometry, the best of what is found from starts (K, 3): that of the least cost. From
    where the last stage would begin about where it began before, it would find the same."""
    pose, begun, told = np.empty(3), np.empty((starts.shape[0], 3)), np.empty(TOLD)
    best, best_told, least, count = np.empty(3), np.empty(TOLD), math.inf, 0
    held, found = np.zeros((3, 3)), np.empty((3, 3))
    held[0, 0] = held[1, 1] = held[2, 2] = _STAYS
    places, seen = np.empty((points.shape[0], 3), np.int64), np.empty((ROWS, points.shape[0]))
    last = scales_m.shape[0] - 1
    for i in range(starts.shape[0]):
        for j in range(3):
            pose[j] = starts[i, j]
        is_known = False
        for stage in range(last + 1):
            if stage == last:
                is_known = _is_among(begun, count, pose)
                if is_known:
                    break
                for j in range(3):
                    begun[count, j] = pose[j]
                count += 1
            _descend(
                index, heads, sums, surfels, cells_m, points, variance, pull, finest[stage],
                scales_m[stage], starts[i], held, math.inf, max_steps, pose, places, seen, told, found,
            )  # fmt: skip
        cost = told[COST] - told[SEEN]
        if i == 0 or (not is_known and cost < least):
            least = cost
            for j in range(3):
                best[j] = pose[j]
                for k in range(3):
                    information[j, k] = found[j, k]
            for j in range(TOLD):
                best_told[j] = told[j]
    _join(best_told, share, 1.0, held, information, joined)
    return best[0], best[1], best[2], best_told[SEEN], best_told[FITTING], best_told[COST]


@compiled
def _is_among(poses: FloatArray, count: int, pose: FloatArray) -> bool:
    """Whether one of the first poses (K, 3) is the same place as a pose (3,)."""
    for j in range(count):
        turn = pose[2] - poses[j, 2]
        turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
        off_m = math.sqrt((pose[0] - poses[j, 0]) ** 2 + (pose[1] - poses[j, 1]) ** 2)
        if off_m < _SAME[0] and abs(turn) < _SAME[1]:
            return True
    return False


@compiled
def _descend(
    index: NDArray[np.int32],
    heads: NDArray[np.int32],
    sums: NDArray[np.float32],
    surfels: FloatArray,
    cells_m: FloatArray,
    points: FloatArray,
    variance: float,
    pull: float,
    finest: int,
    scale_m: float,
    predicted: FloatArray,
    odometry: FloatArray,
    trust: float,
    max_steps: int,
    pose: FloatArray,
    places: IntArray,
    seen: FloatArray,
    told: FloatArray,
    information: FloatArray,
) -> float:
    """One stage of `align`: a pose (3,), in place, and what points told (TOLD,) of it at the last step, their
    information (3, 3) too. predicted: (3,); places and seen: as in `look_up`. How much the odometry counted."""
    both, root, step, weight = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), 1.0
    begin(points, places, seen)
    for _ in range(max_steps):
        c, s = math.cos(pose[2]), math.sin(pose[2])
        look_up(index, heads, sums, surfels, cells_m, points, finest, pose, places, seen)
        tell(seen, c, s, variance, scale_m * scale_m, told)
        symmetric_into(told[0], told[1], told[2], told[3], told[4], told[5], information)
        east, north = predicted[0] - pose[0], predicted[1] - pose[1]
        ahead, aside = c * east + s * north, c * north - s * east
        turn = predicted[2] - pose[2]
        turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
        # what the odometry pulls with; written out, as calls for so small matrices take longer
        for j in range(3):
            step[j] = odometry[j, 0] * ahead + odometry[j, 1] * aside + odometry[j, 2] * turn
        squared = ahead * step[0] + aside * step[1] + turn * step[2]
        # wheels slip, and odometry that stood still catches up at once
        weight = 1.0 / (1.0 + squared / trust)
        weight *= weight
        for j in range(3):
            for k in range(3):
                both[j, k] = pull * information[j, k] + weight * odometry[j, k]
            step[j] = pull * told[PULL + j] + weight * step[j]
        lower_root_into(both, LEAST_PIVOT, root)
        solve_by_root(root, step, step)
        pose[0] += c * step[0] - s * step[1]
        pose[1] += s * step[0] + c * step[1]
        pose[2] += step[2]
        if abs(step[0]) + abs(step[1]) < 1e-3 and abs(step[2]) < 5e-4:
            break
    return weight


@compiled
def _join(
    told: FloatArray,
    share: float,
    weight: float,
    odometry: FloatArray,
    information: FloatArray,
    joined: FloatArray,
) -> None:
    """Takes off an information (3, 3), in place, what noise makes of it, as told (TOLD,), and all of it but a
    share; into joined (3, 3): that and the odometry's, by a weight."""
    noise = np.empty((3, 3))
    symmetric_into(
        told[NOISE], told[NOISE + 1], told[NOISE + 2], told[NOISE + 3], told[NOISE + 4],
        told[NOISE + 5], noise,
    )  # fmt: skip
    take_off(information, noise)
    for j in range(3):
        for k in range(3):
            information[j, k] *= share
            joined[j, k] = information[j, k] + weight * odometry[j, k]

"""A scan matched with the surfaces of a map: see `slam.kernels.surface_map`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray, IntArray
from slam.kernels import compiled, compiled_vectorised
from slam.kernels.normal_equations import (
    LEAST_PIVOT,
    lower_root_into,
    solve_by_root,
    symmetric_into,
)
from slam.kernels.surface_map import (
    DIRECTION_VARIANCE,
    FIELDS,
    LEVER,
    MADE,
    MIDDLE,
    NONE,
    NORMAL_X,
    NORMAL_Y,
    OFFSET,
    SIDES,
    STATE,
    VARIANCE,
    entry_of,
    make_surfel,
    sides_of,
)

_KERNEL = 6.0
"""Of a point's variance: so far off it counts a quarter."""
_FITS = 9.0
"""Squared residual, in variances, of a point that fits: three sigmas."""

# rows of what points see, behind the surfel's: whether they see one, and where they are, map frame and base
_SEES, _X, _Y, _X_BASE, _Y_BASE = FIELDS, FIELDS + 1, FIELDS + 2, FIELDS + 3, FIELDS + 4
_ROWS = FIELDS + 5
# what points tell: information (xx, xy, xt, yy, yt, tt), pull (3,), what noise makes of the information (as that), and
# how many points see a surface, fit it, and what they cost
_PULL, _NOISE, _SEEN, _FITTING, _COST, _TOLD = 6, 9, 15, 16, 17, 18

_STAYS = 1e-6
"""Information by which a direction that nothing holds stays where it is."""
_SAME = 0.01, 2e-3
"""[m], [rad] from one another, two matches are in the same place. Chosen: ten times, and four times, what one may
move by at its last step."""

_LEAST_LEFT = 0.1
"""Share of a scan's information that is left along any direction: how much of it noise makes is itself
known roughly. Chosen."""
_LEAST_KNOWN = 1e-9
"""Of the largest entry: a scan that tells less along some direction has nothing to be taken off."""


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
    pose, predicted, held, told = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(_TOLD)
    pose[0], pose[1], pose[2] = pose_x, pose_y, heading
    predicted[0], predicted[1], predicted[2] = predicted_x, predicted_y, predicted_heading
    for j in range(3):
        for k in range(3):
            held[j, k] = odometry[j, k] + (_STAYS if j == k else 0.0)
    places, seen = np.empty((points.shape[0], 3), np.int64), np.empty((_ROWS, points.shape[0]))
    weight = 1.0
    for stage in range(scales_m.shape[0]):
        weight = _descend(
            index, heads, sums, surfels, cells_m, points, variance, pull, finest[stage],
            scales_m[stage], predicted, held, trust, max_steps, pose, places, seen, told, information,
        )  # fmt: skip
    _join(told, share, weight, held, information, joined)
    return pose[0], pose[1], pose[2], told[_SEEN], told[_FITTING], told[_COST]


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
    pose, begun, told = np.empty(3), np.empty((starts.shape[0], 3)), np.empty(_TOLD)
    best, best_told, least, count = np.empty(3), np.empty(_TOLD), math.inf, 0
    held, found = np.zeros((3, 3)), np.empty((3, 3))
    held[0, 0] = held[1, 1] = held[2, 2] = _STAYS
    places, seen = np.empty((points.shape[0], 3), np.int64), np.empty((_ROWS, points.shape[0]))
    last = scales_m.shape[0] - 1
    for i in range(starts.shape[0]):
        for j in range(3):
            pose[j] = starts[i, j]
        is_known = False
        for stage in range(last + 1):
            if stage == last:
                for j in range(count):
                    turn = pose[2] - begun[j, 2]
                    turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
                    off_m = math.sqrt((pose[0] - begun[j, 0]) ** 2 + (pose[1] - begun[j, 1]) ** 2)
                    is_known |= off_m < _SAME[0] and abs(turn) < _SAME[1]
                if is_known:
                    break
                for j in range(3):
                    begun[count, j] = pose[j]
                count += 1
            _descend(
                index, heads, sums, surfels, cells_m, points, variance, pull, finest[stage],
                scales_m[stage], starts[i], held, math.inf, max_steps, pose, places, seen, told, found,
            )  # fmt: skip
        cost = told[_COST] - told[_SEEN]
        if i == 0 or (not is_known and cost < least):
            least = cost
            for j in range(3):
                best[j] = pose[j]
                for k in range(3):
                    information[j, k] = found[j, k]
            for j in range(_TOLD):
                best_told[j] = told[j]
    _join(best_told, share, 1.0, held, information, joined)
    return best[0], best[1], best[2], best_told[_SEEN], best_told[_FITTING], best_told[_COST]


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
    """One stage of `align`: a pose (3,), in place, and what points told (_TOLD,) of it at the last step, their
    information (3, 3) too. predicted: (3,); places and seen: as in `_look_up`. How much the odometry counted."""
    both, root, step, weight = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), 1.0
    _begin(points, places, seen)
    for _ in range(max_steps):
        c, s = math.cos(pose[2]), math.sin(pose[2])
        _look_up(index, heads, sums, surfels, cells_m, points, finest, pose, places, seen)
        _tell(seen, c, s, variance, scale_m * scale_m, told)
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
            step[j] = pull * told[_PULL + j] + weight * step[j]
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
    """Takes off an information (3, 3), in place, what noise makes of it, as told (_TOLD,), and all of it but a
    share; into joined (3, 3): that and the odometry's, by a weight."""
    noise, root = np.empty((3, 3)), np.empty((3, 3))
    symmetric_into(
        told[_NOISE], told[_NOISE + 1], told[_NOISE + 2], told[_NOISE + 3], told[_NOISE + 4],
        told[_NOISE + 5], noise,
    )  # fmt: skip
    _take_off(information, noise, root)
    for j in range(3):
        for k in range(3):
            information[j, k] *= share
            joined[j, k] = information[j, k] + weight * odometry[j, k]


@compiled
def _begin(points: FloatArray, places: IntArray, seen: FloatArray) -> None:
    """Of points (N, 3): none has been looked up, none sees a surface. See `_look_up`."""
    for i in range(points.shape[0]):
        places[i, 2] = -1
        for k in range(_ROWS):
            seen[k, i] = 0.0
        seen[LEVER, i] = seen[VARIANCE, i] = 1.0  # what is divided by is no zero
        if not math.isnan(points[i, 2]):
            seen[_X_BASE, i], seen[_Y_BASE, i] = points[i, 0], points[i, 1]


@compiled
def _look_up(
    index: NDArray[np.int32],
    heads: NDArray[np.int32],
    sums: NDArray[np.float32],
    surfels: FloatArray,
    cells_m: FloatArray,
    points: FloatArray,
    finest: int,
    pose: FloatArray,
    places: IntArray,
    seen: FloatArray,
) -> None:
    """Into seen (_ROWS, N): the surfels that points (N, 3) see from a pose (3,), in the finest level that
    has one. places: (N, 3) column and row in the level `finest` and sides of each point when it was looked up
    last; as long as these stay, so does its surfel: between two steps few points leave their cells."""
    fine_m, c, s = cells_m[finest], math.cos(pose[2]), math.sin(pose[2])
    for i in range(points.shape[0]):
        if math.isnan(points[i, 2]):
            continue
        px, py = points[i, 0], points[i, 1]
        x, y = pose[0] + c * px - s * py, pose[1] + s * px + c * py
        seen[_X, i], seen[_Y, i] = x, y
        near, far = sides_of(points[i, 2] + pose[2])
        column, row = math.floor(x / fine_m), math.floor(y / fine_m)
        sides = near * SIDES + far
        if places[i, 2] == sides and places[i, 0] == column and places[i, 1] == row:
            continue
        places[i, 0], places[i, 1], places[i, 2] = column, row, sides
        seen[_SEES, i] = 0.0
        level = finest
        while level >= 0:
            cell_m = cells_m[level]
            column, row = math.floor(x / cell_m), math.floor(y / cell_m)
            entry = entry_of(index, heads, level, column, row)
            if entry != NONE:
                side = near
                # of one call, in a loop: two would not be inlined
                for _ in range(2):
                    if heads[entry, STATE] >> side & 1:
                        heads[entry, STATE] &= ~(1 << side | 1 << side + MADE)
                        if make_surfel(
                            index, heads, sums, level, column, row, side, cell_m,
                            surfels[entry, side],
                        ):  # fmt: skip
                            heads[entry, STATE] |= 1 << side + MADE
                    if heads[entry, STATE] >> side + MADE & 1:
                        seen[_SEES, i] = 1.0
                        for k in range(FIELDS):
                            seen[k, i] = surfels[entry, side, k]
                        break
                    side = far
                if seen[_SEES, i] > 0.0:
                    break
            level -= 1


@compiled_vectorised
def _tell(
    seen: FloatArray, c: float, s: float, variance: float, scale: float, told: FloatArray
) -> None:
    """Into told (_TOLD,): what points tell at a pose of a heading's cosine and sine; seen (_ROWS, N) as of
    `_look_up` there. variance and scale [m2]: as in `align`, the latter squared."""
    xx = xy = xt = yy = yt = tt = pull_x = pull_y = pull_t = 0.0
    noise_xx = noise_xy = noise_xt = noise_yy = noise_yt = noise_tt = 0.0
    count = fitting = cost = 0.0
    for i in range(seen.shape[1]):
        px, py, x, y = seen[_X_BASE, i], seen[_Y_BASE, i], seen[_X, i], seen[_Y, i]
        normal_x, normal_y, sees = seen[NORMAL_X, i], seen[NORMAL_Y, i], seen[_SEES, i]
        direction_variance = seen[DIRECTION_VARIANCE, i]
        residual = normal_x * x + normal_y * y - seen[OFFSET, i]
        wide = variance + seen[VARIANCE, i]
        limit = scale + _KERNEL * wide
        share = limit / (limit + residual * residual)
        # so few points may lie on a line by chance: where they are weighed, the usual noise is
        # added to theirs; what they pull is mended by their own alone, which is unbiased
        turned = direction_variance + variance / seen[LEVER, i]
        beyond_m = normal_y * x - normal_x * y - seen[MIDDLE, i]
        weight = sees * share * share / (wide + turned * beyond_m * beyond_m)
        count += sees
        fitting += sees if residual * residual < _FITS * (wide + variance) else 0.0
        cost += sees * (1.0 - share)
        nx = c * normal_x + s * normal_y
        ny = c * normal_y - s * normal_x
        nt = px * ny - py * nx
        xx += weight * nx * nx
        xy += weight * nx * ny
        xt += weight * nx * nt
        yy += weight * ny * ny
        yt += weight * ny * nt
        tt += weight * nt * nt
        # noise turns surfaces; it pulls as if along them, back to where their points are
        outward = weight * direction_variance * beyond_m
        nd = -px * nx - py * ny
        pull_x += outward * ny - weight * nx * residual
        pull_y -= outward * nx + weight * ny * residual
        pull_t += outward * nd - weight * nt * residual
        noise = weight * turned
        noise_xx += noise * ny * ny
        noise_xy -= noise * ny * nx
        noise_xt += noise * ny * nd
        noise_yy += noise * nx * nx
        noise_yt -= noise * nx * nd
        noise_tt += noise * nd * nd
    told[0], told[1], told[2], told[3], told[4], told[5] = xx, xy, xt, yy, yt, tt
    told[6], told[7], told[8] = pull_x, pull_y, pull_t
    told[9], told[10], told[11] = noise_xx, noise_xy, noise_xt
    told[12], told[13], told[14] = noise_yy, noise_yt, noise_tt
    told[_SEEN], told[_FITTING], told[_COST] = count, fitting, cost


@compiled
def _take_off(information: FloatArray, noise: FloatArray, root: FloatArray) -> None:
    """Information (3, 3) less what noise (3, 3) makes of it, in place; along each direction of both
    some is left. root: (3, 3) to work in."""
    largest = max(information[0, 0], information[1, 1], information[2, 2])
    if not lower_root_into(information, _LEAST_KNOWN * largest, root):
        return
    # the noise where information is the same along all directions, and equal to one
    scaled = _divided(_divided(noise, root).T.copy(), root)
    shares, directions = np.linalg.eigh(0.5 * (scaled + scaled.T))
    along = np.empty(3)
    for k in range(3):
        share = min(shares[k], 1.0 - _LEAST_LEFT)
        if share > 0.0:
            for i in range(3):
                along[i] = 0.0
                for j in range(i + 1):
                    along[i] += root[i, j] * directions[j, k]
            for i in range(3):
                for j in range(3):
                    information[i, j] -= share * along[i] * along[j]


@compiled
def _divided(matrix: FloatArray, root: FloatArray) -> FloatArray:
    """The solution (3, 3) of root @ out = matrix, of a lower root. NumPy's, which asks for none, takes
    a machine seven seconds to compile."""
    out = np.empty((3, 3))
    for k in range(3):
        for i in range(3):
            left = matrix[i, k]
            for j in range(i):
                left -= root[i, j] * out[j, k]
            out[i, k] = left / root[i, i]
    return out

"""The least squares of many poses: residuals, their slopes, normal equations in CSC, covariances.

Poses and measurements are rows (x, y, theta); an edge from i to j has the residual
r = log(measured^-1 @ pose_i^-1 @ pose_j), and poses are perturbed on the right, T @ exp(twist).
"""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray, IntArray
from slam.kernels import compiled, copy_into
from slam.kernels.normal_equations import moved

_SMALL_ANGLE_RAD = 1e-3
"""Below it the closed form of the right Jacobian loses digits; the series' next term is under 1e-14."""


@compiled
def wrapped(angle_rad: float) -> float:
    """The same angle in [-pi, pi]."""
    result: float = angle_rad - 2.0 * math.pi * np.rint(angle_rad / (2.0 * math.pi))
    return result


@compiled
def between(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """The pose a^-1 @ b."""
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = b[0] - a[0], b[1] - a[1]
    out[0], out[1] = c * dx + s * dy, c * dy - s * dx
    out[2] = wrapped(b[2] - a[2])


@compiled
def logarithm(pose: FloatArray, out: FloatArray) -> None:
    """The twist whose exponential is the pose; both may be the same array."""
    x, y, theta = pose[0], pose[1], pose[2]
    half = 0.5 * theta
    cotangent = 1.0 - theta * theta / 12.0 if abs(theta) < 1e-4 else half / math.tan(half)
    out[0], out[1], out[2] = cotangent * x + half * y, cotangent * y - half * x, theta


@compiled
def slopes(way: FloatArray, r: FloatArray, of_start: FloatArray, of_end: FloatArray) -> None:
    """(3, 3) of a residual r by the twists of its edge's two poses, way = pose_i^-1 @ pose_j.

    By that of the end: the inverse of the right Jacobian of exp at r, 1 + ad / 2 + k ad^2, which
    ends there in the plane since ad^3 = -theta^2 ad. By that of the start: -(the same) Ad(way^-1).
    """
    x, y, theta = r[0], r[1], r[2]
    if abs(theta) < _SMALL_ANGLE_RAD:
        k = 1.0 / 12.0 + theta * theta / 720.0
    else:
        k = (1.0 - 0.5 * theta / math.tan(0.5 * theta)) / (theta * theta)
    of_end[0, 0] = of_end[1, 1] = 1.0 - k * theta * theta
    of_end[0, 1], of_end[1, 0] = -0.5 * theta, 0.5 * theta
    of_end[0, 2] = 0.5 * y + k * theta * x
    of_end[1, 2] = -0.5 * x + k * theta * y
    of_end[2, 0] = of_end[2, 1] = 0.0
    of_end[2, 2] = 1.0
    # Ad(way^-1) = [R^T, (-R^T J t)]: columns of R^T, and J t = (y, -x) turned back, negative
    c, s = math.cos(way[2]), math.sin(way[2])
    u = s * way[0] - c * way[1]
    v = c * way[0] + s * way[1]
    for row in range(3):
        a, b, d = of_end[row, 0], of_end[row, 1], of_end[row, 2]
        of_start[row, 0] = -(a * c - b * s)
        of_start[row, 1] = -(a * s + b * c)
        of_start[row, 2] = -(a * u + b * v + d)


@compiled
def chi_squares(
    poses: FloatArray,
    ends: IntArray,
    measured: FloatArray,
    information: FloatArray,
    out: FloatArray,
) -> None:
    """(E,) squared residual of each edge, whitened by its information (E, 3, 3)."""
    way = np.empty(3)
    r = np.empty(3)
    for e in range(len(ends)):
        between(poses[ends[e, 0]], poses[ends[e, 1]], way)
        between(measured[e], way, r)
        logarithm(r, r)
        out[e] = 0.0
        for j in range(3):
            for k in range(3):
                out[e] += r[j] * information[e, j, k] * r[k]


@compiled
def residuals(poses: FloatArray, ends: IntArray, measured: FloatArray, out: FloatArray) -> None:
    """(E, 3) residual of each edge."""
    way = np.empty(3)
    for e in range(len(ends)):
        between(poses[ends[e, 0]], poses[ends[e, 1]], way)
        between(measured[e], way, out[e])
        logarithm(out[e], out[e])


@compiled
def _add_block(
    values: FloatArray, first: int, stride: int, left: FloatArray, right: FloatArray
) -> None:
    """Adds left^T @ right to the block that begins at values[first], columns `stride` apart."""
    for column in range(3):
        for row in range(3):
            values[first + column * stride + row] += (
                left[0, row] * right[0, column]
                + left[1, row] * right[1, column]
                + left[2, row] * right[2, column]
            )


@compiled
def normal_equations(
    poses: FloatArray,
    ends: IntArray,
    measured: FloatArray,
    information: FloatArray,
    weights: FloatArray,
    slots: IntArray,
    strides: IntArray,
    unknowns: IntArray,
    values: FloatArray,
    pull: FloatArray,
) -> None:
    """J^T W J into the values of its CSC matrix, -J^T W r into pull.

    slots: (E, 4) where the blocks (i, i), (j, j), (i, j), (j, i) of an edge begin; strides: (N,)
    from one column of a node's blocks to the next; unknowns: (N,) place of a node, -1 if fixed.
    """
    values[:] = 0.0
    pull[:] = 0.0
    way = np.empty(3)
    r = np.empty(3)
    of_start = np.empty((3, 3))
    of_end = np.empty((3, 3))
    weighted_start = np.empty((3, 3))
    weighted_end = np.empty((3, 3))
    for e in range(len(ends)):
        i, j = ends[e, 0], ends[e, 1]
        between(poses[i], poses[j], way)
        between(measured[e], way, r)
        logarithm(r, r)
        slopes(way, r, of_start, of_end)
        for row in range(3):
            for column in range(3):
                a = b = 0.0
                for k in range(3):
                    a += information[e, row, k] * of_start[k, column]
                    b += information[e, row, k] * of_end[k, column]
                weighted_start[row, column] = weights[e] * a
                weighted_end[row, column] = weights[e] * b
        a, b = unknowns[i], unknowns[j]
        if a >= 0:
            _add_block(values, slots[e, 0], strides[i], of_start, weighted_start)
            for column in range(3):
                for k in range(3):
                    pull[3 * a + column] -= weighted_start[k, column] * r[k]
        if b >= 0:
            _add_block(values, slots[e, 1], strides[j], of_end, weighted_end)
            for column in range(3):
                for k in range(3):
                    pull[3 * b + column] -= weighted_end[k, column] * r[k]
        if a >= 0 and b >= 0:
            _add_block(values, slots[e, 2], strides[j], of_start, weighted_end)
            _add_block(values, slots[e, 3], strides[i], of_end, weighted_start)


@compiled
def move_all(poses: FloatArray, unknowns: IntArray, step: FloatArray) -> None:
    """Each pose that is not fixed moved by its twist, in place."""
    for node in range(len(poses)):
        if unknowns[node] >= 0:
            first = 3 * unknowns[node]
            moved(poses[node], step[first : first + 3])
            poses[node, 2] = wrapped(poses[node, 2])


@compiled
def elimination_parents(indptr: IntArray, indices: IntArray) -> IntArray:
    """(B,) parent of each column in the elimination tree of a symmetric pattern, -1 at a root.

    Liu's algorithm (SIAM J. Matrix Anal. Appl. 11(1), 1990), with paths shortened.
    """
    count = len(indptr) - 1
    parents = np.full(count, -1)
    ancestors = np.full(count, -1)
    for column in range(count):
        for entry in range(indptr[column], indptr[column + 1]):
            row = indices[entry]
            while row != -1 and row < column:
                above = ancestors[row]
                ancestors[row] = column
                if above == -1:
                    parents[row] = column
                row = above
    return parents


@compiled
def half_covariance(
    node: int,
    parents: IntArray,
    position: IntArray,
    indptr: IntArray,
    indices: IntArray,
    values: FloatArray,
    pivots: FloatArray,
    out: FloatArray,
) -> IntArray:
    """Y (3, U) = D^-1/2 L^-1 of a node's three unit vectors, so that covariances are Y_a @ Y_b^T.

    Only the way from the node up to the root of the elimination tree is filled; it is returned,
    as positions in the factor. `out` must be zero before.
    """
    length = 0
    at = node
    while at != -1:
        length += 1
        at = parents[at]
    path = np.empty(3 * length, dtype=np.int64)
    length, at = 0, node
    while at != -1:
        for k in range(3):
            path[length + k] = position[3 * at + k]
        length += 3
        at = parents[at]
    for k in range(3):
        out[k, position[3 * node + k]] = 1.0
    for step in range(length):
        column = path[step]
        scale = 1.0 / math.sqrt(pivots[column])
        a, b, c = out[0, column], out[1, column], out[2, column]
        for entry in range(indptr[column], indptr[column + 1]):
            row = indices[entry]
            if row != column:
                out[0, row] -= a * values[entry]
                out[1, row] -= b * values[entry]
                out[2, row] -= c * values[entry]
        out[0, column], out[1, column], out[2, column] = a * scale, b * scale, c * scale
    return path


@compiled
def pair_covariances(
    pairs: IntArray,
    parents: IntArray,
    position: IntArray,
    indptr: IntArray,
    indices: IntArray,
    values: FloatArray,
    pivots: FloatArray,
) -> FloatArray:
    """(Q, 6, 6) joint covariance of pairs (Q, 2) of unknown nodes, -1 for a fixed one."""
    joint = np.zeros((len(pairs), 6, 6))
    halves = np.zeros((2, 3, len(pivots)))
    last = np.full(2, -1)
    paths = [np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)]
    for q in range(len(pairs)):
        for side in range(2):
            # many queries ask for one node against others
            if pairs[q, side] != last[side]:
                halves[side][:, paths[side]] = 0.0
                last[side] = pairs[q, side]
                if last[side] >= 0:
                    paths[side] = half_covariance(
                        last[side],
                        parents,
                        position,
                        indptr,
                        indices,
                        values,
                        pivots,
                        halves[side],
                    )
        for a in range(2):
            for b in range(2):
                if pairs[q, a] < 0 or pairs[q, b] < 0:
                    continue
                path = paths[a]
                for row in range(3):
                    for column in range(3):
                        total = 0.0
                        for at in path:
                            total += halves[a, row, at] * halves[b, column, at]
                        joint[q, 3 * a + row, 3 * b + column] = total
    return joint


@compiled
def relative_covariances(poses: FloatArray, pairs: IntArray, joint: FloatArray) -> FloatArray:
    """(Q, 3, 3) of pose_i^-1 @ pose_j in the tangent of its end, from the joint ones (Q, 6, 6)."""
    relative = np.zeros((len(pairs), 3, 3))
    way = np.empty(3)
    still = np.zeros(3)
    J = np.zeros((3, 6))
    for q in range(len(pairs)):
        between(poses[pairs[q, 0]], poses[pairs[q, 1]], way)
        slopes(way, still, J[:, :3], J[:, 3:])
        copy_into(J @ joint[q] @ J.T, relative[q])
    return relative

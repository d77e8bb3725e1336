"""The least squares of one pose: the step, the pose moved by it, and its covariance."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import FloatArray
from slam.kernels import compiled

_DAMPING = 1e-4
"""Chosen: along a direction of which the scan knows less than a hundredth of what it knows across
(in standard deviations), a step is no correction but noise made large."""

LEAST_PIVOT = 1e-300
"""Of a matrix that is all but singular: about the smallest number."""


@compiled
def symmetric_into(
    xx: float, xy: float, xt: float, yy: float, yt: float, tt: float, out: FloatArray
) -> None:
    """The symmetric matrix (3, 3) of its six entries."""
    out[0, 0], out[1, 1], out[2, 2] = xx, yy, tt
    out[0, 1] = out[1, 0] = xy
    out[0, 2] = out[2, 0] = xt
    out[1, 2] = out[2, 1] = yt


@compiled
def solved(information: FloatArray, pull: FloatArray, out: FloatArray) -> None:
    """The Gauss-Newton step: information \\ pull, with directions that nothing fixes left alone."""
    held = _DAMPING * (information[0, 0] + information[1, 1]) + 1e-9
    a = information[0, 0] + held
    b = information[0, 1]
    c = information[0, 2]
    d = information[1, 1] + held
    e = information[1, 2]
    f = information[2, 2] * (1.0 + _DAMPING) + 1e-9
    aa, bb, cc = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * aa + b * bb + c * cc
    dd, ee, ff = a * f - c * c, b * c - a * e, a * d - b * b
    if not determinant > 0.0:
        out[:] = 0.0
        return
    out[0] = (aa * pull[0] + bb * pull[1] + cc * pull[2]) / determinant
    out[1] = (bb * pull[0] + dd * pull[1] + ee * pull[2]) / determinant
    out[2] = (cc * pull[0] + ee * pull[1] + ff * pull[2]) / determinant


@compiled
def moved(pose: FloatArray, step: FloatArray) -> None:
    """The pose moved by a twist in its own frame, in place: pose @ exp(step)."""
    omega = step[2]
    if abs(omega) < 1e-4:
        sine, cosine = 1.0 - omega * omega / 6.0, omega / 2.0
    else:
        sine, cosine = math.sin(omega) / omega, (1.0 - math.cos(omega)) / omega
    dx = sine * step[0] - cosine * step[1]
    dy = cosine * step[0] + sine * step[1]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    pose[0] += c * dx - s * dy
    pose[1] += s * dx + c * dy
    pose[2] += omega


@compiled
def covariance_into(information: FloatArray, out: FloatArray) -> bool:
    """The inverse (3, 3) of an information matrix; False, and inf on the diagonal, if it has none."""
    scale = np.empty(3)
    for j in range(3):
        scale[j] = 1.0 / math.sqrt(max(information[j, j], 1e-300))
    b = information[0, 1] * scale[0] * scale[1]
    c = information[0, 2] * scale[0] * scale[2]
    e = information[1, 2] * scale[1] * scale[2]
    # of a correlation matrix: 1 without correlation, 0 where it is singular
    determinant = 1.0 - e * e - b * (b - c * e) + c * (b * e - c)
    has_all = min(information[0, 0], information[1, 1], information[2, 2]) > 1e-200
    if not (has_all and determinant > 1e-12):
        out[:] = 0.0
        out[0, 0] = out[1, 1] = out[2, 2] = np.inf
        return False
    out[0, 0], out[1, 1], out[2, 2] = 1.0 - e * e, 1.0 - c * c, 1.0 - b * b
    out[0, 1] = out[1, 0] = c * e - b
    out[0, 2] = out[2, 0] = b * e - c
    out[1, 2] = out[2, 1] = b * c - e
    for j in range(3):
        for k in range(3):
            out[j, k] *= scale[j] * scale[k] / determinant
    return True


@compiled
def widest(information: FloatArray) -> tuple[float, float]:
    """Largest standard deviation of the position along any direction, and that of the heading."""
    covariance = np.empty((3, 3))
    if not covariance_into(information, covariance):
        return np.inf, np.inf
    a, b, d = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    largest = 0.5 * (a + d) + math.sqrt(0.25 * (a - d) ** 2 + b * b)
    return math.sqrt(largest), math.sqrt(covariance[2, 2])


@compiled
def variance_along(axis: FloatArray, covariance: FloatArray) -> float:
    """Of a linear function of the pose with gradient axis (3,): axis @ covariance @ axis."""
    variance = 0.0
    for j in range(3):
        for k in range(3):
            variance += axis[j] * covariance[j, k] * axis[k]
    return variance


@compiled
def inverted(information: FloatArray) -> FloatArray:
    """(3, 3) inverse of an information matrix; directions without information get a metre, a radian."""
    covariance = np.empty((3, 3))
    covariance_into(information + np.eye(3), covariance)
    return covariance


@compiled
def lower_root_into(matrix: FloatArray, least: float, root: FloatArray) -> bool:
    """Cholesky's lower root (3, 3) of a symmetric matrix, whose pivots are taken to be `least` at
    least; False where one of them was less."""
    is_definite = True
    root[0, 1] = root[0, 2] = root[1, 2] = 0.0
    for j in range(3):
        for k in range(j + 1):
            left = matrix[j, k]
            for m in range(k):
                left -= root[j, m] * root[k, m]
            if k < j:
                root[j, k] = left / root[k, k]
            else:
                is_definite = is_definite and left > least
                root[j, j] = math.sqrt(max(left, least))
    return is_definite


@compiled
def solve_by_root(root: FloatArray, vector: FloatArray, out: FloatArray) -> None:
    """The solution (3,) of (root @ root.T) @ out = vector, of a lower root (3, 3); may be in place."""
    for j in range(3):
        left = vector[j]
        for k in range(j):
            left -= root[j, k] * out[k]
        out[j] = left / root[j, j]
    for j in range(2, -1, -1):
        left = out[j]
        for k in range(j + 1, 3):
            left -= root[k, j] * out[k]
        out[j] = left / root[j, j]


def inverse_of(matrix: FloatArray) -> FloatArray:
    """(3, 3) inverse of a symmetric, positive definite matrix, such as a covariance.

    Pivots below `LEAST_PIVOT` count as that. Not compiled itself: an array that compiled code makes costs as much
    to hand over as ten of these to compute.
    """
    inverse = np.empty((3, 3))
    inverse_into(matrix, inverse)
    return inverse


@compiled
def inverse_into(matrix: FloatArray, inverse: FloatArray) -> None:
    """As `inverse_of`, into an inverse (3, 3)."""
    root, unit = np.empty((3, 3)), np.empty(3)
    lower_root_into(matrix, LEAST_PIVOT, root)
    for j in range(3):
        unit[:] = 0.0
        unit[j] = 1.0
        solve_by_root(root, unit, inverse[j])


@compiled
def carry_into(covariance: FloatArray, x: float, y: float, theta: float, out: FloatArray) -> None:
    """Into out (3, 3): the covariance of a pose in its frame, seen from where a motion (x, y, theta) then leads."""
    # by the adjoint of the motion back: (c, s, ahead), (-s, c, aside), (0, 0, 1)
    c, s = math.cos(theta), math.sin(theta)
    ahead, aside = s * x - c * y, c * x + s * y
    for k in range(3):
        one, other, turn = covariance[0, k], covariance[1, k], covariance[2, k]
        out[0, k] = c * one + s * other + ahead * turn
        out[1, k] = c * other - s * one + aside * turn
        out[2, k] = turn
    for j in range(3):
        one, other, turn = out[j, 0], out[j, 1], out[j, 2]
        out[j, 0] = c * one + s * other + ahead * turn
        out[j, 1] = c * other - s * one + aside * turn


@compiled
def squared_innovation(
    x: float, y: float, theta: float, to_x: float, to_y: float, to_theta: float, known: FloatArray
) -> float:
    """Normalised square of the twist from a pose to another one, by an information (3, 3) of the first."""
    c, s = math.cos(theta), math.sin(theta)
    ahead = c * (to_x - x) + s * (to_y - y)
    aside = c * (to_y - y) - s * (to_x - x)
    turn = to_theta - theta
    turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
    half = 0.5 * turn
    cotangent = half / math.tan(half) if abs(half) > 1e-8 else 1.0
    a, b = cotangent * ahead + half * aside, cotangent * aside - half * ahead
    from_a = a * known[0, 0] + b * known[1, 0] + turn * known[2, 0]
    from_b = a * known[0, 1] + b * known[1, 1] + turn * known[2, 1]
    from_turn = a * known[0, 2] + b * known[1, 2] + turn * known[2, 2]
    squared: float = from_a * a + from_b * b + from_turn * turn
    return squared

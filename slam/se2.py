"""Poses in the plane: the group SE(2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Below this angle the closed forms of exp and log lose digits to cancellation; the series' next
# term is angle**4 / 720, under 1e-18 here.
_SMALL_ANGLE_RAD = 1e-4
FARTHEST_M = 1e8
"""Coordinates in files beyond it are faults. Chosen: twice around the earth; 1e10 makes matrices
singular."""


@overload
def wrap_angle(angle_rad: float) -> float: ...
@overload
def wrap_angle(angle_rad: NDArray[np.float64]) -> NDArray[np.float64]: ...
def wrap_angle(angle_rad: float | NDArray[np.float64]) -> float | NDArray[np.float64]:
    """The same angle in (-pi, pi] [rad], element by element."""
    if isinstance(angle_rad, np.ndarray):
        wrapped = math.pi - np.mod(math.pi - angle_rad, 2.0 * math.pi)
        # An angle already in the interval comes back to the bit: mod would round it.
        inside = (angle_rad > -math.pi) & (angle_rad <= math.pi)
        return np.asarray(np.where(inside, angle_rad, wrapped))
    if -math.pi < angle_rad <= math.pi:
        return float(angle_rad)
    return math.pi - (math.pi - angle_rad) % (2.0 * math.pi)


@dataclass(frozen=True, init=False, slots=True)
class SE2:
    """Pose or motion in the plane: x [m], y [m], theta [rad] in (-pi, pi], counter-clockwise.

    `a @ b` composes, `a @ points` with points (N, 2) moves points. Tangent vectors ("twists") are
    (x, y, theta) in the frame of the moved body: `T @ SE2.exp(twist)` perturbs T on the right.
    """

    x: float
    y: float
    theta: float

    def __init__(self, x: float, y: float, theta: float) -> None:
        # float() also turns NumPy scalars into plain floats, so that records print and dump well. The
        # generated way, with __post_init__, sets each field twice: mapping makes 10 poses for each scan,
        # and reads 100 coordinates, which in slots takes a third of the time.
        theta = float(theta)
        if not -math.pi < theta <= math.pi:
            theta = wrap_angle(theta)
        _set_x(self, float(x))
        _set_y(self, float(y))
        _set_theta(self, theta)

    @overload
    def __matmul__(self, other: SE2) -> SE2: ...
    @overload
    def __matmul__(self, other: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def __matmul__(self, other: SE2 | NDArray[np.float64]) -> SE2 | NDArray[np.float64]:
        c, s = math.cos(self.theta), math.sin(self.theta)
        if isinstance(other, SE2):
            return SE2(
                self.x + c * other.x - s * other.y,
                self.y + s * other.x + c * other.y,
                self.theta + other.theta,
            )
        points = np.asarray(other, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2:
            raise ValueError(f"SE2 moves points of shape (N, 2), not {points.shape}")
        moved = np.empty_like(points)
        moved[:, 0] = self.x + c * points[:, 0] - s * points[:, 1]
        moved[:, 1] = self.y + s * points[:, 0] + c * points[:, 1]
        return moved

    @staticmethod
    def identity() -> SE2:
        """The pose that moves nothing."""
        return SE2(0.0, 0.0, 0.0)

    @staticmethod
    def from_array(pose: ArrayLike) -> SE2:
        """The pose (x, y, theta) of an array (3,). Raises ValueError on another shape."""
        x, y, theta = _vector3(pose, "pose")
        return SE2(x, y, theta)

    @staticmethod
    def exp(twist: ArrayLike) -> SE2:
        """The pose reached by driving the constant twist (x, y, theta) for unit time: an arc."""
        vx, vy, omega = _vector3(twist, "twist")
        if abs(omega) < _SMALL_ANGLE_RAD:
            sine, cosine = 1.0 - omega**2 / 6.0, omega / 2.0 - omega**3 / 24.0
        else:
            sine, cosine = math.sin(omega) / omega, (1.0 - math.cos(omega)) / omega
        return SE2(sine * vx - cosine * vy, cosine * vx + sine * vy, omega)

    def log(self) -> NDArray[np.float64]:
        """The twist (3,) whose `exp` is this pose; its angle lies in (-pi, pi]."""
        half = self.theta / 2.0
        if abs(self.theta) < _SMALL_ANGLE_RAD:
            cotangent = 1.0 - self.theta**2 / 12.0
        else:
            cotangent = half / math.tan(half)
        return np.array(
            [cotangent * self.x + half * self.y, -half * self.x + cotangent * self.y, self.theta]
        )

    def inverse(self) -> SE2:
        """The pose that undoes this one."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return SE2(-c * self.x - s * self.y, s * self.x - c * self.y, -self.theta)

    def between(self, other: SE2) -> SE2:
        """Another pose as seen from this one: `self.inverse() @ other`, in one go."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        x, y = -c * self.x - s * self.y, s * self.x - c * self.y
        return SE2(
            x + c * other.x + s * other.y,
            y - s * other.x + c * other.y,
            other.theta - self.theta,
        )

    def is_near(self, other: SE2, within_m: float, within_rad: float) -> bool:
        """Whether another pose is at most so far away [m] and turned at most so much [rad]."""
        is_beside = math.hypot(self.x - other.x, self.y - other.y) <= within_m
        return is_beside and abs(wrap_angle(self.theta - other.theta)) <= within_rad

    def as_array(self) -> NDArray[np.float64]:
        """(x, y, theta) as an array (3,)."""
        return np.array([self.x, self.y, self.theta])

    def matrix(self) -> NDArray[np.float64]:
        """The homogeneous matrix (3, 3)."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return np.array([[c, -s, self.x], [s, c, self.y], [0.0, 0.0, 1.0]])

    def adjoint(self) -> NDArray[np.float64]:
        """(3, 3) with `T @ exp(v) @ T.inverse() == exp(T.adjoint() @ v)`."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return np.array([[c, -s, self.y], [s, c, -self.x], [0.0, 0.0, 1.0]])


_set_x, _set_y, _set_theta = (vars(SE2)[name].__set__ for name in ("x", "y", "theta"))


def _vector3(vector: ArrayLike, name: str) -> tuple[float, float, float]:
    array = np.asarray(vector, dtype=np.float64)
    if array.shape != (3,):
        raise ValueError(f"{name} must have shape (3,), not {array.shape}")
    x, y, z = array.tolist()
    return x, y, z

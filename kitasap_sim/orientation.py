"""Quaternions of what stands upright, or nearly: their heading, and turning it."""

import math
from collections.abc import Sequence

import mujoco
import numpy as np


def turned_to(quaternion: np.ndarray, heading: float) -> np.ndarray:
    """(4,) the orientation w, x, y, z turned about the vertical until it heads there; tilt kept."""
    half = (heading - heading_of(quaternion)) / 2
    turned = np.zeros(4)
    mujoco.mju_mulQuat(turned, np.array([math.cos(half), 0, 0, math.sin(half)]), quaternion)
    return turned


def heading_of(quaternion: np.ndarray | Sequence[float]) -> float:
    """Direction of the x axis seen from above [rad]."""
    w, x, y, z = quaternion
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
